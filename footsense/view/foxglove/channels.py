"""Topics offered by Foxglove's protocol: names, schemas, and the messages of each cycle."""

import json
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from importlib.resources import files
from typing import Any, NamedTuple

import numpy as np

from footsense.recording.container import event_messages, messages
from footsense.view.foxglove.scene import closure_grid, foot_transforms, scene_update
from footsense.view.live import ViewedCycle
from footsense.view.signals import CLOSURE_COLUMNS

#: Least time between two pictures of the scene [ns]: 30 in a second.
MIN_SCENE_INTERVAL_NS = 33_000_000


class TopicChannel(NamedTuple):
    """One topic of Foxglove's protocol: name, schema, and encoder of its messages.

    Attributes:
        topic: Its name.
        schema_name: Name of its schema.
        schema: Its JSON schema.
        messages: Returns the messages of a cycle on it.
        is_rate_limited: Whether a few messages a second are enough.
    """

    topic: str
    schema_name: str
    schema: str
    messages: Callable[[ViewedCycle], list[bytes]]
    is_rate_limited: bool = False


def topic_channels(legs: Sequence[str], n_elements: int) -> list[TopicChannel]:
    """Return the topics of a robot: those of a recording first, then the picture topics."""
    return [*_recording_channels(legs, n_elements), *_scene_channels(legs)]


def _recording_channels(legs: Sequence[str], n_elements: int) -> Iterator[TopicChannel]:
    """Yield the topics that a recording has, with the same messages and schemas."""
    encoders: dict[str, Callable[[ViewedCycle], list[bytes]]] = {
        messages.SCAN: lambda viewed: [messages.encode_scan(viewed.cycle.scan, legs)],
        messages.FORCE: lambda viewed: [messages.encode_force(viewed.cycle.forces, legs)],
        messages.GAIT: lambda viewed: _gait_messages(viewed, legs),
        messages.GAIT_EVENT: lambda viewed: _gait_event_messages(viewed, legs),
        messages.EVENT: lambda viewed: _event_messages(viewed, legs),
    }
    for topic, schema in messages.topic_schemas(legs, n_elements).items():
        yield TopicChannel(topic, f"footsense.{topic[1:]}", schema.decode(), encoders[topic])


def _gait_messages(viewed: ViewedCycle, legs: Sequence[str]) -> list[bytes]:
    gait = viewed.cycle.forces.gait
    return [] if gait is None else [event_messages.encode_gait(gait, legs)]


def _gait_event_messages(viewed: ViewedCycle, legs: Sequence[str]) -> list[bytes]:
    gait = viewed.cycle.forces.gait
    return [] if gait is None else event_messages.encode_gait_events(gait, legs)


def _event_messages(viewed: ViewedCycle, legs: Sequence[str]) -> list[bytes]:
    cycle = viewed.cycle
    found = [event_messages.command_event(command, legs) for command in cycle.started_commands]
    found += [event_messages.outcome_event(outcome, legs) for outcome in cycle.ended_commands]
    if cycle.temperature_c is not None:
        found.append(event_messages.temperature_event(cycle.temperature_c, legs))
    return found


def _scene_channels(legs: Sequence[str]) -> Iterator[TopicChannel]:
    """Yield the topics with Foxglove's own schemas: force arrows, closure grids, foot poses."""
    topic_schemas = json.loads(files(__package__).joinpath("schemas.json").read_bytes())

    def scene_channel(
        topic: str, schema_name: str, values: Callable[[ViewedCycle], dict[str, Any]]
    ) -> TopicChannel:
        def encoded(viewed: ViewedCycle) -> list[bytes]:
            return [json.dumps(values(viewed), separators=(",", ":")).encode()]

        schema = json.dumps(topic_schemas[schema_name])
        return TopicChannel(topic, schema_name, schema, encoded, is_rate_limited=True)

    def closures(viewed: ViewedCycle, row: int) -> dict[str, Any]:
        closure_rel = viewed.table[row, CLOSURE_COLUMNS].astype(np.float64)
        return closure_grid(closure_rel, legs[row], viewed.cycle.forces.t_sent_ns)

    yield scene_channel(
        "/feet", "foxglove.SceneUpdate", lambda viewed: scene_update(viewed.cycle.forces, legs)
    )
    for row, leg in enumerate(legs):
        yield scene_channel(f"/closure/{leg}", "foxglove.Grid", partial(closures, row=row))
    yield scene_channel(
        "/tf", "foxglove.FrameTransforms", lambda viewed: foot_transforms(legs, viewed.cycle.forces.t_sent_ns)
    )
