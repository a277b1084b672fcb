"""Details of a msgspec validation error: path as keys, the wrong value, and the allowed values."""

import re
from collections.abc import Callable, Sequence
from difflib import get_close_matches
from typing import Any, NamedTuple

import msgspec
from msgspec import inspect

from footsense.strict_yaml.plain_data import item_path

_ERROR_PATH_PATTERN = re.compile(r" - at (?P<key>`key` in )?`\$(?P<path>[^`]*)`$")
_PATH_STEP_PATTERN = re.compile(r"\.(?P<field>[^.\[]+)|\[(?P<index>\d+|\.\.\.)\]")
_UNKNOWN_FIELD_PATTERN = re.compile(r"(?P<fault>.*unknown field) `(?P<name>.*)`", re.DOTALL)
_MISSING_FIELD_PATTERN = re.compile(r".*required field `(?P<name>.*)`")
_EXPONENT_NUMBER_PATTERN = re.compile(r"[-+]?\d+(\.\d*)?[eE][-+]?\d+")


class Problem(NamedTuple):
    """One error in a YAML text: path of the key, and message.

    Attributes:
        path: Keys and indices from the top to the value, such as "buses[0].legs.lf"; empty for the text as a whole.
        message: The fault, and the correct form.
    """

    path: str
    message: str

    def __str__(self) -> str:
        """Return the error as one line: the path of the setting, then the message."""
        return f"{self.path}: {self.message}" if self.path else self.message


def problem_from_error(data: Any, type_: type[object], error: str) -> Problem:  # noqa: ANN401
    """Return a msgspec validation error as a problem with the path, the value and the allowed values.

    Args:
        data: Plain data that `msgspec.convert` refused.
        type_: Struct that they do not fit.
        error: Error of msgspec, such as "Expected `int` <= 7 - at `$.legs[...]`".
    """
    place = _ERROR_PATH_PATTERN.search(error)
    fault = error[: place.start()] if place else error
    path = ""
    value, info = data, inspect.type_info(type_)
    for step in _PATH_STEP_PATTERN.finditer(place["path"] if place else ""):
        if step["index"] == "...":
            key: str | int = _failing_key(value, lambda: msgspec.convert(data, type_), error)
        else:
            key = step["field"] or int(step["index"])
        path, value, info = item_path(path, key), value[key], _item_type(info, value, key)
    if place and place["key"]:
        info = next(
            type_.key_type for type_, _ in _union_members(info) if isinstance(type_, inspect.DictType)
        )
        value = next(key for key in value if key not in _allowed_values(info))
        path = item_path(path, value)
    if unknown := _UNKNOWN_FIELD_PATTERN.fullmatch(fault):
        name = unknown["name"]
        return Problem(
            item_path(path, name),
            unknown["fault"] + _word_remedy(name, list(_mapping_field_types(info, value))),
        )
    if missing := _MISSING_FIELD_PATTERN.fullmatch(fault):
        info = _item_type(info, value, missing["name"])
        return Problem(path, fault.replace("`", "") + _expected_values_text(info))
    return Problem(path, fault.replace("`", "") + _error_hint(fault, value, info))


def _error_hint(fault: str, value: object, info: inspect.Type) -> str:
    """Return the wrong value, unless the message shows it, and the allowed values, as text."""
    if choices := _allowed_values(info):
        return _word_remedy(value, choices)
    got = ""
    if isinstance(value, str):
        got = f" {value[:40]!r}" if "got" in fault else f", got {value[:40]!r}"
        if _EXPONENT_NUMBER_PATTERN.fullmatch(value):
            got += f" (YAML reads that as text, write {float(value):g})"
    elif "got" not in fault:
        got = f", got {len(value) if isinstance(value, dict | list) else value}"
    return got + _expected_values_text(info)


def _expected_values_text(info: inspect.Type) -> str:
    """Return the allowed values of a type, or descriptions of its fields, as text."""
    if choices := _allowed_values(info):
        return f"; expected {', '.join(map(str, choices))}"
    reasons = dict.fromkeys(reason for _, reason in _union_members(info) if reason)
    return f" ({', or '.join(reasons)})" if reasons else ""


def _word_remedy(word: object, allowed: Sequence[object]) -> str:
    """Return the end of the message about a word that is not allowed: the allowed words."""
    near = get_close_matches(str(word), [choice for choice in allowed if isinstance(choice, str)], n=1)
    nearest = f"; did you mean {near[0]}?" if near else ""
    return f"; expected {', '.join(map(str, allowed))}{nearest}"


def _union_members(info: inspect.Type) -> list[tuple[inspect.Type, str]]:
    """Return the members of a union type (or the type itself), each with its description."""
    if isinstance(info, inspect.Metadata):
        reason = (info.extra_json_schema or {}).get("description", "")
        return [(type_, own or reason) for type_, own in _union_members(info.type)]
    if isinstance(info, inspect.UnionType):
        return [member for type_ in info.types for member in _union_members(type_)]
    return [(info, "")]


def _allowed_values(info: inspect.Type) -> list[object]:
    """Return the values that a literal type allows; empty for other types."""
    types = (type_ for type_, _ in _union_members(info) if isinstance(type_, inspect.LiteralType))
    return [value for type_ in types for value in type_.values]


def _mapping_field_types(info: inspect.Type, value: dict[str, object]) -> dict[str, inspect.Type]:
    """Return the field types of a mapping's struct, chosen by its tag if there are several."""
    structs = [type_ for type_, _ in _union_members(info) if isinstance(type_, inspect.StructType)]
    fields: dict[str, inspect.Type] = {}
    for struct in structs:
        if struct.tag_field is not None:
            fields[struct.tag_field] = inspect.LiteralType(tuple(other.tag for other in structs))
        if struct.tag_field is None or value.get(struct.tag_field) == struct.tag:
            fields |= {field.encode_name: field.type for field in struct.fields}
    return fields


def _item_type(info: inspect.Type, value: Any, key: str | int) -> inspect.Type:  # noqa: ANN401
    """Return the type of the item of a value at a key or index."""
    for type_, _ in _union_members(info):
        match type_:
            case inspect.StructType() if isinstance(value, dict):
                return _mapping_field_types(info, value)[str(key)]
            case inspect.TupleType(item_types=types):
                return types[int(key)]
            case inspect.ListType(item_type=item) | inspect.VarTupleType(item_type=item):
                return item
            case inspect.DictType(value_type=item):
                return item
    return inspect.AnyType()


def _failing_key(mapping: dict[str, object], convert: Callable[[], object], error: str) -> str:
    """Return the key whose value alone gives the error, as msgspec does not name the keys of a mapping."""
    items = dict(mapping)
    try:
        for key, item in items.items():
            mapping.clear()
            mapping[key] = item
            try:
                convert()
            except msgspec.ValidationError as alone:
                if str(alone) == error:
                    return key
    finally:
        mapping.clear()
        mapping.update(items)
    return next(iter(items))
