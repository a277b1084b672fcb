"""Topics and keys of a recording, from the table by which it is written and the frames whose arrays it holds."""

import json
import re
from collections.abc import Mapping

from docstrings import attributes, table

from footsense.frames import (
    BaselineDrift,
    CapFrame,
    ContactFrame,
    CycleField,
    GaitEvent,
    GaitFrame,
    LegMotion,
)
from footsense.recording import messages
from footsense.ring.records import CYCLE_FIELDS, GAIT_FIELDS, MOTION_FIELDS

_FRAMES = {
    "scan": CapFrame,
    "forces": ContactFrame,
    "forces.baseline": BaselineDrift,
    "gait": GaitFrame,
    "motion": LegMotion,
}
_TOPICS = {
    messages.SCAN: ("With each cycle: the readings, for each leg", CYCLE_FIELDS, "scan"),
    messages.FORCE: (
        "With each cycle, beside `sequence` and `t_sent_ns`: the forces, for each leg",
        CYCLE_FIELDS,
        "forces",
    ),
    messages.GAIT: (
        "Ten times a second and with each event, beside `t_ns`, `friction`, `all_in_air`, for each leg",
        GAIT_FIELDS,
        "gait",
    ),
    messages.MOTION: (
        "With each cycle in which it changed: the motion of each leg, from its gait controller",
        MOTION_FIELDS,
        "motion",
    ),
}


def markdown() -> str:
    """Return a section for each topic."""
    parts = [_section(topic, *about) for topic, about in _TOPICS.items()]
    event = [[f"`{key}`", attributes(GaitEvent)[key]] for key in ("kind", "leg", "t_ns", "sigma_s")]
    parts.append(
        f"## `{messages.GAIT_EVENT}`\n\nOne message for each event.\n\n{table(['key', 'meaning'], event)}"
    )
    keys = json.loads(messages.topic_schemas(["lf"])[messages.EVENT])["properties"]
    names = ", ".join(f"`{key}`" for key in keys)
    parts.append(
        f"## `{messages.EVENT}`\n\nCommands, their results, lost cycles, changed temperatures; keys: {names}.\n"
    )
    parts.append(
        f"## `{messages.REFERENCE}`\n\nOn a test stand: the samples of the force sensor, "
        "`t_ns`, `fx_n`, `fy_n`, `fz_n`, `saturated`.\n"
    )
    return "\n".join(parts)


def _section(topic: str, words: str, fields: Mapping[str, CycleField], start: str) -> str:
    rows: list[list[object]] = []
    for path, field in fields.items():
        if path.startswith(start):
            parent, _, name = path.rpartition(".")
            keys = ", ".join(f"`{key}`" for key in field.json_keys)
            rows.append([keys, _kind(field), _meaning(attributes(_FRAMES[parent])[name])])
    return f"## `{topic}`\n\n{words}.\n\n{table(['key', 'type', 'meaning'], rows)}"


def _meaning(words: str) -> str:
    """Return the description of an array as that of a leg's entry."""
    words = re.sub(r", u?int\d+ of (`\w+`)", r" (\1)", words)
    words = re.sub(r", shape \([^)]*\)|, (?:u?int\d+|float64)", "", words)
    return re.sub(r"\bNaN\b", "null", words)


def _kind(field: CycleField) -> str:
    if field.code_enum is not None:
        return "one of " + ", ".join(f"`{code.name}`" for code in field.code_enum)
    kind = {"<f8": "number or null", "<i8": "integer"}.get(field.dtype, f"0 to {field.max_code}")
    return (
        f"list, an entry for each element: {kind}" if field.row_shape and len(field.json_keys) == 1 else kind
    )
