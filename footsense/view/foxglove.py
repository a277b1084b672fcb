"""Live cycles for Foxglove, Lichtblick and PlotJuggler, by Foxglove's SDK; needs the extra `foxglove`.

The topics of a recording, with its messages and schemas, and in Foxglove's own schemas the forces as arrows, the gap
closures as grids and the poses of the feet. The feet stand where they do in the page's picture, not where the robot
puts them: their places are not known here.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import foxglove.messages as fox
import numpy as np
from foxglove import Channel, Context, Schema, StatusLevel, set_log_level, start_server
from foxglove.channels import FrameTransformsChannel, GridChannel, SceneUpdateChannel

from footsense import __version__
from footsense.frames import State, Vector
from footsense.leg_words import LegPhase, phase_of, word_of
from footsense.recording import messages
from footsense.view.live import LiveSource, ViewedCycle
from footsense.view.signals import CLOSURE_COLUMNS, Table

#: Cycles at most that are handed to the SDK at once, if this process was held up.
_MAX_LAG_CYCLES = 128
#: Messages that the SDK keeps for a slow client; then it drops the oldest.
_BACKLOG_MESSAGES = 512
#: Least time between two pictures of the scene [ns]: 30 in a second.
_PICTURE_INTERVAL_NS = 33_000_000
#: Frame of the feet, and place of each in it [m]: x forward, y left.
_ROBOT_FRAME = "robot"
DISPLAYED_FOOT_POSITIONS_M = {
    side + place: (x_m, y_m, 0.0)
    for side, y_m in (("l", 0.15), ("r", -0.15))
    for place, x_m in (("f", 0.2), ("m", 0.0), ("r", -0.2), ("4", -0.4))
}
#: Length of the arrow of a newton, height of a label, and side of a foot's grid [m].
_ARROW_M_PER_N = 0.1
_LABEL_HEIGHT_M = 0.02
_GRID_SIDE_M = 0.06
_PHASE_COLOURS = {
    LegPhase.VALID: (0.06, 0.49, 0.54),
    LegPhase.DEGRADED: (0.89, 0.6, 0.1),
    LegPhase.TARING: (0.89, 0.6, 0.1),
    LegPhase.STARTING: (0.89, 0.6, 0.1),
}
_FAULT_COLOUR = (0.75, 0.15, 0.1)


class _Topic(NamedTuple):
    """Channel of the SDK, and the function that returns its messages of a cycle."""

    channel: Any
    messages: Callable[[ViewedCycle], Sequence[Any]]
    is_picture: bool = False


class FoxgloveFeed:
    """Feeds a server of Foxglove's SDK on the loopback with the live cycles.

    Args:
        live: The followed service.

    Attributes:
        port: TCP port of the SDK's server.
    """

    def __init__(self, live: LiveSource) -> None:
        set_log_level("ERROR")
        self._live = live
        self._context = Context()
        self._server = start_server(
            name=f"footsense {__version__}",
            host="127.0.0.1",
            port=0,
            capabilities=[],
            context=self._context,
            message_backlog_size=_BACKLOG_MESSAGES,
        )
        self.port = self._server.port
        self._service = 0
        self._topics: list[_Topic] = []
        self._next = 0
        self._picture_ns = 0

    def publish(self) -> None:
        """Hand the cycles that are new to the SDK, as far as a client has subscribed; without a service, say so."""
        live = self._live
        if live.service != self._service:
            self._service, self._next = live.service, 0
            for topic in self._topics:
                topic.channel.close()
            self._topics = [*self._recording_topics(), *self._picture_topics()]
        new = live.cycles_since(self._next, _MAX_LAG_CYCLES)
        if new:
            self._next = new[-1].number + 1
        subscribed = [topic for topic in self._topics if topic.channel.has_sinks()]
        for viewed in new if subscribed else ():
            t_ns = viewed.cycle.forces.t_sent_ns
            is_picture_due = not 0 <= t_ns - self._picture_ns < _PICTURE_INTERVAL_NS
            if is_picture_due:
                self._picture_ns = t_ns
            for topic in subscribed:
                if is_picture_due or not topic.is_picture:
                    for message in topic.messages(viewed):
                        topic.channel.log(message, log_time=t_ns)

    def tell_problem(self) -> None:
        """Tell the clients why no cycles come, or that they come."""
        if self._live.problem:
            self._server.publish_status(self._live.problem, StatusLevel.Warning, id="service")
        else:
            self._server.remove_status(["service"])

    def close(self) -> None:
        """Stop the server."""
        self._server.stop()

    def _recording_topics(self) -> list[_Topic]:
        """Return the topics that a recording has, with the same messages and schemas."""
        legs = self._live.legs
        topics = []
        for topic, definition in messages.topic_schemas(legs).items():
            schema = Schema(name=f"footsense.{topic[1:]}", encoding="jsonschema", data=definition)
            channel = Channel(topic, message_encoding="json", schema=schema, context=self._context)

            def encoded(viewed: ViewedCycle, topic: str = topic) -> list[bytes]:
                return [data for _, data in messages.ENCODERS[topic](viewed.cycle, legs)]

            topics.append(_Topic(channel, encoded))
        return topics

    def _picture_topics(self) -> list[_Topic]:
        """Return the topics with Foxglove's own schemas: force arrows, closure grids, foot poses."""
        legs = self._live.legs
        scene = SceneUpdateChannel("/feet", context=self._context)
        poses = FrameTransformsChannel("/tf", context=self._context)
        topics = [
            _Topic(scene, lambda viewed: [_scene(viewed, legs)], is_picture=True),
            _Topic(poses, lambda viewed: [_foot_poses(viewed, legs)], is_picture=True),
        ]
        for row, leg in enumerate(legs):
            grids = GridChannel(f"/closure/{leg}", context=self._context)

            def grid(viewed: ViewedCycle, row: int = row, leg: str = leg) -> list[fox.Grid]:
                return [_closure_grid(viewed.table[row, CLOSURE_COLUMNS], leg, _stamp(viewed))]

            topics.append(_Topic(grids, grid, is_picture=True))
        return topics


