"""Scans, forces and events as JSON, with the schemas by which Foxglove and PlotJuggler show them.

A float is written with the fewest digits that give the same 64 bits back; NaN is null, and infinity, for
which JSON has no word, is the number 1e999.

Every scan is written in full, also where forces go out after each conversion and one ninth of it is new: the
container's compression finds repetitions, and writing the changes alone would save a tenth of the file.

Recordings from before causes and baselines were recorded lack these entries: they are read as `NOT_RECORDED` and as
no baseline, are not compared, and stay out when the recording is recovered. Older names of entries and causes are read
as their present ones.
"""

import json
from collections.abc import Mapping, Sequence
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from footsense.frames import (
    ELEMENTS,
    BaselineDrift,
    BaselineStatus,
    CapFrame,
    Cause,
    Command,
    CommandKind,
    CommandResult,
    ContactFrame,
    Reading,
    Result,
    State,
    Vector,
)

SCAN, FORCE, EVENT, REFERENCE = "/scan", "/force", "/event", "/reference"

#: Largest whole number in a message: the next bit is the sign of the arrays' entries.
_MOST = (1 << 63) - 1

_Whole = TypeVar("_Whole", np.int64, np.uint8, np.uint16)

#: Stands for the cause in recordings from before causes were recorded; no `Cause` has this code.
NOT_RECORDED = 255

_AXES = ("x", "y", "z")

#: Names of causes in recordings whose baseline is still called zero.
_OLD_CAUSES = {"LINE_HELD": "BUS_STUCK", "GARBLED": "CORRUPT", "HELD_UP": "DELAYED", "GAP_SHUT": "GAP_CLOSED"}


def encode_scan(scan: CapFrame, legs: Sequence[str]) -> bytes:
    """Return a scan as a JSON object with one entry per leg."""
    t_ns, capacitance_pf, reading = scan.t_ns.tolist(), scan.capacitance_pf.tolist(), scan.reading.tolist()
    message: dict[str, Any] = {"sequence": scan.sequence}
    for row, leg in enumerate(legs):
        message[leg] = {"t_ns": t_ns[row], "capacitance_pf": capacitance_pf[row], "reading": reading[row]}
    return dump(message)


def decode_scan(data: bytes, legs: Sequence[str]) -> CapFrame:
    """Return the scan that `encode_scan` wrote."""
    message = json.loads(data)
    rows = [message[leg] for leg in legs]
    shape = len(legs), ELEMENTS
    return CapFrame(
        whole(message["sequence"]),
        wholes([row["t_ns"] for row in rows], np.int64, shape),
        floats([row["capacitance_pf"] for row in rows], shape),
        wholes([row["reading"] for row in rows], np.uint8, shape, max(Reading)),
    )


def encode_force(forces: ContactFrame, legs: Sequence[str]) -> bytes:
    """Return forces as a JSON object with one entry per leg."""
    force_n, sigma_n = forces.force_n.tolist(), forces.sigma_n.tolist()
    baseline = forces.baseline
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
        if forces.cause[row] != NOT_RECORDED:
            message[leg] |= {
                "cause": Cause(forces.cause[row]).name,
                "baseline_status": BaselineStatus(baseline.status[row]).name,
                "baseline_mean_pf": float(baseline.mean_pf[row]),
                "baseline_worst_pf": float(baseline.worst_pf[row]),
                "baseline_moved_ns": int(baseline.moved_ns[row]),
            }
    return dump(message)


def decode_force(data: bytes, legs: Sequence[str]) -> ContactFrame:
    """Return the forces that `encode_force` wrote."""
    message = json.loads(data)
    rows = [_renamed(message[leg]) for leg in legs]
    n = (len(legs),)
    return ContactFrame(
        whole(message["sequence"]),
        whole(message["t_sent_ns"]),
        wholes([row["t_ns"] for row in rows], np.int64, n),
        floats([[row[f"f{axis}_n"] for axis in _AXES] for row in rows], (*n, 3)),
        floats([[row[f"sigma_{axis}_n"] for axis in _AXES] for row in rows], (*n, 3)),
        np.array([State[row["state"]] for row in rows], dtype=np.uint8),
        wholes([row["fault_mask"] for row in rows], np.uint16, n, (1 << ELEMENTS) - 1),
        wholes([row["flags"] for row in rows], np.uint8, n, 255),
        np.array([_cause(row) for row in rows], dtype=np.uint8),
        BaselineDrift(
            np.array([BaselineStatus[row.get("baseline_status", "NONE")] for row in rows], dtype=np.uint8),
            floats([row.get("baseline_mean_pf") for row in rows], n),
            floats([row.get("baseline_worst_pf") for row in rows], n),
            wholes([row.get("baseline_moved_ns", 0) for row in rows], np.int64, n),
        ),
    )


