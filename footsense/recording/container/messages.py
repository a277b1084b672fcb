"""JSON messages of scans and forces in a recording, and the JSON schemas of all its topics.

A float is written with the fewest digits that give the same 64 bits back; NaN is null, and infinity, for
which JSON has no word, is the number 1e999.

The readings of all elements are written with every conversion, of which one is new: the container's compression
finds repetitions, and writing the changes alone would save a tenth of the file.

Recordings from before causes and baselines were recorded lack these entries: they are read as `CAUSE_NOT_RECORDED` and
    as
no baseline, are not compared, and stay out when the recording is recovered. Older names of entries and causes are read
as their present ones.
"""

import json
from collections.abc import Mapping, Sequence
from functools import cache
from operator import attrgetter
from typing import Annotated, Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from footsense.frames import (
    ELEMENTS,
    BaselineStatus,
    CapFrame,
    ContactFrame,
    GaitFrame,
)
from footsense.ring.cycle_fields import (
    CAUSE_NOT_RECORDED,
    CYCLE_FIELDS,
    GAIT_FIELDS,
    CycleField,
    NonNegativeInt64,
    forces_from_arrays,
    scan_from_arrays,
)

SCAN, FORCE, EVENT, REFERENCE = "/scan", "/force", "/event", "/reference"
GAIT, GAIT_EVENT = "/gait", "/gait_event"

#: Names of causes in recordings whose baseline is still called zero.
_FORMER_CAUSES = {
    "LINE_HELD": "BUS_STUCK",
    "GARBLED": "CORRUPT",
    "HELD_UP": "DELAYED",
    "GAP_SHUT": "GAP_CLOSED",
}

#: Entries of a leg that recordings from before causes and baselines lack, and their values there.
_DEFAULTS_OF_OLD_RECORDINGS = {
    "cause": None,
    "baseline_status": BaselineStatus.NONE.name,
    "baseline_mean_pf": None,
    "baseline_worst_pf": None,
    "baseline_moved_ns": 0,
}

#: Name of each code, and code of each name, by enumeration.
_NAME_OF_CODE = {
    field.code_enum: {**{code: code.name for code in field.code_enum}, CAUSE_NOT_RECORDED: None}
    for field in (*CYCLE_FIELDS.values(), *GAIT_FIELDS.values())
    if field.code_enum is not None
}
_CODE_OF_NAME = {
    names: {name: code for code, name in of_code.items()} for names, of_code in _NAME_OF_CODE.items()
}
# Names in recordings of earlier versions.
_CODE_OF_NAME[BaselineStatus] |= {
    "TOO_FAR": BaselineStatus.DRIFT_TOO_LARGE,
    "TOO_FAST": BaselineStatus.DRIFT_TOO_FAST,
}


_SCAN_FIELDS = {path: field for path, field in CYCLE_FIELDS.items() if path.startswith("scan.")}
_FORCE_FIELDS = {path: field for path, field in CYCLE_FIELDS.items() if path.startswith("forces.")}
_FORCE_FIELDS_OF_OLD_RECORDINGS = {
    path: field
    for path, field in _FORCE_FIELDS.items()
    if field.json_keys[0] not in _DEFAULTS_OF_OLD_RECORDINGS
}


def encode_scan(scan: CapFrame, legs: Sequence[str]) -> bytes:
    """Return a capacitance frame as a JSON message with one entry per leg."""
    return encode_json({"sequence": scan.sequence, **leg_objects(scan, legs, _SCAN_FIELDS)})


def encode_force(forces: ContactFrame, legs: Sequence[str]) -> bytes:
    """Return a force frame as a JSON message with one entry per leg."""
    is_old = (forces.cause == CAUSE_NOT_RECORDED).all()
    rows = leg_objects(forces, legs, _FORCE_FIELDS_OF_OLD_RECORDINGS if is_old else _FORCE_FIELDS)
    return encode_json({"sequence": forces.sequence, "t_sent_ns": forces.t_sent_ns, **rows})


def leg_objects(
    frame: CapFrame | ContactFrame | GaitFrame, legs: Sequence[str], fields: Mapping[str, CycleField]
) -> dict[str, dict[str, Any]]:
    """Return the values of each leg in a frame as a dict by field key, ready for JSON."""
    objects: dict[str, dict[str, Any]] = {leg: {} for leg in legs}
    for path, field in fields.items():
        column = attrgetter(path.partition(".")[2])(frame).astype(field.dtype, copy=False).tolist()
        for entries, value in zip(objects.values(), column, strict=True):
            if len(field.json_keys) > 1:
                entries.update(zip(field.json_keys, value, strict=True))
            else:
                entries[field.json_keys[0]] = (
                    value if field.code_enum is None else _NAME_OF_CODE[field.code_enum][value]
                )
    return objects


