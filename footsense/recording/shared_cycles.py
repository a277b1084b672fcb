"""Ring buffer of the latest cycles in shared memory, written by the service and read by viewer processes.

The loop copies each cycle into the next slot of a ring and waits for nobody: a reader that is too slow finds newer
cycles in the slots, and counts those that it missed. There is one writer, and any number of readers.

The file::

    8 bytes   "FSCYCLE1"
    8 bytes   length n of the header, little-endian
    n bytes   the header: a JSON object of strings as in a recording, padded with blanks to a multiple of 8
    8 bytes   number of cycles so far
    doubles   unloaded reading of every element without stray [pF], (legs, elements), then the counts of `CanStatistics`
    slots     8 bytes number of the cycle + 1, or 0 while it is written; then the record of `cycle_records`
"""

import json
import mmap
import os
import struct
from array import array
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import astuple, fields
from pathlib import Path
from typing import NamedTuple

import msgspec
import numpy as np

from footsense.errors import FootsenseError, RecordingError
from footsense.frames import ELEMENTS, CanStatistics, Cycle, Vector
from footsense.ports import Observer
from footsense.recording.cycle_pipe import pack_cycle
from footsense.recording.cycle_records import NumberedCycle, legs_in_header, unpack_records
from footsense.shared_file import SharedFileWriter, is_locked

_MAGIC = b"FSCYCLE1"
_HEADER_STRUCT = struct.Struct("<8sQ")
_COUNTER_STRUCT = struct.Struct("<Q")
#: Cycles in the ring: 1.4 s at the highest rate, so that a viewer that was not scheduled for a second misses nothing.
N_SLOTS = 512
#: Bytes of a slot: twice a cycle of eight legs of 16 elements with its gait.
SLOT_BYTES = 8192
_N_CAN_COUNTERS = len(fields(CanStatistics))
_STATISTICS_COPY_PERIOD_NS = 100_000_000


class SharedCycleWriter(Observer):
    """Observer that copies every cycle into the ring buffer in shared memory.

    Args:
        path: The file, in memory.
        legs: Name of the leg in each row of the frames.
        header: Entries of a recording's header, of feet without nine elements with their number.
        baseline_pf: Returns the unloaded reading of each element, without stray [pF], shape (legs, elements); a new
            array whenever it moves.
        can: Counts of the CAN channel.

    Raises:
        FootsenseError: The file cannot be written, or belongs to another running service.

    Timing:
        3 us a cycle of six legs; no lock, no system call.
    """

    def __init__(
        self,
        path: Path,
        legs: Sequence[str],
        header: Mapping[str, str],
        baseline_pf: Callable[[], Vector],
        can: CanStatistics,
    ) -> None:
        header = {**header, "legs": ",".join(legs)}
        text = json.dumps(header).encode()
        text += b" " * (-len(text) % 8)
        n_doubles = len(legs) * ELEMENTS + _N_CAN_COUNTERS
        n_bytes = _COUNTER_STRUCT.size + 8 * n_doubles + N_SLOTS * SLOT_BYTES
        self._file = SharedFileWriter(path, _HEADER_STRUCT.pack(_MAGIC, len(text)) + text, n_bytes)
        self._cells = self._file.cells
        self._float64_values = self._cells[_COUNTER_STRUCT.size : _COUNTER_STRUCT.size + 8 * n_doubles].cast(
            "d"
        )
        self._first_slot = _COUNTER_STRUCT.size + 8 * n_doubles
        self._baseline_pf = baseline_pf
        self._baseline: Vector | None = None
        self._can = can
        self._copy_due_ns = 0
        self._n = 0

    def observe(self, cycle: Cycle) -> None:
        """Copy one cycle into the next slot of the ring buffer."""
        baseline = self._baseline_pf()
        if baseline is not self._baseline:
            self._baseline = baseline
            self._float64_values[: baseline.size] = baseline.ravel().data
        if cycle.forces.t_sent_ns >= self._copy_due_ns:
            self._copy_due_ns = cycle.forces.t_sent_ns + _STATISTICS_COPY_PERIOD_NS
            self._float64_values[-_N_CAN_COUNTERS:] = array("d", astuple(self._can))
        record = pack_cycle(self._n, cycle)
        if len(record) > SLOT_BYTES - _COUNTER_STRUCT.size:  # a burst of a test stand's samples
            record = pack_cycle(self._n, cycle._replace(reference=None))
        start = self._first_slot + self._n % N_SLOTS * SLOT_BYTES
        self._n += 1
        _COUNTER_STRUCT.pack_into(self._cells, start, 0)
        if len(record) <= SLOT_BYTES - _COUNTER_STRUCT.size:
            self._cells[start + _COUNTER_STRUCT.size : start + _COUNTER_STRUCT.size + len(record)] = record
            _COUNTER_STRUCT.pack_into(self._cells, start, self._n)
        _COUNTER_STRUCT.pack_into(self._cells, 0, self._n)

    def close(self) -> None:
        """Remove the shared-memory file."""
        self._float64_values.release()
        self._cells.release()
        self._file.close()


