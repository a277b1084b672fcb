"""ROS 2 messages of the legs as CDR bytes: wrench, contact state, diagnostics, poses of the feet.

A value that is not known is never a plausible number. A leg without a usable force sends no wrench, as a filter that
received NaN would not recover: its last stamp ages. Its contact state has the status unknown and NaN for the force.
Pose and velocity of the contact, and torque, are not measured: NaN, and for the torque of a usable force 0, since the
force acts at the foot's centre.

Source:
    The interface packages of ROS 2 Humble (equal in Jazzy), which rosbags carries, and ContactState of
    https://github.com/loco-3d/whole_body_state_msgs.
"""

import math
from collections.abc import Iterable, Sequence
from typing import Annotated, Any, NamedTuple

import msgspec
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from footsense.frames import USABLE, BaselineStatus, Cause, Slip, State
from footsense.leg_words import word_of

WRENCH = "geometry_msgs/msg/WrenchStamped"
CONTACT = "whole_body_state_msgs/msg/ContactState"
DIAGNOSTICS = "diagnostic_msgs/msg/DiagnosticArray"
TRANSFORMS = "tf2_msgs/msg/TFMessage"

#: ROS itself does not have this type.
_CONTACT_DEFINITION = """\
string name
uint8 type
uint8 status
geometry_msgs/Pose pose
geometry_msgs/Twist velocity
geometry_msgs/Wrench wrench
geometry_msgs/Vector3 surface_normal
float64 friction_coefficient
"""
#: All types, with their definitions, hashes and bytes.
STORE = get_typestore(Stores.ROS2_HUMBLE)
STORE.register(get_types_from_msg(_CONTACT_DEFINITION, CONTACT))

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


_Metres = Annotated[float, msgspec.Meta(ge=-100, le=100, description="-100 to 100 m")]
_QuaternionComponent = Annotated[float, msgspec.Meta(ge=-1, le=1, description="-1 to 1")]


class FootFrame(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Coordinate frame of a foot on the robot: name, parent frame, position, rotation.

    Attributes:
        frame: Name of the foot's frame.
        parent: Name of the link that it is fixed to; None: the frame is published elsewhere.
        xyz_m: Position of the foot's centre in the parent [m].
        quaternion_xyzw: Orientation of the foot's frame in the parent; of length 1.
    """

    frame: str
    parent: str | None = None
    xyz_m: tuple[_Metres, _Metres, _Metres] = (0.0, 0.0, 0.0)
    quaternion_xyzw: tuple[
        _QuaternionComponent, _QuaternionComponent, _QuaternionComponent, _QuaternionComponent
    ] = (0.0, 0.0, 0.0, 1.0)


class LegSample(NamedTuple):
    """State, force and contact of one leg at one time, from a recording or from CAN.

    Attributes:
        leg: Name of the leg.
        foot_id: Identity of its foot; empty if unknown.
        is_new_force: Whether the force is another than that of the sample before.
        is_new_contact: Whether contact and ground have just been told, or a gait event.
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
    is_new_force: bool = False
    is_new_contact: bool = False
    t_wall_ns: int | None = None
    state: State | None = None
    cause: Cause | None = None
    force_n: Sequence[float] = _NAN_VECTOR
    sigma_n: Sequence[float] = _NAN_VECTOR
    fault_mask: int = 0
    age_ms: float = math.nan
    baseline_status: BaselineStatus | None = None
    contact: bool | None = None
    slip: Slip = Slip.UNKNOWN
    ground_normal: Sequence[float] = _NAN_VECTOR
    friction_coefficient: float = math.nan


def encode_wrench(sample: LegSample, frame: str) -> bytes | None:
    """Return a leg's force as a message, stamped with its newest reading's time; None without a usable force.

    Args:
        sample: The leg.
        frame: Name of the foot's frame.
    """
    if sample.t_wall_ns is None:
        return None
    return _encode(_new(WRENCH, _header(sample.t_wall_ns, frame), _wrench(sample)))


def encode_contact(sample: LegSample, frame: str) -> bytes:
    """Return a leg's contact as a message; arguments as of `encode_wrench`."""
    unknown = _vector(_NAN_VECTOR)
    pose = _new(
        "geometry_msgs/msg/Pose",
        _new("geometry_msgs/msg/Point", *_NAN_VECTOR),
        _new("geometry_msgs/msg/Quaternion", *_NAN_VECTOR, math.nan),
    )
    return _encode(
        _new(
            CONTACT,
            frame,
            _CONTACT_TYPE_LOCOMOTION,
            _contact_status(sample),
            pose,
            _new("geometry_msgs/msg/Twist", unknown, unknown),
            _wrench(sample),
            _vector(sample.ground_normal),
            sample.friction_coefficient,
        )
    )


def encode_diagnostics(samples: Iterable[LegSample], t_ns: int) -> bytes:
    """Return the states of all legs as a message.

    Args:
        samples: The legs.
        t_ns: The present time, since 1970 [ns].
    """
    return _encode(_new(DIAGNOSTICS, _header(t_ns, ""), [_diagnostic_status(sample) for sample in samples]))


def encode_transforms(frames: Iterable[FootFrame], t_ns: int) -> bytes:
    """Return the poses of feet that are fixed to a parent as a message.

    Args:
        frames: Their frames.
        t_ns: The present time, since 1970 [ns].
    """
    transforms = [
        _new(
            "geometry_msgs/msg/TransformStamped",
            _header(t_ns, foot.parent),
            foot.frame,
            _new(
                "geometry_msgs/msg/Transform",
                _vector(foot.xyz_m),
                _new("geometry_msgs/msg/Quaternion", *foot.quaternion_xyzw),
            ),
        )
        for foot in frames
    ]
    return _encode(_new(TRANSFORMS, transforms))


def _new(kind: str, *values: Any) -> Any:  # noqa: ANN401 - classes that rosbags makes of the definitions
    return STORE.types[kind](*values)


def _encode(message: Any) -> bytes:  # noqa: ANN401 - as above
    return bytes(STORE.serialize_cdr(message, message.__msgtype__, little_endian=True))


def _header(t_ns: int, frame: str | None) -> Any:  # noqa: ANN401 - as above
    stamp = _new("builtin_interfaces/msg/Time", *divmod(t_ns, 1_000_000_000))
    return _new("std_msgs/msg/Header", stamp, frame)


def _vector(xyz: Sequence[float]) -> Any:  # noqa: ANN401 - as above
    return _new("geometry_msgs/msg/Vector3", *xyz)


def _wrench(sample: LegSample) -> Any:  # noqa: ANN401 - as above
    torque = _NAN_VECTOR if sample.t_wall_ns is None else (0.0, 0.0, 0.0)
    return _new("geometry_msgs/msg/Wrench", _vector(sample.force_n), _vector(torque))


def _contact_status(sample: LegSample) -> int:
    if sample.state not in USABLE or sample.contact is None:
        return _UNKNOWN
    if not sample.contact:
        return _INACTIVE
    return _SLIPPING if sample.slip is Slip.SLIPPING else _ACTIVE


def _diagnostic_status(sample: LegSample) -> Any:  # noqa: ANN401 - as above
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
    return _new(
        "diagnostic_msgs/msg/DiagnosticStatus",
        _diagnostic_level(state),
        f"footsense: {sample.leg}",
        words,
        sample.foot_id,
        [_new("diagnostic_msgs/msg/KeyValue", *item) for item in values.items()],
    )


def _diagnostic_level(state: State | None) -> int:
    if state is None or state is State.STALE:
        return _STALE
    if state is State.VALID:
        return _OK
    return _WARN if state in _WARNING_STATES else _ERROR
