"""Gait semantics as JSON: one message for the legs, and one for each event, so that events can be plotted."""

import json
from collections.abc import Mapping, Sequence
from typing import Any

import msgspec

from footsense.frames import GaitEvent, GaitEventKind, GaitFrame
from footsense.recording.container.messages import dump, field_array, leg_objects
from footsense.recording.cycle_fields import GAIT_FIELDS, Count, gait_of


class _Gait(msgspec.Struct):
    t_ns: Count
    friction: float | None
    all_in_air: bool


class _Event(msgspec.Struct):
    kind: str
    leg: str
    t_ns: int
    sigma_s: float


def encode_gait(gait: GaitFrame, legs: Sequence[str]) -> bytes:
    """Return a gait without its events as a JSON object with one entry per leg."""
    whole = {"t_ns": gait.t_ns, "friction": gait.friction, "all_in_air": gait.all_in_air}
    return dump({**whole, **leg_objects(gait, legs, GAIT_FIELDS)})


def encode_gait_events(gait: GaitFrame, legs: Sequence[str]) -> list[bytes]:
    """Return the events of a gait as JSON objects."""
    return [
        dump(
            {
                "kind": GaitEventKind(event.kind).name,
                "leg": legs[event.leg],
                "t_ns": event.t_ns,
                "sigma_s": event.sigma_s,
            }
        )
        for event in gait.events
    ]


def decode_gait(data: bytes, events: Sequence[bytes], legs: Sequence[str]) -> GaitFrame:
    """Return the gait that `encode_gait` and `encode_gait_events` wrote."""
    message: Mapping[str, Any] = json.loads(data)
    whole = msgspec.convert(message, _Gait)
    rows = [message[leg] for leg in legs]
    arrays = {path: field_array(field, rows) for path, field in GAIT_FIELDS.items()}
    friction = float("nan") if whole.friction is None else whole.friction
    found = tuple(_event(event, legs) for event in events)
    return gait_of(whole.t_ns, friction, whole.all_in_air, found, arrays)


def _event(data: bytes, legs: Sequence[str]) -> GaitEvent:
    event = msgspec.convert(json.loads(data), _Event)
    return GaitEvent(GaitEventKind[event.kind], legs.index(event.leg), event.t_ns, event.sigma_s)
