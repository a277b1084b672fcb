"""Scans, forces and events as JSON, with the schemas by which Foxglove and PlotJuggler show them.

A float is written with the fewest digits that give the same 64 bits back; NaN is null, and infinity, for
which JSON has no word, is the number 1e999.
"""

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from footsense.frames import (
    ELEMENTS,
    CapFrame,
    Command,
    CommandKind,
    ForceFrame,
    Outcome,
    Result,
    State,
    Zero,
)

__all__ = [
    "EVENT",
    "FORCE",
    "SCAN",
    "command_event",
    "decode_command",
    "decode_force",
    "decode_outcome",
    "decode_scan",
    "encode_force",
    "encode_scan",
    "loss_event",
    "outcome_event",
    "schemas",
]

SCAN, FORCE, EVENT = "/scan", "/force", "/event"

_AXES = ("x", "y", "z")


def encode_scan(scan: CapFrame, legs: Sequence[str]) -> bytes:
    """Return a scan as a JSON object with one entry per leg."""
    t_ns, capacitance_pf, reading = scan.t_ns.tolist(), scan.capacitance_pf.tolist(), scan.reading.tolist()
    message: dict[str, Any] = {"sequence": scan.sequence}
    for row, leg in enumerate(legs):
        message[leg] = {"t_ns": t_ns[row], "capacitance_pf": capacitance_pf[row], "reading": reading[row]}
    return _dump(message)


def decode_scan(data: bytes, legs: Sequence[str]) -> CapFrame:
    """Return the scan that `encode_scan` wrote."""
    message = json.loads(data)
    rows = [message[leg] for leg in legs]
    return CapFrame(
        message["sequence"],
        np.array([row["t_ns"] for row in rows], dtype=np.int64),
        np.array([row["capacitance_pf"] for row in rows], dtype=np.float64),
        np.array([row["reading"] for row in rows], dtype=np.uint8),
    )


def encode_force(forces: ForceFrame, legs: Sequence[str]) -> bytes:
    """Return forces as a JSON object with one entry per leg."""
    force_n, sigma_n = forces.force_n.tolist(), forces.sigma_n.tolist()
    message: dict[str, Any] = {"sequence": forces.sequence, "t_sent_ns": forces.t_sent_ns}
    for row, leg in enumerate(legs):
        message[leg] = {
            **{f"f{axis}_n": force_n[row][k] for k, axis in enumerate(_AXES)},
            **{f"sigma_{axis}_n": sigma_n[row][k] for k, axis in enumerate(_AXES)},
            "state": State(forces.state[row]).name,
            "fault_mask": int(forces.fault_mask[row]),
            "flags": int(forces.flags[row]),
            "t_ns": int(forces.t_ns[row]),
        }
    return _dump(message)


def decode_force(data: bytes, legs: Sequence[str]) -> ForceFrame:
    """Return the forces that `encode_force` wrote."""
    message = json.loads(data)
    rows = [message[leg] for leg in legs]
    return ForceFrame(
        message["sequence"],
        message["t_sent_ns"],
        np.array([row["t_ns"] for row in rows], dtype=np.int64),
        np.array([[row[f"f{axis}_n"] for axis in _AXES] for row in rows], dtype=np.float64),
        np.array([[row[f"sigma_{axis}_n"] for axis in _AXES] for row in rows], dtype=np.float64),
        np.array([State[row["state"]] for row in rows], dtype=np.uint8),
        np.array([row["fault_mask"] for row in rows], dtype=np.uint16),
        np.array([row["flags"] for row in rows], dtype=np.uint8),
        np.zeros(len(rows), np.uint8),
        Zero.none(len(rows)),
    )


def command_event(command: Command, legs: Sequence[str]) -> bytes:
    """Return the event of a command that was obeyed."""
    return json.dumps({"event": "command", "command": command.kind.name, "leg": legs[command.leg]}).encode()


def outcome_event(outcome: Outcome, legs: Sequence[str]) -> bytes:
    """Return the event of a command that came to an end."""
    message = {
        "event": "outcome",
        "command": outcome.command.kind.name,
        "leg": legs[outcome.command.leg],
        "result": outcome.result.name,
        "reason": outcome.reason,
    }
    return json.dumps(message).encode()


def loss_event(n_cycles: int) -> bytes:
    """Return the event of cycles that found no room."""
    return json.dumps({"event": "loss", "n_cycles": n_cycles}).encode()


def decode_command(event: Mapping[str, Any], legs: Sequence[str]) -> Command:
    """Return the command of a command or outcome event."""
    return Command(CommandKind[event["command"]], legs.index(event["leg"]))


def decode_outcome(event: Mapping[str, Any], legs: Sequence[str]) -> Outcome:
    """Return the outcome of an outcome event."""
    return Outcome(decode_command(event, legs), Result[event["result"]], event["reason"])


def _dump(message: dict[str, Any]) -> bytes:
    # Only numbers and the names of legs and states stand in these messages, so no text can be hit.
    return (
        json.dumps(message, separators=(",", ":"))
        .replace("NaN", "null")
        .replace("Infinity", "1e999")
        .encode()
    )


def schemas(legs: Sequence[str]) -> dict[str, bytes]:
    """Return the JSON schema of each topic."""
    number, whole, text = {"type": ["number", "null"]}, {"type": "integer"}, {"type": "string"}

    def nine(items: Mapping[str, Any]) -> dict[str, Any]:
        return {"type": "array", "items": items, "minItems": ELEMENTS, "maxItems": ELEMENTS}

    def record(**properties: Any) -> dict[str, Any]:  # noqa: ANN401 - a JSON schema is any JSON
        return {"type": "object", "properties": properties}

    scan = record(t_ns=nine(whole), capacitance_pf=nine(number), reading=nine(whole))
    vectors = {f"{name}{axis}_n": number for name in ("f", "sigma_") for axis in _AXES}
    force = record(**vectors, state=text, fault_mask=whole, flags=whole, t_ns=whole)
    topics = {
        SCAN: record(sequence=whole, **dict.fromkeys(legs, scan)),
        FORCE: record(sequence=whole, t_sent_ns=whole, **dict.fromkeys(legs, force)),
        EVENT: record(event=text, command=text, leg=text, result=text, reason=text, n_cycles=whole),
    }
    return {topic: json.dumps(schema).encode() for topic, schema in topics.items()}