def _scene(viewed: ViewedCycle, legs: Sequence[str]) -> fox.SceneUpdate:
    """Return an arrow for the force on each foot, and a label with name and state."""
    forces, stamp = viewed.cycle.forces, _stamp(viewed)
    entities = []
    for row, leg in enumerate(legs):
        state, force_n = State(int(forces.state[row])), forces.force_n[row]
        red, green, blue = _PHASE_COLOURS.get(phase_of(state), _FAULT_COLOUR)
        colour = fox.Color(r=red, g=green, b=blue, a=1.0)
        is_known = bool(np.isfinite(force_n).all())
        label = fox.TextPrimitive(
            pose=_pose(leg, above_m=_LABEL_HEIGHT_M),
            billboard=True,
            font_size=14.0,
            scale_invariant=True,
            color=colour,
            text=f"{leg} {force_n[2]:.2f} N" if is_known else f"{leg} {word_of(state)}",
        )
        entity = fox.SceneEntity(
            timestamp=stamp,
            frame_id=_ROBOT_FRAME,
            id=leg,
            lifetime=fox.Duration(1),
            arrows=[_arrow(leg, force_n, colour)] if is_known and force_n.any() else [],
            texts=[label],
        )
        entities.append(entity)
    return fox.SceneUpdate(entities=entities)


def _arrow(leg: str, force_n: Vector, colour: fox.Color) -> fox.ArrowPrimitive:
    length_m = max(float(np.linalg.norm(force_n)) * _ARROW_M_PER_N, 1e-6)
    x, y, z, w = orientation(force_n)
    return fox.ArrowPrimitive(
        pose=_pose(leg, fox.Quaternion(x=x, y=y, z=z, w=w)),
        shaft_length=0.8 * length_m,
        shaft_diameter=0.006,
        head_length=0.2 * length_m,
        head_diameter=0.015,
        color=colour,
    )


def orientation(direction: Vector) -> tuple[float, float, float, float]:
    """Return the quaternion x, y, z, w that rotates the x axis to a direction, shape (3,), not zero.

    Example:
        >>> [round(part, 3) for part in orientation(np.array([0.0, 0.0, 2.0]))]
        [0.0, -0.707, 0.0, 0.707]
    """
    x, y, z = (direction / np.linalg.norm(direction)).tolist()
    if x >= 0.0:
        w = math.sqrt((1.0 + x) / 2.0)
        return 0.0, -z / (2.0 * w), y / (2.0 * w), w
    # Half the angle from 1 - x and from the distance to the axis: 1 + x would cancel near -1, and squares underflow.
    across, sine = math.hypot(y, z), math.sqrt((1.0 - x) / 2.0)
    if across == 0.0:
        return 0.0, 0.0, 1.0, 0.0
    return 0.0, -sine * (z / across), sine * (y / across), across / (2.0 * sine)


def _closure_grid(closure_rel: Table, leg: str, stamp: fox.Timestamp) -> fox.Grid:
    """Return a foot's closures over the gap [1], shape (9,); NaN where unknown.

    A grid's columns go along x, forward, and its rows along y, to the left; ours run the other way.
    """
    cells = closure_rel.reshape(3, 3)[::-1, ::-1].T.astype("<f4")
    x_m, y_m, z_m = DISPLAYED_FOOT_POSITIONS_M[leg]
    corner = fox.Vector3(x=x_m - _GRID_SIDE_M / 2, y=y_m - _GRID_SIDE_M / 2, z=z_m)
    return fox.Grid(
        timestamp=stamp,
        frame_id=_ROBOT_FRAME,
        pose=fox.Pose(position=corner, orientation=fox.Quaternion(w=1.0)),
        column_count=3,
        cell_size=fox.Vector2(x=_GRID_SIDE_M / 3, y=_GRID_SIDE_M / 3),
        row_stride=12,
        cell_stride=4,
        fields=[fox.PackedElementField(name="closure", type=fox.PackedElementFieldNumericType.Float32)],
        data=cells.tobytes(),
    )


def _foot_poses(viewed: ViewedCycle, legs: Sequence[str]) -> fox.FrameTransforms:
    return fox.FrameTransforms(
        transforms=[
            fox.FrameTransform(
                timestamp=_stamp(viewed),
                parent_frame_id=_ROBOT_FRAME,
                child_frame_id=leg,
                translation=_position(leg),
                rotation=fox.Quaternion(w=1.0),
            )
            for leg in legs
        ]
    )


def _position(leg: str, above_m: float = 0.0) -> fox.Vector3:
    x_m, y_m, z_m = DISPLAYED_FOOT_POSITIONS_M[leg]
    return fox.Vector3(x=x_m, y=y_m, z=z_m + above_m)


def _pose(leg: str, rotation: fox.Quaternion | None = None, above_m: float = 0.0) -> fox.Pose:
    return fox.Pose(position=_position(leg, above_m), orientation=rotation or fox.Quaternion(w=1.0))


def _stamp(viewed: ViewedCycle) -> fox.Timestamp:
    return fox.Timestamp(*divmod(viewed.cycle.forces.t_sent_ns, 1_000_000_000))
