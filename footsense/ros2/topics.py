"""ROS 2 topics of the robot's legs: which messages are due, and the coordinate frames of the feet."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from footsense import strict_yaml
from footsense.frames import ALL_LEGS
from footsense.ros2.messages import (
    CONTACT,
    DIAGNOSTICS,
    TRANSFORMS,
    WRENCH,
    FootFrame,
    LegSample,
    encode_contact,
    encode_diagnostics,
    encode_transforms,
    encode_wrench,
)

TF_STATIC = "/tf_static"
_DIAGNOSTICS_TOPIC = "/diagnostics"
_DIAGNOSTICS_PERIOD_NS = 1_000_000_000


class TopicMessage(NamedTuple):
    """ROS 2 message with the topic on which it is published.

    Attributes:
        topic: The topic.
        cdr: The message as CDR bytes, with their header.
    """

    topic: str
    cdr: bytes


class LegTopics:
    """Decides which ROS 2 messages of a robot's legs are due, and builds them.

    Args:
        legs: Names of the legs.
        frames: Frames of the feet that are not named `<leg>_foot`.

    Attributes:
        types: Type of the messages of each topic.
    """

    def __init__(self, legs: Sequence[str], frames: dict[str, FootFrame] | None = None) -> None:
        self._frames = {leg: FootFrame(f"{leg}_foot") for leg in legs} | (frames or {})
        self._fixed = [frame for frame in self._frames.values() if frame.parent is not None]
        self._states: list[object] = []
        self._diagnosed_ns: int | None = None
        self.types: dict[str, str] = {}
        for leg in legs:
            self.types |= {f"/footsense/{leg}/wrench": WRENCH, f"/footsense/{leg}/contact": CONTACT}
        self.types[_DIAGNOSTICS_TOPIC] = DIAGNOSTICS
        if self._fixed:
            self.types[TF_STATIC] = TRANSFORMS

    def due_messages(self, samples: Sequence[LegSample], t_ns: int) -> Iterator[TopicMessage]:
        """Yield the messages that are due: forces and contacts that are new, diagnostics that changed or once a second.

        Args:
            samples: The legs.
            t_ns: The present time, since 1970 [ns].

        Yields:
            Each message; the poses of the feet before the others, once.
        """
        if self._diagnosed_ns is None and self._fixed:
            yield TopicMessage(TF_STATIC, encode_transforms(self._fixed, t_ns))
        for sample in samples:
            leg, frame = sample.leg, self._frames[sample.leg].frame
            if sample.is_new_force and (wrench := encode_wrench(sample, frame)):
                yield TopicMessage(f"/footsense/{leg}/wrench", wrench)
            if sample.is_new_contact:
                yield TopicMessage(f"/footsense/{leg}/contact", encode_contact(sample, frame))
        states = [(sample.state, sample.cause) for sample in samples]
        last_ns = self._diagnosed_ns
        if last_ns is None or states != self._states or not 0 <= t_ns - last_ns < _DIAGNOSTICS_PERIOD_NS:
            self._states, self._diagnosed_ns = list(states), t_ns
            yield TopicMessage(_DIAGNOSTICS_TOPIC, encode_diagnostics(samples, t_ns))


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
