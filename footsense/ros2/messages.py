"""Dataclasses of the ROS 2 message types that are published, with ROS field names and types.

Source:
    The interface packages builtin_interfaces, std_msgs, geometry_msgs, diagnostic_msgs and tf2_msgs of ROS 2 Humble
    (equal in Jazzy), and ContactState of https://github.com/loco-3d/whole_body_state_msgs.
"""

from dataclasses import dataclass
from typing import Annotated

Byte = Annotated[int, "byte"]
UInt8 = Annotated[int, "uint8"]
Int32 = Annotated[int, "int32"]
UInt32 = Annotated[int, "uint32"]
Float64 = Annotated[float, "float64"]
String = Annotated[str, "string"]

_NAN = float("nan")
_NS_PER_S = 1_000_000_000


@dataclass(frozen=True, slots=True)
class Time:
    """ROS 2 time since 1970."""

    sec: Int32
    nanosec: UInt32

    @classmethod
    def from_ns(cls, t_ns: int) -> "Time":
        """Return the ROS 2 time of nanoseconds since 1970."""
        return cls(*divmod(t_ns, _NS_PER_S))


@dataclass(frozen=True, slots=True)
class Header:
    """Time stamp and frame of a message."""

    stamp: Time
    frame_id: String


@dataclass(frozen=True, slots=True)
class Vector3:
    """3D vector; every component NaN if unknown."""

    x: Float64 = _NAN
    y: Float64 = _NAN
    z: Float64 = _NAN


@dataclass(frozen=True, slots=True)
class Point(Vector3):
    """Position [m]."""


@dataclass(frozen=True, slots=True)
class Quaternion:
    """Rotation as a quaternion."""

    x: Float64 = _NAN
    y: Float64 = _NAN
    z: Float64 = _NAN
    w: Float64 = _NAN


@dataclass(frozen=True, slots=True)
class Pose:
    """Position and orientation."""

    position: Point
    orientation: Quaternion


@dataclass(frozen=True, slots=True)
class Twist:
    """Linear velocity [m/s] and angular velocity [rad/s]."""

    linear: Vector3
    angular: Vector3


@dataclass(frozen=True, slots=True)
class Wrench:
    """Force [N] and torque [Nm]."""

    force: Vector3
    torque: Vector3


@dataclass(frozen=True, slots=True)
class WrenchStamped:
    """Force and torque, with time stamp and frame."""

    header: Header
    wrench: Wrench


@dataclass(frozen=True, slots=True)
class Transform:
    """Translation [m] and rotation."""

    translation: Vector3
    rotation: Quaternion


@dataclass(frozen=True, slots=True)
class TransformStamped:
    """Pose of a child frame in the frame of the header, with time stamp."""

    header: Header
    child_frame_id: String
    transform: Transform


@dataclass(frozen=True, slots=True)
class TFMessage:
    """List of coordinate transforms."""

    transforms: list[TransformStamped]


@dataclass(frozen=True, slots=True)
class KeyValue:
    """Named value of a diagnostic status."""

    key: String
    value: String


@dataclass(frozen=True, slots=True)
class DiagnosticStatus:
    """Health of one component: level 0 OK, 1 warning, 2 error, 3 stale."""

    level: Byte
    name: String
    message: String
    hardware_id: String
    values: list[KeyValue]


@dataclass(frozen=True, slots=True)
class DiagnosticArray:
    """Health of several components at one time."""

    header: Header
    status: list[DiagnosticStatus]


@dataclass(frozen=True, slots=True)
class ContactState:
    """Contact of a foot: type 0 locomotion; status 0 unknown, 1 inactive, 2 active, 3 slipping."""

    name: String
    type: UInt8
    status: UInt8
    pose: Pose
    velocity: Twist
    wrench: Wrench
    surface_normal: Vector3
    friction_coefficient: Float64


Message = WrenchStamped | ContactState | DiagnosticArray | TFMessage

#: The package of each type.
ROS_PACKAGE_OF_TYPE: dict[type, str] = {
    Time: "builtin_interfaces",
    Header: "std_msgs",
    **dict.fromkeys(
        (Vector3, Point, Quaternion, Pose, Twist, Wrench, WrenchStamped, Transform, TransformStamped),
        "geometry_msgs",
    ),
    TFMessage: "tf2_msgs",
    **dict.fromkeys((KeyValue, DiagnosticStatus, DiagnosticArray), "diagnostic_msgs"),
    ContactState: "whole_body_state_msgs",
}
