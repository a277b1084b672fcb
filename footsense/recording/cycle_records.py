"""Records in the pipe from the main loop to the recorder's child process: format and decoder; see `cycle_pipe`.

Each record is its length (u32, little-endian) and one msgpack array: the header first, then cycles, and a loss before
the cycle that follows a gap. The arrays of a cycle's frames stand in one binary field, in the order of
`CYCLE_ARRAY_ORDER`, so that packing is copying. The reader checks every field: a damaged record ends the recording
in one line.
"""

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from footsense.errors import RecordingError
from footsense.frames import ALL_LEGS, Command, CommandResult, Cycle, GaitEvent, GaitFrame, ReferenceSamples
from footsense.recording.cycle_fields import (
    CYCLE_FIELDS,
    GAIT_FIELDS,
    CycleField,
    NonNegativeInt64,
    forces_from_arrays,
    gait_from_arrays,
    scan_from_arrays,
)

LENGTH_PREFIX_BYTES = 4
#: Longest record [bytes], far above any cycle.
_MAX_RECORD_BYTES = 1 << 24


class NumberedCycle(NamedTuple):
    """One cycle with its number in the recording.

    Attributes:
        cycle_number: Number of the cycle since the recording began, lost ones counted.
        cycle: The cycle.
    """

    cycle_number: int
    cycle: Cycle


class LostCycles(msgspec.Struct, frozen=True, array_like=True, tag="loss"):
    """Number of cycles lost in a row because the pipe was full, with the place and time of the loss.

    Attributes:
        next_cycle_number: Number of the next recorded cycle.
        next_t_sent_ns: Time of sending of that cycle [ns].
        n_cycles: Number of lost cycles before it.
    """

    next_cycle_number: NonNegativeInt64
    next_t_sent_ns: NonNegativeInt64
    n_cycles: NonNegativeInt64


class Header(msgspec.Struct, array_like=True, tag="header"):
    """Header record: entries of the recording's header, among them leg names and number of elements."""

    entries: dict[str, str]


class _GaitRecord(msgspec.Struct, array_like=True):
    t_ns: NonNegativeInt64
    friction: float
    all_in_air: bool
    events: tuple[GaitEvent, ...]
    arrays: bytes


class _CycleRecord(msgspec.Struct, array_like=True, tag="cycle"):
    counter: NonNegativeInt64
    scan_sequence: NonNegativeInt64
    force_sequence: NonNegativeInt64
    t_sent_ns: NonNegativeInt64
    arrays: bytes
    started_commands: tuple[Command, ...]
    ended_commands: tuple[CommandResult, ...]
    reference_samples: tuple[bytes, bytes, bytes] | None
    temperature_c: bytes | None
    gait: _GaitRecord | None


_decode = msgspec.msgpack.Decoder(Header | _CycleRecord | LostCycles).decode

#: The fields of a record in their order, wide entries first so that all are aligned.
CYCLE_ARRAY_ORDER = sorted(
    CYCLE_FIELDS, key=lambda path: np.dtype(CYCLE_FIELDS[path].dtype).itemsize, reverse=True
)
GAIT_ARRAY_ORDER = sorted(
    GAIT_FIELDS, key=lambda path: np.dtype(GAIT_FIELDS[path].dtype).itemsize, reverse=True
)


def unpack_records(
    buffer: bytearray, legs: tuple[str, ...] | None
) -> Iterator[dict[str, str] | NumberedCycle | LostCycles]:
    """Remove all complete records from the front of a buffer, and yield them decoded.

    Args:
        buffer: Bytes as they arrived; yielded records are removed, an incomplete one stays.
        legs: Names of the recording's legs; None before the header.

    Yields:
        The header, cycles and losses, in the order of the pipe.

    Raises:
        RecordingError: The bytes are no such record, or its fields have no meaning.
    """
    try:
        while len(buffer) >= LENGTH_PREFIX_BYTES:
            end = LENGTH_PREFIX_BYTES + int.from_bytes(buffer[:LENGTH_PREFIX_BYTES], "little")
            require_valid(end <= _MAX_RECORD_BYTES, f"a record of {end} bytes")
            if len(buffer) < end:
                return
            record = _decode(bytes(buffer[LENGTH_PREFIX_BYTES:end]))
            del buffer[:end]
            if isinstance(record, Header):
                legs = legs_in_header(record.entries)
                yield record.entries
            elif isinstance(record, LostCycles):
                yield record
            else:
                require_valid(legs is not None, "no header before the first cycle")
                yield _decode_cycle(record, len(legs or ()))
    except (msgspec.MsgspecError, ValueError, LookupError) as error:
        raise RecordingError(f"the cycles of the loop arrive damaged ({error})") from None


