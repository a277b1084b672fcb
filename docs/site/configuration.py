"""Every key of a configuration: its type, range, default, and meaning, from the classes that check a file."""

import re
import types
import typing
from collections.abc import Iterator
from typing import Any, get_args, get_origin

import msgspec
from docstrings import attributes, table

from footsense.config import Config

_PLAIN = {int: "integer", float: "number", str: "text", bool: "true, false", type(None): "null"}


def markdown() -> str:
    """Return a section for the file and for each mapping in it."""
    parts, seen = [], set()
    waiting: list[tuple[str, type]] = [("", Config)]
    while waiting:
        path, struct = waiting.pop(0)
        if struct in seen:
            continue
        seen.add(struct)
        title = f"`{path}`" if path else "The file"
        summary = (struct.__doc__ or "").strip().partition("\n")[0]
        parts.append(f"## {title}\n\n{summary}\n\n{rows(struct)}")
        for field in msgspec.structs.fields(struct):
            hint = typing.get_type_hints(struct, include_extras=True)[field.name]
            for inner, mark in _structs(hint):
                waiting.append((f"{path}.{field.encode_name}{mark}".lstrip("."), inner))
    return "\n".join(parts)


def rows(struct: type) -> str:
    """Return a table of the keys of a mapping."""
    hints, words = typing.get_type_hints(struct, include_extras=True), attributes(struct)
    rows: list[list[object]] = []
    for field in msgspec.structs.fields(struct):
        meaning = re.sub(r"\bNone\b", "null", words[field.name])
        rows.append([f"`{field.encode_name}`", type_words(hints[field.name]), _default(field), meaning])
    return table(["key", "type", "default", "meaning"], rows)


def _default(field: msgspec.structs.FieldInfo) -> str:
    if field.required:
        return "*required*"
    value = field.default if field.default is not msgspec.NODEFAULT else field.default_factory()
    if isinstance(value, msgspec.Struct):
        return "its defaults"
    text = msgspec.json.encode(value).decode().strip('"')
    return f"`{text}`" if text else "*see meaning*"


def _structs(hint: Any) -> Iterator[tuple[type, str]]:  # noqa: ANN401 - a type
    """Yield the mappings in a type, with [] if there are several."""
    if isinstance(hint, type) and issubclass(hint, msgspec.Struct):
        yield hint, ""
    mark = "[]" if get_origin(hint) in {tuple, dict, list} else ""
    for inner in get_args(hint):
        for struct, more in _structs(inner):
            yield struct, mark + more


def type_words(hint: Any) -> str:  # noqa: ANN401 - a type
    """Return what a type accepts, in words."""
    origin, inner = get_origin(hint), get_args(hint)
    words: str
    if origin is typing.Annotated:
        words = _annotated(inner)
    elif origin in {typing.Union, types.UnionType}:
        words = " or ".join(dict.fromkeys(type_words(one) for one in inner))
    elif origin is typing.Literal:
        words = ", ".join(f"`{value}`" for value in inner)
    elif origin in {tuple, list}:
        items = [type_words(one) for one in (inner[:1] if inner[-1] is Ellipsis else inner)]
        words = f"list of {', '.join(items[:1] if len(set(items)) == 1 else items)}"
    elif origin is dict:
        words = f"{type_words(inner[0])}: {type_words(inner[1])}"
    elif isinstance(hint, type) and issubclass(hint, msgspec.Struct):
        words = "mapping"
    else:
        words = _PLAIN[hint]
    return words


def _annotated(inner: tuple[Any, ...]) -> str:
    kind, metas = type_words(inner[0]), [one for one in inner[1:] if isinstance(one, msgspec.Meta)]
    for meta in metas:
        low, high = (
            (meta.ge if meta.ge is not None else meta.gt),
            (meta.le if meta.le is not None else meta.lt),
        )
        if meta.min_length is not None and meta.min_length == meta.max_length:
            kind += f", {meta.min_length} of them"
        if low is not None or high is not None:
            above = "above " if meta.gt is not None else ""
            below = "below " if meta.lt is not None else ""
            kind += (
                f" {above}{low:g} to {below}{high:g}"
                if None not in {low, high}
                else f" {above or 'from '}{low:g}"
                if low is not None
                else f" up to {below}{high:g}"
            )
        if meta.description:
            kind += f" ({meta.description})"
    return kind
