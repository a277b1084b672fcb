"""The one way out of the loop: its cycles in a ring that recorder, exporter, page and snapshot read.

The loop encodes each cycle once and waits for nobody; a reader that is too slow finds that the oldest cycles are
overwritten, and counts them.
"""

import fcntl
import json
import mmap
import os
import zlib
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from operator import attrgetter
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from footsense.errors import FootsenseError
from footsense.frames import Cycle, GaitFrame
from footsense.ports import Observer
from footsense.ring import ring_file
from footsense.ring.records import CYCLE_FIELDS, GAIT_FIELDS, MOTION_FIELDS, ServiceStatus

#: Time that the ring holds [s].
RING_DURATION_S = 30
#: Smallest ring [bytes].
_MIN_RING_BYTES = 1 << 20
_STATUS_PERIOD_NS = 100_000_000
#: Records per second besides the cycles, each as large as a cycle: a status with a gait.
_OTHER_RECORDS_PER_S = 10
#: Bytes of a cycle besides its arrays.
_OTHER_CYCLE_BYTES = 100
#: Room for what few cycles have: samples of a test stand, temperatures, motions, commands [1].
_ROOM_REL = 1.1
#: Blocks that a reader begins with: the last second.
_N_RECENT_BLOCKS = 10

#: Integers of numpy become Python's.
_encode = msgspec.msgpack.Encoder(enc_hook=np.generic.item).encode
_arrays_of = attrgetter(*CYCLE_FIELDS)
_gait_arrays_of = attrgetter(*(path.partition(".")[2] for path in GAIT_FIELDS))
_motion_arrays_of = attrgetter(*(path.partition(".")[2] for path in MOTION_FIELDS))


def encode_cycle(cycle_number: int, cycle: Cycle) -> bytes:
    """Return one cycle as a record.

    Timing:
        2 us for six legs.
    """
    scan, commands, forces, outcomes, reference, temperature_c, motion = cycle
    return _encode(
        (
            *("cycle", cycle_number, scan.sequence, forces.sequence, forces.t_sent_ns),
            _joined(_arrays_of(cycle)),
            *(commands, outcomes),
            None if reference is None else tuple(column.tobytes() for column in reference),
            None if temperature_c is None else temperature_c.tobytes(),
            None if motion is None else _joined(_motion_arrays_of(motion)),
            None if forces.gait is None else _gait_entries(forces.gait),
        )
    )


def _joined(arrays: Iterable[NDArray[Any]]) -> bytes:
    return b"".join(map(np.ndarray.tobytes, arrays))


def _gait_entries(gait: GaitFrame) -> tuple[object, ...]:
    return (gait.t_ns, gait.friction, gait.all_in_air, gait.events, _joined(_gait_arrays_of(gait)))


def _overwrite_at_once(position: int) -> None:
    """Wait for no reader."""


