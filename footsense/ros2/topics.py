"""ROS 2 topics of the robot's legs, and the coordinate frames of the feet."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, NamedTuple

import msgspec

from footsense import strict_yaml
from footsense.frames import ALL_LEGS
from footsense.ros2.leg_messages import LegSample, contact_state, diagnostics, wrench
from footsense.ros2.messages import (
    ContactState,
    DiagnosticArray,
    Header,
    Message,
    Quaternion,
    TFMessage,
    Time,
    Transform,
    TransformStamped,
    Vector3,
    WrenchStamped,
)

#: Period of the health of all legs [ns].
DIAGNOSTICS_PERIOD_NS = 1_000_000_000

DIAGNOSTICS, TF_STATIC = "/diagnostics", "/tf_static"

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


class TopicMessage(NamedTuple):
    """ROS 2 message with the topic on which it is published."""

    topic: str
    message: Message


class TopicMessageBuilder:
    """Builds the ROS 2 messages of a robot's legs, with their topics.

    Args:
        legs: Names of the legs.
        frames: Frames of the feet that are not named `<leg>_foot`.
    """

    def __init__(self, legs: Sequence[str], frames: dict[str, FootFrame] | None = None) -> None:
        self._frames = {leg: FootFrame(f"{leg}_foot") for leg in legs} | (frames or {})
        self.types: dict[str, type] = {}
        for leg in legs:
            self.types |= {
                f"/footsense/{leg}/wrench": WrenchStamped,
                f"/footsense/{leg}/contact": ContactState,
            }
        self.types[DIAGNOSTICS] = DiagnosticArray
        if any(frame.parent for frame in self._frames.values()):
            self.types[TF_STATIC] = TFMessage

    def wrench(self, sample: LegSample) -> list[TopicMessage]:
        """Return the message of a leg's force; an empty list without a usable force."""
        message = wrench(sample, self._frames[sample.leg].frame)
        return [] if message is None else [TopicMessage(f"/footsense/{sample.leg}/wrench", message)]

    def contact(self, sample: LegSample) -> TopicMessage:
        """Return the message of a leg's contact."""
        message = contact_state(sample, self._frames[sample.leg].frame)
        return TopicMessage(f"/footsense/{sample.leg}/contact", message)

    @staticmethod
    def diagnostics(samples: Sequence[LegSample], t_ns: int) -> TopicMessage:
        """Return the diagnostic message of all legs."""
        return TopicMessage(DIAGNOSTICS, diagnostics(samples, t_ns))

    def transforms(self, t_ns: int) -> list[TopicMessage]:
        """Return the message of the feet's poses; an empty list if no frame has a parent."""
        stamp = Time.from_ns(t_ns)
        transforms = [
            TransformStamped(
                Header(stamp, foot.parent),
                foot.frame,
                Transform(Vector3(*foot.xyz_m), Quaternion(*foot.quaternion_xyzw)),
            )
            for foot in self._frames.values()
            if foot.parent is not None
        ]
        return [TopicMessage(TF_STATIC, TFMessage(transforms))] if transforms else []


def load_foot_frames(path: Path) -> dict[str, FootFrame]:
    """Return the coordinate frames of the feet from a YAML file, by leg.

    Raises:
        ConfigError: The file is missing or wrong; the message names the line.
    """
    return strict_yaml.load(path, dict[str, FootFrame], check=_first_frame_problem)


def _first_frame_problem(frames: dict[str, FootFrame]) -> strict_yaml.Problem | None:
    for leg, foot in frames.items():
        if leg not in ALL_LEGS:
            return strict_yaml.Problem(leg, f"is no leg; there are {', '.join(ALL_LEGS)}")
        length = sum(part * part for part in foot.quaternion_xyzw) ** 0.5
        if abs(length - 1) > 1e-3:
            return strict_yaml.Problem(f"{leg}.quaternion_xyzw", f"has the length {length:.3f}, not 1")
    return None
