"""The ring's records and their checked decoder: numbered cycles, and the status of the service.

A record is one msgpack array: a cycle, or the values of the service that change slowly. The arrays of a cycle's frames
stand in one binary field in the order of `CYCLE_FIELDS`, so that encoding (`cycle_ring`) is copying.
"""

from collections.abc import Mapping
from functools import cache
from typing import Annotated, Any, Literal, NamedTuple, TypeVar, get_origin, get_type_hints

import msgspec
import numpy as np
from numpy.typing import NDArray

from footsense.errors import FootsenseError
from footsense.frames import (
    ALL_LEGS,
    ELEMENTS,
    BaselineDrift,
    CanStatistics,
    CapFrame,
    Command,
    CommandResult,
    ContactFrame,
    Cycle,
    CycleField,
    GaitEvent,
    GaitFrame,
    LegMotion,
    ReferenceSamples,
    Vector,
)

#: A counter or time: not negative, 63 bits.
NonNegativeInt64 = Annotated[int, msgspec.Meta(ge=0, le=(1 << 63) - 1)]
_Frame = TypeVar("_Frame", CapFrame, LegMotion, BaselineDrift, ContactFrame, GaitFrame)


def _fields_of(frame: type[tuple[Any, ...]], place: str) -> dict[str, CycleField]:
    """Return the arrays of a frame, as it declares them, by their path."""
    hints = get_type_hints(frame, include_extras=True)
    declared = {name: hint.__metadata__[0] for name, hint in hints.items() if get_origin(hint) is Annotated}
    return {
        f"{place}.{name}": field if field.json_keys else field._replace(json_keys=(name,))
        for name, field in declared.items()
    }


def _wide_first(fields: dict[str, CycleField]) -> dict[str, CycleField]:
    """Return fields in an order in which a record has all of them aligned."""
    return dict(sorted(fields.items(), key=lambda item: -np.dtype(item[1].dtype).itemsize))


_PLACES = {
    CapFrame: "scan",
    LegMotion: "motion",
    BaselineDrift: "forces.baseline",
    ContactFrame: "forces",
    GaitFrame: "gait",
}
_BY_FRAME = {frame: _fields_of(frame, place) for frame, place in _PLACES.items()}
#: The arrays of a cycle by their path, such as `forces.force_n`, and those of a gait and a motion, which few cycles
#: have.
CYCLE_FIELDS = _wide_first(_BY_FRAME[CapFrame] | _BY_FRAME[ContactFrame] | _BY_FRAME[BaselineDrift])
GAIT_FIELDS = _wide_first(_BY_FRAME[GaitFrame])
MOTION_FIELDS = _wide_first(_BY_FRAME[LegMotion])


def frame_from_arrays(kind: type[_Frame], arrays: Mapping[str, NDArray[Any]], **others: Any) -> _Frame:  # noqa: ANN401 - the values of a frame
    """Return the frame of some kind made of arrays by their paths, and of its other values."""
    values: dict[str, Any] = {}
    for path, field in _BY_FRAME[kind].items():
        name = path.rpartition(".")[2]
        values[name] = arrays[path].astype(np.bool_) if field.max_code == 1 else arrays[path]
    if kind is ContactFrame:
        others["baseline"] = frame_from_arrays(BaselineDrift, arrays)
    return kind(**values, **others)


class NumberedCycle(NamedTuple):
    """One cycle with its number in the run or recording.

    Attributes:
        cycle_number: Number of the cycle since the beginning, lost ones counted.
        cycle: The cycle.
    """

    cycle_number: int
    cycle: Cycle


class LostCycles(NamedTuple):
    """Number of cycles lost in a row because their reader was too slow, with the place and time of the loss.

    Attributes:
        next_cycle_number: Number of the next cycle that was read.
        next_t_sent_ns: Time of sending of that cycle [ns].
        n_cycles: Number of lost cycles before it.
    """

    next_cycle_number: int
    next_t_sent_ns: int
    n_cycles: int


class ServiceStatus(msgspec.Struct, array_like=True, tag="status", frozen=True):
    """Values of the service that change slowly, written ten times a second.

    Attributes:
        can: Counts of the CAN channel.
        baseline: Unloaded reading of each element, without stray [pF], float64, legs x elements, NaN where unknown.
        wakeup_histogram: Wake-ups of all threads by latency, as `WakeupLatency.histogram`; None in virtual time.
        n_overruns: Deadlines that had passed before a thread could sleep.
        n_late_discards: Conversions given up because a wake-up came too late.
        n_lost_log_lines: Lines that the log has dropped.
        n_lost_cycles: Cycles missing in the recording.
    """

    can: CanStatistics
    baseline: bytes
    wakeup_histogram: list[float] | None = None
    n_overruns: NonNegativeInt64 = 0
    n_late_discards: NonNegativeInt64 = 0
    n_lost_log_lines: NonNegativeInt64 = 0
    n_lost_cycles: NonNegativeInt64 = 0

    @property
    def baseline_pf(self) -> Vector:
        """Unloaded reading of each element, without stray [pF], shape (legs, elements), NaN where unknown."""
        return np.frombuffer(self.baseline, "<f8").reshape(-1, ELEMENTS)


