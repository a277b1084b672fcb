"""Reader of the cycles of a running service: recorder, exporter, page and snapshot have no other."""

import mmap
import os
import zlib
from collections.abc import Mapping
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from footsense.errors import FootsenseError
from footsense.frames import ELEMENTS, Command, CommandResult, Cycle, GaitEvent, GaitFrame, ReferenceSamples
from footsense.ring.cycle_fields import (
    CYCLE_FIELDS,
    GAIT_FIELDS,
    CycleField,
    NonNegativeInt64,
    forces_from_arrays,
    gait_from_arrays,
    scan_from_arrays,
)
from footsense.ring.records import (
    CYCLE_ARRAY_ORDER,
    GAIT_ARRAY_ORDER,
    LostCycles,
    NumberedCycle,
    ServiceStatus,
    legs_in_header,
    require_valid,
)
from footsense.ring.ring_file import (
    BEGIN,
    END,
    HEADER_BYTES,
    HEADER_PLACE,
    MAGIC,
    MARGIN_BYTES,
    MAX_RECORD_BYTES,
    RECENT,
    RECORD_HEAD,
    SERVICE_RING,
    is_locked,
    open_ring,
    ring_place,
    user_ring,
)

_MAX_HEADER_BYTES = 1 << 20
#: Most that is copied at once [bytes].
_MAX_READ_BYTES = 1 << 20
_MAX_RING_BYTES = 1 << 30
#: The writer overtakes a reader while it copies, at most so often in a row.
_MAX_READ_TRIES = 4


class CycleReader:
    """Reader of the cycles of a running service.

    Args:
        path: The file; None for that of the robot's service, or without one of this user's simulated robot.
        fd: A descriptor of the file instead.

    Attributes:
        path: The file.
        header: Entries of the header.
        legs: Name of the leg in each row of the frames.
        status: Status of the service when the last cycles were written; None before the first.

    Raises:
        FootsenseError: No running service writes the file, or it holds something else.
    """

    def __init__(self, path: Path | None = None, fd: int | None = None) -> None:
        self.path = path or (SERVICE_RING if SERVICE_RING.exists() else user_ring())
        self._fd = open_ring(self.path) if fd is None else fd
        try:
            self._ring = RingReader(self._fd, str(self.path))
            self.header = msgspec.json.decode(self._ring.header, type=dict[str, str])
            self.legs = legs_in_header(self.header)
        except (ValueError, LookupError, RecursionError) as error:
            os.close(self._fd)
            raise FootsenseError(f"{self.path} does not hold footsense's cycles: {error}") from error
        except FootsenseError:
            os.close(self._fd)
            raise
        self.status: ServiceStatus | None = None
        self._next_number: int | None = None

    def rewind(self, first_number: int | None = None) -> None:
        """Begin with the oldest cycle that the ring holds; those from a number on are counted as lost before it."""
        self._ring.rewind()
        self._next_number = first_number

    @property
    def n_unread_bytes(self) -> int:
        """Bytes that were written and not read yet."""
        return self._ring.end - self._ring.position

    @property
    def position(self) -> int:
        """Position of the next record in the ring [bytes]."""
        return self._ring.position

    def read(self) -> list[NumberedCycle | LostCycles]:
        """Return the cycles since the last call, some hundred at most, and the gaps between them; do not wait.

        Raises:
            FootsenseError: A record is damaged.
        """
        entries: list[NumberedCycle | LostCycles] = []
        for record in self._ring.read():
            entry = decode_record(record, len(self.legs))
            if isinstance(entry, ServiceStatus):
                self.status = entry
                continue
            n_lost = 0 if self._next_number is None else entry.cycle_number - self._next_number
            if n_lost < 0:
                raise FootsenseError(f"{self.path}: a cycle comes twice")
            if n_lost:
                entries.append(LostCycles(entry.cycle_number, entry.cycle.forces.t_sent_ns, n_lost))
            entries.append(entry)
            self._next_number = entry.cycle_number + 1
        return entries

    def is_still_written(self) -> bool:
        """Return whether the service still runs and its file has not been replaced."""
        with suppress(OSError):
            return self.path.stat().st_ino == os.fstat(self._fd).st_ino and self._ring.is_alive()
        return False

    def close(self) -> None:
        """Close the file."""
        self._ring.close()


