"""JSON messages of a recording besides scans and forces: commands, losses, temperatures, reference samples, gait.

Commands, results, losses and temperatures are objects with the kind of the event. Each sample of a reference and each
event of the gait is a message of its own, so that they can be plotted.
"""

import json
from collections.abc import Mapping, Sequence
from typing import Annotated, Any

import msgspec
import numpy as np

from footsense.frames import (
    Command,
    CommandKind,
    CommandResult,
    GaitEvent,
    GaitEventKind,
    GaitFrame,
    ReferenceSamples,
    Result,
    Vector,
)
from footsense.recording.container.messages import encode_json, field_array, leg_objects
from footsense.ring.cycle_fields import GAIT_FIELDS, NonNegativeInt64, gait_from_arrays


def command_event(command: Command, legs: Sequence[str]) -> bytes:
    """Return the JSON message of an executed command."""
    return json.dumps({"event": "command", **_command_entries(command, legs)}).encode()


def outcome_event(outcome: CommandResult, legs: Sequence[str]) -> bytes:
    """Return the JSON message of a command's result."""
    result = {"result": outcome.result.name, "reason": outcome.reason}
    return json.dumps({"event": "outcome", **_command_entries(outcome.command, legs), **result}).encode()


def _command_entries(command: Command, legs: Sequence[str]) -> dict[str, str]:
    return {"command": command.kind.name, "leg": legs[command.leg]}


def loss_event(n_cycles: int) -> bytes:
    """Return the JSON message that `n_cycles` cycles were lost because the pipe was full."""
    return json.dumps({"event": "loss", "n_cycles": n_cycles}).encode()


def temperature_event(temperature_c: Vector, legs: Sequence[str]) -> bytes:
    """Return the JSON message of changed converter temperatures [degC], shape (legs,)."""
    return encode_json(
        {"event": "temperature", "temperature_c": dict(zip(legs, temperature_c.tolist(), strict=True))}
    )


def decode_temperature(event: Mapping[str, Any], legs: Sequence[str]) -> Vector:
    """Return the temperatures in a temperature message [degC], shape (legs,)."""
    values = [event["temperature_c"][leg] for leg in legs]
    return np.array(msgspec.convert(values, list[float | None]), np.float64)


def decode_command(event: Mapping[str, Any], legs: Sequence[str]) -> Command:
    """Return the command in a command or result message."""
    return Command(CommandKind[event["command"]], legs.index(event["leg"]))


def decode_outcome(event: Mapping[str, Any], legs: Sequence[str]) -> CommandResult:
    """Return the command result in a result message."""
    reason = msgspec.convert(event["reason"], str)
    return CommandResult(decode_command(event, legs), Result[event["result"]], reason)


_FORCE_KEYS = ("fx_n", "fy_n", "fz_n")


class _ReferenceSample(msgspec.Struct):
    t_ns: Annotated[int, msgspec.Meta(ge=-(1 << 63), le=(1 << 63) - 1)]
    fx_n: float | None
    fy_n: float | None
    fz_n: float | None
    saturated: bool


def encode_reference(reference: ReferenceSamples) -> list[tuple[int, bytes]]:
    """Return time [ns] and JSON message of each sample of the test stand's force sensor."""
    rows = zip(reference.t_ns.tolist(), reference.force_n.tolist(), reference.saturated.tolist(), strict=True)
    return [
        (
            t_ns,
            encode_json(
                {"t_ns": t_ns, **dict(zip(_FORCE_KEYS, force_n, strict=True)), "saturated": saturated}
            ),
        )
        for t_ns, force_n, saturated in rows
    ]


def decode_reference(samples: Sequence[bytes]) -> ReferenceSamples:
    """Return the force-sensor samples decoded from JSON messages."""
    rows = msgspec.convert([json.loads(sample) for sample in samples], list[_ReferenceSample])
    return ReferenceSamples(
        np.array([row.t_ns for row in rows], np.int64),
        np.array([[row.fx_n, row.fy_n, row.fz_n] for row in rows], np.float64).reshape(-1, 3),
        np.array([row.saturated for row in rows], np.bool_),
    )


def reference_schema() -> bytes:
    """Return the JSON schema of a force-sensor sample."""
    properties = {
        "t_ns": {"type": "integer"},
        **{key: {"type": ["number", "null"]} for key in _FORCE_KEYS},
        "saturated": {"type": "boolean"},
    }
    return json.dumps({"type": "object", "properties": properties}).encode()


class _GaitMessage(msgspec.Struct):
    t_ns: NonNegativeInt64
    friction: float | None
    all_in_air: bool


class _GaitEventMessage(msgspec.Struct):
    kind: str
    leg: str
    t_ns: int
    sigma_s: float


def encode_gait(gait: GaitFrame, legs: Sequence[str]) -> bytes:
    """Return a gait frame, without its events, as a JSON message with one entry per leg."""
    whole = {"t_ns": gait.t_ns, "friction": gait.friction, "all_in_air": gait.all_in_air}
    return encode_json({**whole, **leg_objects(gait, legs, GAIT_FIELDS)})


def encode_gait_events(gait: GaitFrame, legs: Sequence[str]) -> list[bytes]:
    """Return the events of a gait frame as one JSON message each."""
    return [
        encode_json(
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
    """Return the gait frame decoded from its JSON message and those of its events."""
    message: Mapping[str, Any] = json.loads(data)
    whole = msgspec.convert(message, _GaitMessage)
    rows = [_with_current_names(message[leg]) for leg in legs]
    arrays = {path: field_array(field, rows) for path, field in GAIT_FIELDS.items()}
    friction = float("nan") if whole.friction is None else whole.friction
    found = tuple(_decode_gait_event(event, legs) for event in events)
    return gait_from_arrays(whole.t_ns, friction, whole.all_in_air, found, arrays)


def _with_current_names(row: dict[str, Any]) -> dict[str, Any]:
    """Return a leg's entries with the former name of `tangential_over_normal` replaced by the present one."""
    return {key.replace("friction_use", "tangential_over_normal"): value for key, value in row.items()}


def _decode_gait_event(data: bytes, legs: Sequence[str]) -> GaitEvent:
    event = msgspec.convert(json.loads(data), _GaitEventMessage)
    return GaitEvent(GaitEventKind[event.kind], legs.index(event.leg), event.t_ns, event.sigma_s)