class CycleRing(Observer):
    """Observer that writes every cycle, and ten times a second the status of the service, into a ring.

    Args:
        path: The file. It should lie in memory (/run, /dev/shm): on a disk, write-back can block the writer. None for
            one without a name, for the recorder alone.
        legs: Name of the leg in each row of the frames.
        header: Entries of a recording's header.
        cycle_rate_hz: Cycles per second; the ring holds 30 s of them.
        status: Returns the status of the service.

    Attributes:
        n_cycles: Cycles so far.
        before_overwriting: Called with a position before the bytes ahead of it are overwritten; may wait for a reader.

    Raises:
        FootsenseError: Another running process writes this file, something else has its name, or it cannot be created.

    Timing:
        7 us a cycle of six legs; no lock.
    """

    def __init__(
        self,
        path: Path | None,
        legs: Sequence[str],
        header: Mapping[str, str],
        cycle_rate_hz: float,
        status: Callable[[], ServiceStatus],
    ) -> None:
        text = json.dumps({**header, "legs": ",".join(legs)}).encode()
        self._path = path
        self._place = ring_file.ring_place(len(text))
        self._n_bytes = _ring_bytes(len(legs), cycle_rate_hz)
        self._status = status
        self._status_due_ns = 0
        self._begin = self._end = 0
        #: Where blocks begin, oldest first.
        self._blocks: deque[int] = deque()
        self.n_cycles = 0
        self.before_overwriting: Callable[[int], None] = _overwrite_at_once
        try:
            self._fd = self._create(text)
        except OSError as error:
            raise FootsenseError(f"{path}: cannot be written: {error.strerror}") from error

    def _create(self, header: bytes) -> int:
        if self._path is None:
            fd, unnamed = os.memfd_create("footsense-ring", os.MFD_CLOEXEC), None
        else:
            ring_file.check_replaceable(self._path)
            unnamed = self._path.with_name(f"{self._path.name}.draft")
            fd = ring_file.open_draft(unnamed)
        try:
            fcntl.flock(fd, fcntl.LOCK_EX)
            os.fchmod(fd, 0o644)
            # So that a full memory is an error here, and not in the loop.
            os.posix_fallocate(fd, 0, self._place + self._n_bytes)
            self._counters = memoryview(mmap.mmap(fd, mmap.PAGESIZE)).cast("Q")
            self._counters[ring_file.HEADER_BYTES] = len(header)
            os.pwrite(fd, ring_file.MAGIC, 0)
            os.pwrite(fd, header, ring_file.HEADER_PLACE)
            if unnamed is not None and self._path is not None:
                unnamed.rename(self._path)
        except OSError:
            os.close(fd)
            if unnamed is not None:
                unnamed.unlink()
            raise
        return fd

    def observe(self, cycle: Cycle) -> None:
        """Write one cycle; ten times a second a block of records begins, with the status of the service."""
        t_ns = cycle.forces.t_sent_ns
        if t_ns >= self._status_due_ns:
            self._status_due_ns = t_ns + _STATUS_PERIOD_NS
            self._blocks.append(self._end)
            self._counters[ring_file.RECENT] = self._blocks[-min(_N_RECENT_BLOCKS, len(self._blocks))]
            self._write(_encode(self._status()))
        record = encode_cycle(self.n_cycles, cycle)
        if len(record) > ring_file.MAX_RECORD_BYTES:  # a burst of a test stand's samples
            record = encode_cycle(self.n_cycles, cycle._replace(reference=None))
        self.n_cycles += 1
        self._write(record)

    def _write(self, data: bytes) -> None:
        record = ring_file.RECORD_HEAD.pack(len(data), zlib.crc32(data, self._end)) + data
        end = self._end + len(record)
        overwritten = end + ring_file.MARGIN_BYTES - self._n_bytes
        if overwritten > self._begin:
            self._give_up_blocks(overwritten)
        place = self._end % self._n_bytes
        n_ahead = self._n_bytes - place
        os.pwrite(self._fd, record[:n_ahead], self._place + place)
        if n_ahead < len(record):
            os.pwrite(self._fd, record[n_ahead:], self._place)
        self._end = self._counters[ring_file.END] = end

    def _give_up_blocks(self, position: int) -> None:
        """Give up the oldest blocks, so that the bytes ahead of a position may be overwritten."""
        begin = self._begin
        while begin < position:
            begin = self._blocks.popleft() if self._blocks else self._end
        self.before_overwriting(begin)
        self._begin = self._counters[ring_file.BEGIN] = begin

    def open_for_reading(self) -> int:
        """Return a descriptor of the ring for `CycleReader` in a child process."""
        return os.open(f"/proc/self/fd/{self._fd}", os.O_RDONLY | os.O_CLOEXEC)

    def close(self) -> None:
        """Remove the file and release its lock; a second call does nothing."""
        if self._fd >= 0:
            if self._path is not None:
                self._path.unlink(missing_ok=True)
            self._counters.release()
            os.close(self._fd)
            self._fd = -1


def _ring_bytes(n_legs: int, cycle_rate_hz: float) -> int:
    leg_bytes = sum(np.dtype((field.dtype, field.row_shape)).itemsize for field in CYCLE_FIELDS.values())
    records_per_s = cycle_rate_hz + _OTHER_RECORDS_PER_S
    ring_bytes = RING_DURATION_S * records_per_s * (n_legs * leg_bytes + _OTHER_CYCLE_BYTES)
    return max(_MIN_RING_BYTES, int(_ROOM_REL * ring_bytes))
