"""ROS 2 messages of the legs as CDR bytes, with their topics: wrench, sigma, contact, events, diagnostics, loads.

A value that is not known is never a plausible number. A leg without a usable force sends no wrench, as a filter that
received NaN would not recover: its last stamp ages. Its contact state has the status unknown and NaN for the force.
Pose and velocity of the contact, and torque, are not measured: NaN, and for the torque of a usable force 0, since the
force acts at the foot's centre.
"""

import math
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

from footsense.frames import USABLE, BaselineStatus, Cause, GaitEventKind, State
from footsense.leg_words import LegPhase, phase_of, word_of
from footsense.ros2.store import CONTACT, DIAGNOSTICS, HEADER, LOW_STATE, PROBABILITY, SIGMA, STORE, WRENCH
from footsense.ros2.unitree import FEET, low_state

_DIAGNOSTICS_TOPIC = "/diagnostics"
_LOW_STATE_TOPIC = "/footsense/lowstate"
_DIAGNOSTICS_PERIOD_NS = 1_000_000_000
_NAN_VECTOR = (math.nan, math.nan, math.nan)
_CONTACT_TYPE_LOCOMOTION = 0
_UNKNOWN, _INACTIVE, _ACTIVE, _SLIPPING = range(4)
_OK, _WARN, _ERROR, _STALE = range(4)
#: Phases that end by themselves or were commanded.
_WARNING_PHASES = {LegPhase.DEGRADED, LegPhase.STARTING, LegPhase.TARING, LegPhase.STOPPED}


class LegSample(NamedTuple):
    """State, force and contact of one leg at one time, from a recording or from CAN.

    Attributes:
        leg: Name of the leg.
        foot_id: Identity of its foot; empty if unknown.
        is_new_force: Whether the force is another than that of the sample before.
        is_new_contact: Whether contact and ground are new, or there is a gait event.
        events: New events, with the time at which each happened, since 1970 [ns]; None if that is not known.
        t_wall_ns: Time of its newest reading, since 1970 [ns]; None without a usable force.
        state: Its state; None if the leg is silent.
        cause: Cause of the state; None if unknown.
        force_n: Ground reaction on the foot in the foot frame [N]; NaN unless usable.
        sigma_n: Standard deviation of each component [N]; NaN unless usable.
        fault_mask: Bit e set where element e is not usable or overloaded; None if unknown.
        age_ms: Age of the newest reading when the sample was taken [ms]; NaN unless usable.
        baseline_status: Status of the baseline tracking; None if unknown.
        contact: Debounced contact; None if unknown.
        contact_probability: Probability that the foot is on the ground [1]; NaN if unknown.
        holds: Probability that it stands still there [1]; NaN if unknown.
        ground_normal: Unit normal of the ground into the foot, foot frame; NaN if unknown.
        friction_coefficient: Coefficient of the ground's friction; NaN if unknown.
    """

    leg: str
    foot_id: str = ""
    is_new_force: bool = False
    is_new_contact: bool = False
    events: Sequence[tuple[GaitEventKind, int | None]] = ()
    t_wall_ns: int | None = None
    state: State | None = None
    cause: Cause | None = None
    force_n: Sequence[float] = _NAN_VECTOR
    sigma_n: Sequence[float] = _NAN_VECTOR
    fault_mask: int | None = None
    age_ms: float = math.nan
    baseline_status: BaselineStatus | None = None
    contact: bool | None = None
    contact_probability: float = math.nan
    holds: float = math.nan
    ground_normal: Sequence[float] = _NAN_VECTOR
    friction_coefficient: float = math.nan


class LegTopics:
    """Decides which ROS 2 messages of a robot's legs are due, and builds them.

    Args:
        legs: Names of the legs.

    Attributes:
        types: Type of the messages of each topic.
    """

    def __init__(self, legs: Sequence[str]) -> None:
        self._states: list[object] = []
        self._diagnosed_ns: int | None = None
        self.types: dict[str, str] = {}
        for leg in legs:
            topic = f"/footsense/{leg}"
            self.types |= {f"{topic}/wrench": WRENCH, f"{topic}/sigma": SIGMA, f"{topic}/contact": CONTACT}
            self.types |= {f"{topic}/contact_probability": PROBABILITY, f"{topic}/holds": PROBABILITY}
            self.types |= {f"{topic}/{kind.name.lower()}": HEADER for kind in GaitEventKind}
        self.types[_DIAGNOSTICS_TOPIC] = DIAGNOSTICS
        self._has_four_feet = set(legs) == set(FEET)
        if self._has_four_feet:
            self.types[_LOW_STATE_TOPIC] = LOW_STATE

    def due_messages(self, samples: Sequence[LegSample], t_ns: int) -> Iterator[tuple[str, bytes]]:
        """Yield the messages that are due: what is new of the legs, diagnostics once a second or changed.

        Args:
            samples: The legs.
            t_ns: The present time, since 1970 [ns].

        Yields:
            Topic, and CDR bytes with their header.
        """
        for sample in samples:
            if sample.is_new_force and sample.t_wall_ns is not None:
                header = _header(sample.t_wall_ns, _frame(sample.leg))
                stamped = _geometry("WrenchStamped", header, _wrench(sample))
                yield f"/footsense/{sample.leg}/wrench", _encode(stamped)
                sigma = _geometry("Vector3Stamped", header, _geometry("Vector3", *sample.sigma_n))
                yield f"/footsense/{sample.leg}/sigma", _encode(sigma)
                for name in ("contact_probability", "holds"):
                    probability = STORE.types[PROBABILITY](getattr(sample, name))
                    yield f"/footsense/{sample.leg}/{name}", _encode(probability)
            if sample.is_new_contact:
                yield f"/footsense/{sample.leg}/contact", _encode_contact(sample)
            for kind, event_ns in sample.events:
                topic = f"/footsense/{sample.leg}/{kind.name.lower()}"
                yield topic, _encode(_header(event_ns or 0, _frame(sample.leg)))
        loads_n = {sample.leg: sample.force_n[2] for sample in samples if sample.t_wall_ns is not None}
        if self._has_four_feet and any(sample.is_new_force and sample.leg in loads_n for sample in samples):
            yield _LOW_STATE_TOPIC, _encode(low_state(loads_n.get(leg, math.nan) for leg in FEET))
        states = [(sample.state, sample.cause) for sample in samples]
        last_ns = self._diagnosed_ns
        if last_ns is None or states != self._states or not 0 <= t_ns - last_ns < _DIAGNOSTICS_PERIOD_NS:
            self._states, self._diagnosed_ns = list(states), t_ns
            statuses = [_diagnostic_status(sample) for sample in samples]
            yield _DIAGNOSTICS_TOPIC, _encode(STORE.types[DIAGNOSTICS](_header(t_ns, ""), statuses))


