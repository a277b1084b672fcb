"""Every CAN frame with its bits, from the DBC."""

from pathlib import Path

import cantools
from cantools.database.can import Message, Signal
from docstrings import table

_DBC = Path(__file__).parents[2] / "firmware_interface" / "can" / "footsense.dbc"
_FIRST_LEG = "Lf"


def markdown() -> str:
    """Return a section for each frame; those of one kind differ in their id alone."""
    database = cantools.database.load_file(_DBC)
    assert isinstance(database, cantools.database.can.Database)
    messages = [
        message
        for message in sorted(database.messages, key=lambda one: one.frame_id)
        if message.name.endswith(_FIRST_LEG) or not _has_leg(message.name)
    ]
    return "\n".join(_section(message) for message in messages)


def _has_leg(name: str) -> bool:
    return name[-2:] in {"Lf", "Lm", "Lr", "Rf", "Rm", "Rr"}


def _section(message: Message) -> str:
    name, ids = message.name, f"0x{message.frame_id:03X}"
    if _has_leg(name):
        name, ids = name[:-2], f"0x{message.frame_id - 1:03X} + node id (1 to 8)"
    comment = (message.comment or "").replace("left front ", "")
    cycle = f", every {message.cycle_time} ms" if message.cycle_time else ""
    head = f"## `{name}`\n\n{comment}\n\n{ids}, {message.length} bytes{cycle}.\n\n"
    return head + table(
        ["bits", "signal", "unit", "range", "meaning"], [_row(signal) for signal in message.signals]
    )


def _row(signal: Signal) -> list[object]:
    bits = f"{signal.start} to {signal.start + signal.length - 1}" if signal.length > 1 else signal.start
    limits = "" if signal.minimum is None else f"{signal.minimum:g} to {signal.maximum:g}"
    if signal.scale != 1:
        limits += f", step {signal.scale:g}"
    codes = ", ".join(f"{code} {name}" for code, name in (signal.choices or {}).items())
    meaning = (signal.comment or "") + (f": {codes}" if codes else "")
    return [bits, f"`{signal.name}`", signal.unit or "", limits, meaning.lstrip(": ")]
