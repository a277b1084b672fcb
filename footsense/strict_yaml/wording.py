"""The first place where plain data do not fit a struct, in words for the person who wrote them.

msgspec decides whether data fit; its messages name neither the key of a mapping, nor the allowed keys, nor
both ends of a range. So once it has refused, the data are walked beside the description of the type.
"""

import re
from collections.abc import Callable
from difflib import get_close_matches
from typing import Any, NamedTuple

from msgspec import inspect

__all__ = ["Path", "Problem", "dotted", "first_problem"]

Path = tuple[str | int, ...]


class Problem(NamedTuple):
    """What is wrong, and where.

    Attributes:
        path: Keys and indices from the top to the value.
        message: What is wrong and what would be right.
    """

    path: Path
    message: str


def dotted(path: Path) -> str:
    """Return a path as it is read aloud.

    Example:
        >>> dotted(("buses", 0, "legs", "lf"))
        'buses[0].legs.lf'
    """
    text = ""
    for step in path:
        if isinstance(step, int):
            text += f"[{step}]"
        else:
            text += ("." if text else "") + (step if step.isprintable() else repr(step))
    return text


def first_problem(data: object, type_: Any) -> Problem | None:  # noqa: ANN401 - any annotation is a type here
    """Return the first misfit of `data` to `type_`, None if this walk finds none."""
    return _problem(data, inspect.type_info(type_), ())


def _problem(value: object, info: inspect.Type, path: Path) -> Problem | None:
    walk = _WALKS.get(type(info))
    return walk(value, info, path) if walk else None


def _described_problem(value: object, info: inspect.Metadata, path: Path) -> Problem | None:
    found = _problem(value, info.type, path)
    why = _description(info)
    return Problem(path, found.message + why) if found and found.path == path else found


def _struct_problem(value: object, info: inspect.StructType, path: Path) -> Problem | None:
    fields = {field.encode_name: field for field in info.fields}
    names = [*([info.tag_field] if info.tag_field else []), *fields]
    if not isinstance(value, dict):
        return Problem(path, f"expected a mapping with the keys {', '.join(names)}; got {_show(value)}")
    for key in value:
        if key not in names:
            return Problem(
                (*path, str(key)), f"unknown key{_nearest(key, names)}; the keys here are {', '.join(names)}"
            )
    for name, field in fields.items():
        if field.required and name not in value:
            return Problem(path, f"the key {name} is missing{_description(field.type)}")
    members = (
        _problem(value[name], field.type, (*path, name)) for name, field in fields.items() if name in value
    )
    return next((found for found in members if found), None)


def _dict_problem(value: object, info: inspect.DictType, path: Path) -> Problem | None:
    allowed = _choices(info.key_type)
    if not isinstance(value, dict):
        return Problem(path, f"expected a mapping{_of(allowed)}, got {_show(value)}")
    if len(value) < (info.min_length or 0):
        return Problem(path, f"expected at least {info.min_length} entries{_of(allowed)}, got {len(value)}")
    for key, item in value.items():
        if allowed and key not in allowed:
            return Problem(
                (*path, str(key)), f"unknown key{_nearest(key, allowed)}; the keys here are {_join(allowed)}"
            )
        found = _problem(key, info.key_type, (*path, str(key))) or _problem(
            item, info.value_type, (*path, str(key))
        )
        if found:
            return found
    return None


def _list_problem(value: object, info: inspect.ListType | inspect.VarTupleType, path: Path) -> Problem | None:
    if not isinstance(value, list):
        return Problem(path, f"expected a list, got {_show(value)}")
    low, high = info.min_length or 0, info.max_length
    if len(value) < low or (high is not None and len(value) > high):
        wanted = f"{low}" if low == high else f"{low} to {high}" if high is not None else f"at least {low}"
        return Problem(path, f"expected a list of {wanted} values, got {len(value)}")
    items = (_problem(item, info.item_type, (*path, i)) for i, item in enumerate(value))
    return next((found for found in items if found), None)


def _union_problem(value: object, info: inspect.UnionType, path: Path) -> Problem | None:
    variants = [variant for variant in info.types if not isinstance(variant, inspect.NoneType)]
    if value is None and len(variants) < len(info.types):
        return None
    tagged = {v.tag: v for v in variants if isinstance(v, inspect.StructType) and v.tag_field}
    if tagged and isinstance(value, dict):
        field = str(next(iter(tagged.values())).tag_field)
        if field not in value:
            return Problem(path, f"the key {field} is missing; expected one of {_join(tagged)}")
        chosen = tagged.get(value[field]) if isinstance(value[field], str | int) else None
        if chosen is None:
            return _choice_problem(value[field], tuple(tagged), (*path, field))
        return _problem(value, chosen, path)
    problems = [_problem(value, variant, path) for variant in variants]
    if None in problems:
        return None
    # The variant that got furthest is the one that was meant.
    return max((found for found in problems if found), key=lambda found: len(found.path), default=None)