class RingReader:
    """Reader's end of a ring, which begins with the last second.

    Args:
        fd: Descriptor of the file from `open_ring`; closed by `close`.
        name: Name of the file in error messages.

    Attributes:
        header: The header.
        position: Position of the next record [bytes].

    Raises:
        FootsenseError: `RingWriter` did not create the file.
    """

    def __init__(self, fd: int, name: str) -> None:
        self._fd = fd
        self._name = name
        try:
            self._counters = memoryview(mmap.mmap(fd, mmap.PAGESIZE, prot=mmap.PROT_READ)).cast("Q")
        except (ValueError, OSError):  # shorter than a page
            raise FootsenseError(f"{name} does not hold footsense's cycles") from None
        n_header = self._counters[HEADER_BYTES]
        self._place = ring_place(n_header)
        self._n_bytes = os.fstat(fd).st_size - self._place
        if (
            os.pread(fd, len(MAGIC), 0) != MAGIC
            or n_header > _MAX_HEADER_BYTES
            or not MARGIN_BYTES < self._n_bytes <= _MAX_RING_BYTES
        ):
            raise FootsenseError(f"{name} does not hold footsense's cycles")
        self.header = os.pread(fd, n_header, HEADER_PLACE)
        self.position: int = self._counters[RECENT]
        self._doubted_position: int | None = None

    def rewind(self) -> None:
        """Go back to the oldest record."""
        self.position = self._counters[BEGIN]

    @property
    def end(self) -> int:
        """Position behind the last record [bytes]."""
        return int(self._counters[END])

    def is_alive(self) -> bool:
        """Return whether the writer still runs."""
        return is_locked(self._fd)

    def read(self) -> list[bytes]:
        """Return the next records without waiting, about a megabyte at most; records that were overwritten are skipped.

        Raises:
            FootsenseError: A record is damaged.
        """
        for _ in range(_MAX_READ_TRIES):
            start = max(self.position, self._counters[BEGIN])
            data = self._copy(start, min(self.end, start + _MAX_READ_BYTES))
            if self._counters[BEGIN] <= start:
                break
        else:
            return []
        records, at = [], 0
        while at + RECORD_HEAD.size <= len(data):
            length, crc = RECORD_HEAD.unpack_from(data, at)
            record = data[at + RECORD_HEAD.size : at + RECORD_HEAD.size + length]
            if length > MAX_RECORD_BYTES or (len(record) == length and zlib.crc32(record) != crc):
                # On some processors `end` may be seen a moment before the bytes.
                if self._doubted_position == start + at:
                    raise FootsenseError(f"{self._name}: a record is damaged")
                self._doubted_position = start + at
                break
            if len(record) < length:
                break
            records.append(record)
            at += RECORD_HEAD.size + length
        self.position = start + at
        return records

    def _copy(self, start: int, end: int) -> bytes:
        n, place = max(end - start, 0), start % self._n_bytes
        ahead = os.pread(self._fd, min(n, self._n_bytes - place), self._place + place)
        return ahead + os.pread(self._fd, n - len(ahead), self._place) if len(ahead) < n else ahead

    def close(self) -> None:
        """Unmap and close the file."""
        self._counters.release()
        os.close(self._fd)


class _GaitRecord(msgspec.Struct, array_like=True):
    t_ns: NonNegativeInt64
    friction: float
    all_in_air: bool
    events: tuple[GaitEvent, ...]
    arrays: bytes


class _CycleRecord(msgspec.Struct, array_like=True, tag="cycle"):
    cycle_number: NonNegativeInt64
    scan_sequence: NonNegativeInt64
    force_sequence: NonNegativeInt64
    t_sent_ns: NonNegativeInt64
    arrays: bytes
    started_commands: tuple[Command, ...]
    ended_commands: tuple[CommandResult, ...]
    reference_samples: tuple[bytes, bytes, bytes] | None
    temperature_c: bytes | None
    gait: _GaitRecord | None


_decode = msgspec.msgpack.Decoder(_CycleRecord | ServiceStatus).decode