def _renamed(row: dict[str, Any]) -> dict[str, Any]:
    """Return a leg's entries with the present names for the older ones."""
    if "zero_status" not in row:
        return row
    row = {key.replace("zero_", "baseline_", 1): value for key, value in row.items()}
    return {**row, "cause": _OLD_CAUSES.get(row["cause"], row["cause"])}


def _cause(row: Mapping[str, Any]) -> int:
    return Cause[row["cause"]] if "cause" in row else NOT_RECORDED


def whole(value: object, most: int = _MOST, least: int = 0) -> int:
    """Check that a value is a whole number from `least` to `most`, and return the value.

    Raises:
        ValueError: It is not, or not from `least` to `most`.
    """
    if type(value) is not int or not least <= value <= most:
        raise ValueError(f"{str(value)[:20]!r} is not a whole number from {least} to {most}")
    return value


def wholes(values: object, dtype: type[_Whole], shape: tuple[int, ...], most: int = _MOST) -> NDArray[_Whole]:
    """Return an array of whole numbers, from 0 or the least that the type has.

    Raises:
        ValueError: They are not, or not so many.
    """
    found = np.array(values, dtype=object)
    _require_shape(found, shape)
    least = ~_MOST if np.issubdtype(dtype, np.signedinteger) else 0
    return np.array([whole(value, most, least) for value in found.flat], dtype=dtype).reshape(shape)


def floats(values: object, shape: tuple[int, ...]) -> Vector:
    """Return an array of numbers, null as NaN.

    Raises:
        ValueError: They are none, or not so many.
    """
    found = np.array(values, dtype=object)
    _require_shape(found, shape)
    if not all(value is None or type(value) in {int, float} for value in found.flat):
        raise ValueError("a number is expected, or null")
    return found.astype(np.float64)


def _require_shape(found: NDArray[Any], shape: tuple[int, ...]) -> None:
    if found.shape != shape:
        raise ValueError(f"{shape} values are expected, not {found.shape}")


def command_event(command: Command, legs: Sequence[str]) -> bytes:
    """Return the event of an executed command."""
    return json.dumps({"event": "command", "command": command.kind.name, "leg": legs[command.leg]}).encode()


def outcome_event(outcome: CommandResult, legs: Sequence[str]) -> bytes:
    """Return the event of a command's result."""
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


def temperature_event(temperature_c: Vector, legs: Sequence[str]) -> bytes:
    """Return the event of changed converter temperatures [degC], shape (legs,)."""
    return dump(
        {"event": "temperature", "temperature_c": dict(zip(legs, temperature_c.tolist(), strict=True))}
    )


def decode_temperature(event: Mapping[str, Any], legs: Sequence[str]) -> Vector:
    """Return the temperatures of a temperature event [degC], shape (legs,)."""
    return floats([event["temperature_c"][leg] for leg in legs], (len(legs),))


def decode_command(event: Mapping[str, Any], legs: Sequence[str]) -> Command:
    """Return the command of a command or outcome event."""
    return Command(CommandKind[event["command"]], legs.index(event["leg"]))


def decode_outcome(event: Mapping[str, Any], legs: Sequence[str]) -> CommandResult:
    """Return the result of an outcome event.

    Raises:
        TypeError: The reason is not a string.
    """
    reason = event["reason"]
    if not isinstance(reason, str):
        raise TypeError("the reason is not a string")
    return CommandResult(decode_command(event, legs), Result[event["result"]], reason)


def dump(message: dict[str, Any]) -> bytes:
    """Return a message as JSON."""
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
    baseline = {
        "baseline_status": text,
        "baseline_mean_pf": number,
        "baseline_worst_pf": number,
        "baseline_moved_ns": whole,
    }
    force = record(**vectors, state=text, fault_mask=whole, flags=whole, t_ns=whole, cause=text, **baseline)
    topics = {
        SCAN: record(sequence=whole, **dict.fromkeys(legs, scan)),
        FORCE: record(sequence=whole, t_sent_ns=whole, **dict.fromkeys(legs, force)),
        EVENT: record(
            **dict.fromkeys(("event", "command", "leg", "result", "reason"), text),
            n_cycles=whole,
            temperature_c=record(**dict.fromkeys(legs, number)),
        ),
    }
    return {topic: json.dumps(schema).encode() for topic, schema in topics.items()}