def legs_in_header(header: Mapping[str, str]) -> tuple[str, ...]:
    """Return the names of the legs in a recording's header.

    Raises:
        ValueError: They are not some of a robot's.
    """
    text = header.get("legs", "")
    legs = tuple(text.split(","))
    if len(set(legs)) < len(legs) or not set(legs) <= set(ALL_LEGS):
        raise ValueError(f"the recording names its legs {text[:40]!r}, not some of {', '.join(ALL_LEGS)}")
    return legs


def require_valid(holds: bool, error_text: str) -> None:  # noqa: FBT001 - reads like the sentence it checks
    """Raise an error with the message `error_text` unless a condition on a record's field holds.

    Raises:
        ValueError: It does not hold.
    """
    if not holds:
        raise ValueError(error_text)


def _decode_cycle(record: _CycleRecord, n_legs: int) -> NumberedCycle:
    entry = _decode_arrays(record.arrays, CYCLE_FIELDS, CYCLE_ARRAY_ORDER, n_legs)
    commands = (*record.started_commands, *(outcome.command for outcome in record.ended_commands))
    require_valid(
        all(0 <= command.leg < n_legs for command in commands), f"a command for none of {n_legs} legs"
    )
    scan = scan_from_arrays(record.scan_sequence, entry)
    forces = forces_from_arrays(record.force_sequence, record.t_sent_ns, entry)
    if record.gait is not None:
        forces = forces._replace(gait=_decode_gait(record.gait, n_legs))
    reference = None if record.reference_samples is None else _decode_reference(*record.reference_samples)
    temperature_c = None if record.temperature_c is None else np.frombuffer(record.temperature_c, "<f8")
    require_valid(temperature_c is None or len(temperature_c) == n_legs, "temperatures of other legs")
    cycle = Cycle(scan, record.started_commands, forces, record.ended_commands, reference, temperature_c)
    return NumberedCycle(record.counter, cycle)


def _decode_arrays(
    data: bytes, fields: Mapping[str, CycleField], order: list[str], n_legs: int
) -> Mapping[str, NDArray[Any]]:
    """Return the arrays in a binary field by their paths, after checking the length.

    Args:
        data: The binary field.
        fields: The arrays by their places.
        order: Their places in the order of the field.
        n_legs: Rows of each array.
    """
    layout = np.dtype([(path, fields[path].dtype, (n_legs, *fields[path].row_shape)) for path in order])
    require_valid(len(data) == layout.itemsize, f"arrays of {len(data)} bytes")
    entry: Mapping[str, NDArray[Any]] = np.frombuffer(data, dtype=layout)[0]
    for path, field in fields.items():
        if field.max_code is not None:
            found = entry[path].max()
            require_valid(found <= field.max_code, f"{path} {found}, at most {field.max_code} has a meaning")
    return entry


def _decode_gait(record: _GaitRecord, n_legs: int) -> GaitFrame:
    """Return the gait frame of a decoded record."""
    require_valid(
        all(0 <= event.leg < n_legs for event in record.events), f"an event of none of {n_legs} legs"
    )
    arrays = _decode_arrays(record.arrays, GAIT_FIELDS, GAIT_ARRAY_ORDER, n_legs)
    return gait_from_arrays(record.t_ns, record.friction, record.all_in_air, record.events, arrays)


def _decode_reference(times: bytes, forces: bytes, saturations: bytes) -> ReferenceSamples:
    """Return the force-sensor samples in a record's binary fields; there may be none."""
    t_ns, saturated = np.frombuffer(times, "<i8"), np.frombuffer(saturations, "u1")
    force_n = np.frombuffer(forces, "<f8").reshape(len(t_ns), 3)
    meant = len(saturated) == len(t_ns) and t_ns.min(initial=0) >= 0 and saturated.max(initial=0) <= 1
    require_valid(meant, "a sample of the reference has no such time or mark")
    return ReferenceSamples(t_ns, force_n, saturated.astype(np.bool_))