def decode_record(record: bytes, n_legs: int) -> NumberedCycle | ServiceStatus:
    """Return the cycle or the status in a record.

    Args:
        record: The record.
        n_legs: Rows of its arrays.

    Raises:
        FootsenseError: The bytes are no such record, or its fields have no meaning.
    """
    try:
        decoded = _decode(record)
        if isinstance(decoded, ServiceStatus):
            require_valid(len(decoded.baseline) == 8 * n_legs * ELEMENTS, "baselines of other legs")
            return decoded
        return _numbered_cycle(decoded, n_legs)
    except (msgspec.MsgspecError, ValueError, LookupError) as error:
        raise FootsenseError(f"the cycles of the loop arrive damaged ({error})") from None


def _numbered_cycle(record: _CycleRecord, n_legs: int) -> NumberedCycle:
    arrays = _decode_arrays(record.arrays, CYCLE_FIELDS, _cycle_layout(n_legs))
    commands = (*record.started_commands, *(outcome.command for outcome in record.ended_commands))
    require_valid(
        all(0 <= command.leg < n_legs for command in commands), f"a command for none of {n_legs} legs"
    )
    scan = scan_from_arrays(record.scan_sequence, arrays)
    forces = forces_from_arrays(record.force_sequence, record.t_sent_ns, arrays)
    if record.gait is not None:
        forces = forces._replace(gait=_decode_gait(record.gait, n_legs))
    reference = None if record.reference_samples is None else _decode_reference(*record.reference_samples)
    temperature_c = None if record.temperature_c is None else np.frombuffer(record.temperature_c, "<f8")
    require_valid(temperature_c is None or len(temperature_c) == n_legs, "temperatures of other legs")
    cycle = Cycle(scan, record.started_commands, forces, record.ended_commands, reference, temperature_c)
    return NumberedCycle(record.cycle_number, cycle)


@cache
def _cycle_layout(n_legs: int) -> np.dtype[Any]:
    return _layout(CYCLE_FIELDS, CYCLE_ARRAY_ORDER, n_legs)


@cache
def _gait_layout(n_legs: int) -> np.dtype[Any]:
    return _layout(GAIT_FIELDS, GAIT_ARRAY_ORDER, n_legs)


def _layout(fields: Mapping[str, CycleField], order: list[str], n_legs: int) -> np.dtype[Any]:
    return np.dtype([(path, fields[path].dtype, (n_legs, *fields[path].row_shape)) for path in order])


def _decode_arrays(
    data: bytes, fields: Mapping[str, CycleField], layout: np.dtype[Any]
) -> Mapping[str, NDArray[Any]]:
    """Return the arrays in a binary field by their paths, after checking its length and codes."""
    require_valid(len(data) == layout.itemsize, f"arrays of {len(data)} bytes")
    arrays: Mapping[str, NDArray[Any]] = np.frombuffer(data, dtype=layout)[0]
    for path, field in fields.items():
        if field.max_code is not None:
            found = max(arrays[path].tobytes()) if field.dtype == "u1" else arrays[path].max()
            require_valid(found <= field.max_code, f"{path} {found}, at most {field.max_code} has a meaning")
    return arrays


def _decode_gait(record: _GaitRecord, n_legs: int) -> GaitFrame:
    require_valid(
        all(0 <= event.leg < n_legs for event in record.events), f"an event of none of {n_legs} legs"
    )
    arrays = _decode_arrays(record.arrays, GAIT_FIELDS, _gait_layout(n_legs))
    return gait_from_arrays(record.t_ns, record.friction, record.all_in_air, record.events, arrays)


def _decode_reference(times: bytes, forces: bytes, saturations: bytes) -> ReferenceSamples:
    t_ns, saturated = np.frombuffer(times, "<i8"), np.frombuffer(saturations, "u1")
    force_n = np.frombuffer(forces, "<f8").reshape(len(t_ns), 3)
    meant = len(saturated) == len(t_ns) and t_ns.min(initial=0) >= 0 and saturated.max(initial=0) <= 1
    require_valid(meant, "a sample of the reference has no such time or mark")
    return ReferenceSamples(t_ns, force_n, saturated.astype(np.bool_))
