"""Every key of a scene: its type, range, default and meaning, from the classes that check a file."""

import inspect
import typing
from typing import get_args

import msgspec
from configuration import rows, type_words
from docstrings import attributes, table

from footsense.sim.couplings import Couplings
from footsense.sim.faults.scene_faults import Fault
from footsense.sim.scene import Ad7147Effects, Effects, Fabrication, Scene, Warming
from footsense.sim.scene_loads import Load, Standstill

#: Keys of a fault that the page explains above the table: what they are, or what they take.
_TIMES = {"at_s", "until_s"}
_PLACES = {"leg", "legs", "element", "row", "column", "bus"}


def markdown() -> str:
    """Return a section for the file and each mapping in it, and a table of the faults."""
    loads = {f"`load`, kind `{kind.__struct_config__.tag}`": kind for kind in get_args(Load)}
    structs: dict[str, type[msgspec.Struct]] = {
        "The file": Scene,
        **loads,
        "`load.stands[]`, of kind `tripod`": Standstill,
        "`effects`": Effects,
        "`effects.couplings`": Couplings,
        "`effects.warming`": Warming,
        "`effects.ad7147`": Ad7147Effects,
        "`fabrication`": Fabrication,
    }
    parts = [
        f"## {title}\n\n{_summary(struct)}\n\n{rows(struct) if struct.__struct_fields__ else ''}"
        for title, struct in structs.items()
    ]
    return "\n".join(parts)


def faults() -> str:
    """Return a table of the faults, each with its keys beside the times."""
    lines = [
        [
            f"`{kind.__struct_config__.tag}`",
            "" if "until_s" in kind.__struct_fields__ else "no",
            _keys(kind),
            _summary(kind),
        ]
        for kind in get_args(Fault)
    ]
    return table(["fault", "`until_s`", "other keys", "what happens"], lines)


def _keys(kind: type[msgspec.Struct]) -> str:
    hints = typing.get_type_hints(kind, include_extras=True)
    words = {
        name: text
        for base in kind.__mro__
        if "Attributes:\n" in (base.__doc__ or "")
        for name, text in attributes(base).items()
    }
    keys = []
    for field in msgspec.structs.fields(kind):
        if field.name in _PLACES:
            keys.append(f"`{field.name}`")
        elif field.name not in _TIMES:
            optional = "" if field.required else "optional "
            meaning = f": {words[field.name]}" if field.name in words else ""
            keys.append(f"`{field.name}`, {optional}{type_words(hints[field.name])}{meaning}")
    return "<br>".join(keys)


def _summary(struct: type[msgspec.Struct]) -> str:
    return inspect.cleandoc(struct.__doc__ or "").partition("\n")[0]