def decode_scan(data: bytes, legs: Sequence[str]) -> CapFrame:
    """Return the capacitance frame decoded from its JSON message."""
    message = json.loads(data)
    rows = [message[leg] for leg in legs]
    arrays = {path: field_array(field, rows) for path, field in _SCAN_FIELDS.items()}
    return scan_from_arrays(msgspec.convert(message["sequence"], NonNegativeInt64), arrays)


def decode_force(data: bytes, legs: Sequence[str]) -> ContactFrame:
    """Return the force frame decoded from its JSON message."""
    message = json.loads(data)
    rows = [{**_DEFAULTS_OF_OLD_RECORDINGS, **_with_current_names(message[leg])} for leg in legs]
    arrays = {path: field_array(field, rows) for path, field in _FORCE_FIELDS.items()}
    sequence, t_sent_ns = (
        msgspec.convert(message[key], NonNegativeInt64) for key in ("sequence", "t_sent_ns")
    )
    return forces_from_arrays(sequence, t_sent_ns, arrays)


def field_array(field: CycleField, rows: list[dict[str, Any]]) -> NDArray[Any]:
    """Return one field of all legs as an array; JSON null becomes NaN.

    Raises:
        MsgspecError: An entry is no such number.
        LookupError: An entry is missing, or no such name.
        ValueError: There are not so many entries.
    """
    values = [[row[key] for key in field.json_keys] for row in rows]
    if field.code_enum is not None:
        codes = _CODE_OF_NAME[field.code_enum]
        return np.array([codes[name] for (name,) in values], field.dtype)
    checked = msgspec.convert(values, _json_rows_type(field))
    return np.array(checked, field.dtype).reshape(len(rows), *field.row_shape)


@cache
def _json_rows_type(field: CycleField) -> Any:  # noqa: ANN401 - a type
    """Return the Python type that a field must have in decoded JSON, for validation."""
    entry: Any = float | None
    if field.max_code is not None:
        entry = Annotated[int, msgspec.Meta(ge=0, le=int(field.max_code))]
    elif field.dtype == "<i8":
        entry = int
    if field.row_shape and len(field.json_keys) == 1:
        entry = list[entry]
    return list[list[entry]]


def _with_current_names(row: dict[str, Any]) -> dict[str, Any]:
    """Return a leg's entries with their former names, of keys and of causes, replaced by the present ones."""
    if "zero_status" not in row:
        return row
    row = {key.replace("zero_", "baseline_", 1): value for key, value in row.items()}
    return {**row, "cause": _FORMER_CAUSES.get(row["cause"], row["cause"])}


def encode_json(message: dict[str, Any]) -> bytes:
    """Return a message as JSON bytes."""
    # Only numbers and the names of legs and states stand in these messages, so no text can be hit.
    return (
        json.dumps(message, separators=(",", ":"))
        .replace("NaN", "null")
        .replace("Infinity", "1e999")
        .encode()
    )


def topic_schemas(legs: Sequence[str]) -> dict[str, bytes]:
    """Return the JSON schema of each MCAP topic."""
    number, whole, text = {"type": ["number", "null"]}, {"type": "integer"}, {"type": "string"}

    def leg_schema(fields: Mapping[str, CycleField]) -> dict[str, Any]:
        properties: dict[str, Any] = {}
        for field in fields.values():
            value: dict[str, Any] = text if field.code_enum else number if field.dtype == "<f8" else whole
            if field.row_shape and len(field.json_keys) == 1:
                value = {"type": "array", "items": value, "minItems": ELEMENTS, "maxItems": ELEMENTS}
            properties |= dict.fromkeys(field.json_keys, value)
        return object_schema(**properties)

    def object_schema(**properties: Any) -> dict[str, Any]:  # noqa: ANN401 - a JSON schema is any JSON
        return {"type": "object", "properties": properties}

    topics = {
        SCAN: object_schema(sequence=whole, **dict.fromkeys(legs, leg_schema(_SCAN_FIELDS))),
        FORCE: object_schema(
            sequence=whole, t_sent_ns=whole, **dict.fromkeys(legs, leg_schema(_FORCE_FIELDS))
        ),
        GAIT: object_schema(
            t_ns=whole,
            friction=number,
            all_in_air={"type": "boolean"},
            **dict.fromkeys(legs, leg_schema(GAIT_FIELDS)),
        ),
        GAIT_EVENT: object_schema(kind=text, leg=text, t_ns=whole, sigma_s=number),
        EVENT: object_schema(
            **dict.fromkeys(("event", "command", "leg", "result", "reason"), text),
            n_cycles=whole,
            temperature_c=object_schema(**dict.fromkeys(legs, number)),
        ),
    }
    return {topic: json.dumps(schema).encode() for topic, schema in topics.items()}
