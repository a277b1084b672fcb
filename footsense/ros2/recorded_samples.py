"""Samples of the legs from a recording, for ROS 2 messages, in wall-clock time."""

from collections.abc import Iterator
from datetime import datetime
from typing import NamedTuple

from footsense.errors import RecordingError
from footsense.frames import USABLE, BaselineStatus, Cause, ContactFrame, GaitFrame, Slip, State
from footsense.recording.cycle_fields import CAUSE_NOT_RECORDED
from footsense.recording.replay import Replay
from footsense.ros2.leg_messages import LegSample

_NS_PER_S = 1_000_000_000


class RecordedCycleSamples(NamedTuple):
    """Samples of all legs in one recorded cycle.

    Attributes:
        t_sent_wall_ns: Time of sending, since 1970 [ns].
        samples: The legs.
        has_gait: Whether the cycle has the contact of the legs.
    """

    t_sent_wall_ns: int
    samples: list[LegSample]
    has_gait: bool


def recorded_samples(replay: Replay) -> Iterator[RecordedCycleSamples]:
    """Yield the samples of all legs for each cycle of a recording.

    Args:
        replay: The recording.

    Yields:
        Each whole cycle.

    Raises:
        RecordingError: The rest of the file is cut off or damaged.
    """
    offset_ns: int | None = None
    feet = dict(pair.split("=", 1) for pair in replay.header.get("feet", "").split(",") if "=" in pair)
    for cycle in replay:
        forces = cycle.forces
        if offset_ns is None:
            offset_ns = _wall_offset_ns(replay, forces.t_sent_ns)
        samples = [_leg_sample(forces, row, leg, feet, offset_ns) for row, leg in enumerate(replay.legs)]
        yield RecordedCycleSamples(forces.t_sent_ns + offset_ns, samples, forces.gait is not None)


def _wall_offset_ns(replay: Replay, t_first_ns: int) -> int:
    """Return wall-clock time minus recorded time [ns], from the header's start time and the first cycle.

    Raises:
        RecordingError: The header's times are not times.
    """
    try:
        if (text := replay.header.get("wall_offset_ns")) is not None:
            return int(text)
        started = datetime.fromisoformat(replay.header.get("started", "1970-01-01T00:00:00Z"))
        return int(started.timestamp()) * _NS_PER_S - t_first_ns
    except ValueError as error:
        raise RecordingError(f"{replay.path}: the header's time of start: {error}") from None


def _leg_sample(forces: ContactFrame, row: int, leg: str, feet: dict[str, str], offset_ns: int) -> LegSample:
    state, cause = State(int(forces.state[row])), int(forces.cause[row])
    usable = state in USABLE
    sample = LegSample(
        leg=leg,
        foot_id=feet.get(leg, ""),
        state=state,
        cause=None if cause == CAUSE_NOT_RECORDED else Cause(cause),
        fault_mask=int(forces.fault_mask[row]),
        baseline_status=BaselineStatus(int(forces.baseline.status[row])),
    )
    if usable:
        sample = sample._replace(
            t_wall_ns=int(forces.t_ns[row]) + offset_ns,
            force_n=tuple(forces.force_n[row].tolist()),
            sigma_n=tuple(forces.sigma_n[row].tolist()),
            age_ms=float(forces.age_ns[row]) * 1e-6,
        )
    return sample if forces.gait is None else _with_gait(sample, forces.gait, row)


def _with_gait(sample: LegSample, gait: GaitFrame, row: int) -> LegSample:
    return sample._replace(
        contact=bool(gait.contact[row]),
        slip=Slip(int(gait.slip[row])),
        ground_normal=tuple(gait.normal[row].tolist()),
        friction_coefficient=gait.friction,
    )
