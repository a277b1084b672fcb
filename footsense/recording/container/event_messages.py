"""Commands, their results, losses and temperatures as JSON, each an object with the kind of the event."""

import json
from collections.abc import Mapping, Sequence
from typing import Any

import msgspec
import numpy as np

from footsense.frames import Command, CommandKind, CommandResult, Result, Vector
from footsense.recording.container.messages import dump


def command_event(command: Command, legs: Sequence[str]) -> bytes:
    """Return the event of an executed command."""
    return json.dumps({"event": "command", **_command(command, legs)}).encode()


def outcome_event(outcome: CommandResult, legs: Sequence[str]) -> bytes:
    """Return the event of a command's result."""
    result = {"result": outcome.result.name, "reason": outcome.reason}
    return json.dumps({"event": "outcome", **_command(outcome.command, legs), **result}).encode()


def _command(command: Command, legs: Sequence[str]) -> dict[str, str]:
    return {"command": command.kind.name, "leg": legs[command.leg]}


def loss_event(n_cycles: int) -> bytes:
    """Return the event of cycles that found no room."""
    return json.dumps({"event": "loss", "n_cycles": n_cycles}).encode()


def temperature_event(temperature_c: Vector, legs: Sequence[str]) -> bytes:
    """Return the event of changed converter temperatures [degC], shape (legs,)."""
    return dump(
        {"event": "temperature", "temperature_c": dict(zip(legs, temperature_c.tolist(), strict=True))}
    )


def decode_temperature(event: Mapping[str, Any], legs: Sequence[str]) -> Vector:
    """Return the temperatures of a temperature event [degC], shape (legs,)."""
    values = [event["temperature_c"][leg] for leg in legs]
    return np.array(msgspec.convert(values, list[float | None]), np.float64)


def decode_command(event: Mapping[str, Any], legs: Sequence[str]) -> Command:
    """Return the command of a command or outcome event."""
    return Command(CommandKind[event["command"]], legs.index(event["leg"]))


def decode_outcome(event: Mapping[str, Any], legs: Sequence[str]) -> CommandResult:
    """Decode an event message into the result of a command."""
    reason = msgspec.convert(event["reason"], str)
    return CommandResult(decode_command(event, legs), Result[event["result"]], reason)
