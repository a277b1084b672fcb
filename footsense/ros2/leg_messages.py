"""ROS 2 messages of a leg: wrench, contact state, diagnostics.

A value that is not known is never a plausible number. A leg without a usable force sends no wrench, as a filter that
received NaN would not recover: its last stamp ages. Its contact state has the status unknown and NaN for the force.
Pose and velocity of the contact, and torque, are not measured: NaN, and for the torque of a usable force 0, since the
force acts at the foot's centre.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

from footsense.frames import USABLE, BaselineStatus, Cause, Slip, State
from footsense.leg_words import word_of
from footsense.ros2.messages import (
    ContactState,
    DiagnosticArray,
    DiagnosticStatus,
    Header,
    KeyValue,
    Point,
    Pose,
    Quaternion,
    Time,
    Twist,
    Vector3,
    Wrench,
    WrenchStamped,
)

_NAN_VECTOR = (math.nan, math.nan, math.nan)
_CONTACT_TYPE_LOCOMOTION = 0
_UNKNOWN, _INACTIVE, _ACTIVE, _SLIPPING = range(4)
_OK, _WARN, _ERROR, _STALE = range(4)
#: States that end by themselves or were commanded.
_WARNING_STATES = {
    State.DEGRADED,
    State.STARTING,
    State.NO_BASELINE,
    State.TARING,
    State.STOPPED,
    State.OUT_OF_RANGE,
}


class LegSample(NamedTuple):
    """State, force and contact of one leg at one time, from a recording or from CAN.

    Attributes:
        leg: Name of the leg.
        foot_id: Identity of its foot; empty if unknown.
        t_wall_ns: Time of its newest reading, since 1970 [ns]; None without a usable force.
        state: Its state; None if the leg is silent.
        cause: Cause of the state; None if unknown.
        force_n: Ground reaction on the foot in the foot frame [N]; NaN unless usable.
        sigma_n: Standard deviation of each component [N]; NaN unless usable.
        fault_mask: Bit e set where element e is not usable.
        age_ms: Age of the newest reading when the sample was taken [ms]; NaN unless usable.
        baseline_status: Status of the baseline tracking; None if unknown.
        contact: Debounced contact; None if unknown.
        slip: Whether the foot slides.
        ground_normal: Unit normal of the ground into the foot, foot frame; NaN if unknown.
        friction_coefficient: Coefficient of the ground's friction; NaN if unknown.
    """

    leg: str
    foot_id: str = ""
    t_wall_ns: int | None = None
    state: State | None = None
    cause: Cause | None = None
    force_n: tuple[float, float, float] = _NAN_VECTOR
    sigma_n: tuple[float, float, float] = _NAN_VECTOR
    fault_mask: int = 0
    age_ms: float = math.nan
    baseline_status: BaselineStatus | None = None
    contact: bool | None = None
    slip: Slip = Slip.UNKNOWN
    ground_normal: tuple[float, float, float] = _NAN_VECTOR
    friction_coefficient: float = math.nan


def wrench(sample: LegSample, frame: str) -> WrenchStamped | None:
    """Return a leg's force as a ROS 2 message, stamped with its newest reading's time; None without a usable force.

    Args:
        sample: The leg.
        frame: Name of the foot's frame.
    """
    if sample.t_wall_ns is None:
        return None
    return WrenchStamped(Header(Time.from_ns(sample.t_wall_ns), frame), _wrench(sample))


def contact_state(sample: LegSample, frame: str) -> ContactState:
    """Return a leg's contact as a ROS 2 message.

    Args:
        sample: The leg.
        frame: Name of the foot's frame, in which force and normal are given.
    """
    return ContactState(
        name=frame,
        type=_CONTACT_TYPE_LOCOMOTION,
        status=_contact_status(sample),
        pose=Pose(Point(), Quaternion()),
        velocity=Twist(Vector3(), Vector3()),
        wrench=_wrench(sample),
        surface_normal=Vector3(*sample.ground_normal),
        friction_coefficient=sample.friction_coefficient,
    )


def diagnostics(samples: Sequence[LegSample], t_ns: int) -> DiagnosticArray:
    """Return the states of all legs as a ROS 2 diagnostic message.

    Args:
        samples: The legs.
        t_ns: The present time, since 1970 [ns].
    """
    return DiagnosticArray(Header(Time.from_ns(t_ns), ""), [_diagnostic_status(sample) for sample in samples])


def _wrench(sample: LegSample) -> Wrench:
    torque = Vector3() if sample.t_wall_ns is None else Vector3(0.0, 0.0, 0.0)
    return Wrench(Vector3(*sample.force_n), torque)


def _contact_status(sample: LegSample) -> int:
    if sample.state not in USABLE or sample.contact is None:
        return _UNKNOWN
    if not sample.contact:
        return _INACTIVE
    return _SLIPPING if sample.slip is Slip.SLIPPING else _ACTIVE


def _diagnostic_status(sample: LegSample) -> DiagnosticStatus:
    state, cause = sample.state, sample.cause
    words = "no answer on CAN" if state is None else word_of(state)
    if cause:
        words += f": {word_of(cause)}"
    elements = [str(e) for e in range(sample.fault_mask.bit_length()) if sample.fault_mask >> e & 1]
    values = {
        "state": "unknown" if state is None else state.name,
        "cause": "unknown" if cause is None else cause.name,
        "elements_out": " ".join(elements),
        "age_ms": f"{sample.age_ms:.1f}",
        "sigma_n": " ".join(f"{sigma:.4f}" for sigma in sample.sigma_n),
        "baseline": "unknown" if sample.baseline_status is None else sample.baseline_status.name,
    }
    return DiagnosticStatus(
        _diagnostic_level(state),
        f"footsense: {sample.leg}",
        words,
        sample.foot_id,
        [KeyValue(*item) for item in values.items()],
    )


def _diagnostic_level(state: State | None) -> int:
    if state is None or state is State.STALE:
        return _STALE
    if state is State.VALID:
        return _OK
    return _WARN if state in _WARNING_STATES else _ERROR