def legs_in_header(header: Mapping[str, str]) -> tuple[str, ...]:
    """Return the names of the legs in the header of a ring or recording.

    Raises:
        ValueError: They are not some of a robot's.
    """
    text = header.get("legs", "")
    legs = tuple(text.split(","))
    if len(set(legs)) < len(legs) or not set(legs) <= set(ALL_LEGS):
        raise ValueError(f"the recording names its legs {text[:40]!r}, not some of {', '.join(ALL_LEGS)}")
    return legs


def leg_entries(header: Mapping[str, str], key: str) -> dict[str, str]:
    """Return what an entry of a header such as `lf=foot-0001,rf=foot-0002` has for its legs; none without it."""
    return dict(pair.split("=", 1) for pair in header.get(key, "").split(",") if "=" in pair)


def require_valid(holds: bool, error_text: str) -> None:  # noqa: FBT001 - reads like the sentence it checks
    """Raise an error with the message `error_text` unless a condition on a record's field holds.

    Raises:
        ValueError: It does not hold.
    """
    if not holds:
        raise ValueError(error_text)


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
    motion: bytes | None
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
    arrays = _decode_arrays(record.arrays, "cycle", n_legs)
    commands = (*record.started_commands, *(outcome.command for outcome in record.ended_commands))
    legs = [command.leg for command in commands]
    legs += [event.leg for event in record.gait.events] if record.gait is not None else []
    require_valid(all(0 <= leg < n_legs for leg in legs), f"a command or event of none of {n_legs} legs")
    scan = frame_from_arrays(CapFrame, arrays, sequence=record.scan_sequence)
    forces = frame_from_arrays(
        ContactFrame, arrays, sequence=record.force_sequence, t_sent_ns=record.t_sent_ns
    )
    if record.gait is not None:
        forces = forces._replace(gait=_decode_gait(record.gait, n_legs))
    reference = None if record.reference_samples is None else _decode_reference(*record.reference_samples)
    temperature_c = None if record.temperature_c is None else np.frombuffer(record.temperature_c, "<f8")
    require_valid(temperature_c is None or len(temperature_c) == n_legs, "temperatures of other legs")
    motion = None
    if record.motion is not None:
        motion = frame_from_arrays(LegMotion, _decode_arrays(record.motion, "motion", n_legs))
    cycle = Cycle(
        scan, record.started_commands, forces, record.ended_commands, reference, temperature_c, motion
    )
    return NumberedCycle(record.cycle_number, cycle)


_FIELDS = {"cycle": CYCLE_FIELDS, "gait": GAIT_FIELDS, "motion": MOTION_FIELDS}
_ArraysOf = Literal["cycle", "gait", "motion"]


@cache
def _layout(frame: _ArraysOf, n_legs: int) -> np.dtype[Any]:
    return np.dtype(
        [(path, field.dtype, (n_legs, *field.row_shape)) for path, field in _FIELDS[frame].items()]
    )


def _decode_arrays(data: bytes, frame: _ArraysOf, n_legs: int) -> Mapping[str, NDArray[Any]]:
    """Return the arrays in a binary field by their paths, after checking its length and codes."""
    layout = _layout(frame, n_legs)
    require_valid(len(data) == layout.itemsize, f"arrays of {len(data)} bytes")
    arrays: Mapping[str, NDArray[Any]] = np.frombuffer(data, dtype=layout)[0]
    for path, field in _FIELDS[frame].items():
        if field.max_code is not None:
            found = max(arrays[path].tobytes()) if field.dtype == "u1" else arrays[path].max()
            require_valid(found <= field.max_code, f"{path} {found}, at most {field.max_code} has a meaning")
    return arrays


def _decode_gait(record: _GaitRecord, n_legs: int) -> GaitFrame:
    return frame_from_arrays(
        GaitFrame,
        _decode_arrays(record.arrays, "gait", n_legs),
        t_ns=record.t_ns,
        friction=record.friction,
        all_in_air=record.all_in_air,
        events=record.events,
    )


def _decode_reference(times: bytes, forces: bytes, saturations: bytes) -> ReferenceSamples:
    t_ns, saturated = np.frombuffer(times, "<i8"), np.frombuffer(saturations, "u1")
    force_n = np.frombuffer(forces, "<f8").reshape(len(t_ns), 3)
    meant = len(saturated) == len(t_ns) and t_ns.min(initial=0) >= 0 and saturated.max(initial=0) <= 1
    require_valid(meant, "a sample of the reference has no such time or mark")
    return ReferenceSamples(t_ns, force_n, saturated.astype(np.bool_))