class NewCycles(NamedTuple):
    """Cycles read from the ring buffer since the last call, and the number of those overwritten before.

    Attributes:
        cycles: The cycles, oldest first.
        n_missed: Cycles before and between them that were overwritten before they were read.
    """

    cycles: list[NumberedCycle]
    n_missed: int


class CycleReader:
    """Reader of the ring buffer of a running service.

    Args:
        path: The file.

    Attributes:
        header: Entries of the header.
        legs: Name of the leg in each row of the frames.

    Raises:
        FootsenseError: No running service writes the file, or `SharedCycleWriter` did not create it.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        try:
            self._file = path.open("rb")
        except OSError as error:
            raise FootsenseError(f"{path}: {error.strerror}") from error
        try:
            length = self._map_and_read_header()
        except BaseException:
            self._file.close()
            raise
        self._start = _HEADER_STRUCT.size + length
        self._first_slot = self._start + _COUNTER_STRUCT.size + 8 * self._n_doubles
        self._next = max(0, self._n_cycles_written - N_SLOTS // 2)

    def _map_and_read_header(self) -> int:
        """Map the shared-memory file, and read its header; return the header's length [bytes].

        Raises:
            FootsenseError: Its service has ended, or it holds something else.
        """
        if not is_locked(self._file):
            raise FootsenseError(f"{self._path}: its service has ended")
        try:
            self._map = mmap.mmap(self._file.fileno(), 0, prot=mmap.PROT_READ)
            magic, length = _HEADER_STRUCT.unpack_from(self._map)
            self.header = msgspec.json.decode(
                self._map[_HEADER_STRUCT.size : _HEADER_STRUCT.size + length], type=dict[str, str]
            )
            self.legs = legs_in_header(self.header)
            self._n_doubles = len(self.legs) * ELEMENTS + _N_CAN_COUNTERS
        except (ValueError, LookupError, struct.error, OSError, RecursionError) as error:
            raise FootsenseError(f"{self._path} does not hold footsense's cycles: {error}") from error
        n_bytes = (
            _HEADER_STRUCT.size + length + _COUNTER_STRUCT.size + 8 * self._n_doubles + N_SLOTS * SLOT_BYTES
        )
        if magic != _MAGIC or len(self._map) != n_bytes:
            raise FootsenseError(f"{self._path} does not hold footsense's cycles")
        return int(length)

    @property
    def _n_cycles_written(self) -> int:
        number: int = _COUNTER_STRUCT.unpack_from(self._map, self._start)[0]
        return number

    def is_still_written(self) -> bool:
        """Return whether the service still runs and its file has not been replaced."""
        with suppress(OSError):
            return self._path.stat().st_ino == os.fstat(self._file.fileno()).st_ino and is_locked(self._file)
        return False

    def read(self) -> NewCycles:
        """Return the cycles since the last call; the first call begins with the newest half of the ring buffer.

        Raises:
            FootsenseError: A record is damaged.
        """
        n_written = self._n_cycles_written
        first = max(self._next, n_written - N_SLOTS + 1)
        cycles = list(self._cycles(first, n_written))
        n_missed = n_written - self._next - len(cycles)
        self._next = n_written
        return NewCycles(cycles, n_missed)

    def _cycles(self, first: int, end: int) -> Iterator[NumberedCycle]:
        for number in range(first, end):
            start = self._first_slot + number % N_SLOTS * SLOT_BYTES
            record = self._map[start : start + SLOT_BYTES]
            # Read again behind the copy: the writer may have come round to this slot.
            after = _COUNTER_STRUCT.unpack_from(self._map, start)[0]
            if not number + 1 == _COUNTER_STRUCT.unpack_from(record)[0] == after:
                continue
            length = 4 + int.from_bytes(record[_COUNTER_STRUCT.size : _COUNTER_STRUCT.size + 4], "little")
            try:
                for entry in unpack_records(
                    bytearray(record[_COUNTER_STRUCT.size : _COUNTER_STRUCT.size + length]), self.legs
                ):
                    if isinstance(entry, NumberedCycle) and entry.cycle_number == number:
                        yield entry
            except RecordingError as error:
                raise FootsenseError(f"{self._path}: {error}") from None

    @property
    def baseline_pf(self) -> Vector:
        """Unloaded reading of each element, without stray [pF], shape (legs, elements), NaN where unknown."""
        return self._baseline_and_can_counters()[:-_N_CAN_COUNTERS].reshape(-1, ELEMENTS)

    @property
    def can_statistics(self) -> CanStatistics:
        """CAN statistics of the service, at most 0.1 s old while cycles arrive."""
        return CanStatistics(
            *map(int, np.nan_to_num(self._baseline_and_can_counters()[-_N_CAN_COUNTERS:]).tolist())
        )

    def _baseline_and_can_counters(self) -> Vector:
        return np.frombuffer(
            self._map, np.float64, self._n_doubles, self._start + _COUNTER_STRUCT.size
        ).copy()

    def close(self) -> None:
        """Unmap the shared-memory file."""
        self._map.close()
        self._file.close()