def _frame(leg: str) -> str:
    """Return the name of a foot's frame: x forward, y left, z along the leg towards the body."""
    return f"{leg}_foot"


def _encode_contact(sample: LegSample) -> bytes:
    unknown = _geometry("Vector3", *_NAN_VECTOR)
    place = _geometry("Point", *_NAN_VECTOR), _geometry("Quaternion", *_NAN_VECTOR, math.nan)
    contact = STORE.types[CONTACT](
        name=_frame(sample.leg),
        type=_CONTACT_TYPE_LOCOMOTION,
        status=_contact_status(sample),
        pose=_geometry("Pose", *place),
        velocity=_geometry("Twist", unknown, unknown),
        wrench=_wrench(sample),
        surface_normal=_geometry("Vector3", *sample.ground_normal),
        friction_coefficient=sample.friction_coefficient,
    )
    return _encode(contact)


def _geometry(kind: str, *values: Any) -> Any:  # noqa: ANN401 - classes that rosbags makes of the definitions
    return STORE.types[f"geometry_msgs/msg/{kind}"](*values)


def _encode(message: Any) -> bytes:  # noqa: ANN401 - as above
    return bytes(STORE.serialize_cdr(message, message.__msgtype__, little_endian=True))


def _header(t_ns: int, frame: str) -> Any:  # noqa: ANN401 - as above
    stamp = STORE.types["builtin_interfaces/msg/Time"](*divmod(t_ns, 1_000_000_000))
    return STORE.types["std_msgs/msg/Header"](stamp, frame)


def _wrench(sample: LegSample) -> Any:  # noqa: ANN401 - as above
    torque = _NAN_VECTOR if sample.t_wall_ns is None else (0.0, 0.0, 0.0)
    return _geometry("Wrench", _geometry("Vector3", *sample.force_n), _geometry("Vector3", *torque))


def _contact_status(sample: LegSample) -> int:
    if sample.state not in USABLE or sample.contact is None:
        return _UNKNOWN
    if not sample.contact:
        return _INACTIVE
    # As of slips: where the ground's friction is known, and more likely than not of a foot on the ground.
    slips = math.isfinite(sample.friction_coefficient) and sample.holds < 0.5 * sample.contact_probability
    return _SLIPPING if slips else _ACTIVE


def _diagnostic_status(sample: LegSample) -> Any:  # noqa: ANN401 - as above
    state, cause = sample.state, sample.cause
    words = "no answer on CAN" if state is None else word_of(state)
    if cause:
        words += f": {word_of(cause)}"
    mask = sample.fault_mask
    elements = ["unknown"] if mask is None else [str(e) for e in range(mask.bit_length()) if mask >> e & 1]
    values = {
        "state": "unknown" if state is None else state.name,
        "cause": "unknown" if cause is None else cause.name,
        "elements_out": " ".join(elements),
        "age_ms": f"{sample.age_ms:.1f}",
        "baseline": "unknown" if sample.baseline_status is None else sample.baseline_status.name,
    }
    pairs = [STORE.types["diagnostic_msgs/msg/KeyValue"](*item) for item in values.items()]
    return STORE.types["diagnostic_msgs/msg/DiagnosticStatus"](
        _diagnostic_level(state), f"footsense: {sample.leg}", words, sample.foot_id, pairs
    )


def _diagnostic_level(state: State | None) -> int:
    if state is None or state is State.STALE:
        return _STALE
    if state is State.VALID:
        return _OK
    is_warning = state is State.OUT_OF_RANGE or phase_of(state) in _WARNING_PHASES
    return _WARN if is_warning else _ERROR