def _choice_problem(value: object, choices: tuple[object, ...], path: Path) -> Problem | None:
    if any(type(value) is type(choice) and value == choice for choice in choices):
        return None
    return Problem(path, f"expected one of {_join(choices)}; got {_show(value)}{_nearest(value, choices)}")


def _number_problem(value: object, info: inspect.IntType | inspect.FloatType, path: Path) -> Problem | None:
    low, high = info.ge if info.ge is not None else info.gt, info.le if info.le is not None else info.lt
    kind = "a whole number" if isinstance(info, inspect.IntType) else "a number"
    if low is not None and high is not None:
        kind += f" from {low} to {high}"
    elif low is not None:
        kind += f" of at least {low}" if info.ge is not None else f" above {low}"
    elif high is not None:
        kind += f" of at most {high}" if info.le is not None else f" below {high}"
    allowed = int if isinstance(info, inspect.IntType) else int | float
    if isinstance(value, bool) or not isinstance(value, allowed):
        number = re.fullmatch(r"[-+]?\d+(\.\d*)?[eE][-+]?\d+", value) if isinstance(value, str) else None
        hint = f"; YAML takes that for text, write {float(number[0]):g}" if number else ""
        return Problem(path, f"expected {kind}, got {_show(value)}{hint}")
    above = (info.ge is None or value >= info.ge) and (info.gt is None or value > info.gt)
    below = (info.le is None or value <= info.le) and (info.lt is None or value < info.lt)
    return None if above and below else Problem(path, f"{value} is out of range; expected {kind}")


def _text_problem(value: object, info: inspect.StrType, path: Path) -> Problem | None:
    if not isinstance(value, str):
        return Problem(path, f"expected text, got {_show(value)}")
    if info.pattern is not None and not re.search(info.pattern, value):
        return Problem(path, f"{_show(value)} is not of the form {info.pattern}")
    if len(value) < (info.min_length or 0) or (info.max_length is not None and len(value) > info.max_length):
        longest = "any number of" if info.max_length is None else info.max_length
        return Problem(path, f"expected {info.min_length or 0} to {longest} characters, got {_show(value)}")
    return None


def _literal_problem(value: object, info: inspect.LiteralType, path: Path) -> Problem | None:
    return _choice_problem(value, info.values, path)


def _enum_problem(value: object, info: inspect.EnumType, path: Path) -> Problem | None:
    return _choice_problem(value, tuple(member.value for member in info.cls), path)


def _bool_problem(value: object, _: inspect.BoolType, path: Path) -> Problem | None:
    return None if isinstance(value, bool) else Problem(path, f"expected true or false, got {_show(value)}")


_WALKS: dict[type[inspect.Type], Callable[[object, Any, Path], Problem | None]] = {
    inspect.Metadata: _described_problem,
    inspect.StructType: _struct_problem,
    inspect.DictType: _dict_problem,
    inspect.ListType: _list_problem,
    inspect.VarTupleType: _list_problem,
    inspect.UnionType: _union_problem,
    inspect.LiteralType: _literal_problem,
    inspect.EnumType: _enum_problem,
    inspect.IntType: _number_problem,
    inspect.FloatType: _number_problem,
    inspect.StrType: _text_problem,
    inspect.BoolType: _bool_problem,
}


def _description(info: inspect.Type) -> str:
    why = (info.extra_json_schema or {}).get("description") if isinstance(info, inspect.Metadata) else None
    return f" ({why})" if why else ""


def _choices(info: inspect.Type) -> tuple[object, ...]:
    return tuple(info.values) if isinstance(info, inspect.LiteralType) else ()


def _of(allowed: tuple[object, ...]) -> str:
    return f" of {_join(allowed)}" if allowed else ""


def _join(choices: Any) -> str:  # noqa: ANN401 - anything that can be iterated
    return ", ".join(str(choice) for choice in choices)


def _nearest(value: object, names: Any) -> str:  # noqa: ANN401 - anything that can be iterated
    near = get_close_matches(str(value), [str(name) for name in names], n=1)
    return f", did you mean {near[0]}?" if near and near[0] != str(value) else ""


def _show(value: object) -> str:
    # The kind has to be seen: the text '5' and the number 5 are two things.
    if isinstance(value, str):
        return f"the text {value[:40]!r}{'...' if len(value) > 40 else ''}"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, dict | list):
        return "a mapping" if isinstance(value, dict) else "a list"
    return "nothing" if value is None else str(value)[:40]
