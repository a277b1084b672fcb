"""Load YAML text into frozen msgspec structs; errors are one line of text with line number, path and remedy.

A typo in a robot's configuration must not become a default: an unknown, missing or doubled key, a wrong type and
a value out of range are errors. Declare the structs with `frozen=True, forbid_unknown_fields=True`; the error quotes
the `description` of a field's `msgspec.Meta`.
"""

import json
import re
from collections.abc import Callable, Iterable, Sequence
from difflib import get_close_matches
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, NamedTuple, TypeVar, Union, get_args, get_origin

import msgspec
from msgspec import inspect

from footsense.errors import ConfigError
from footsense.plain_yaml import YamlError, YamlReader, item_path, read_text

T = TypeVar("T")


class Problem(NamedTuple):
    """One error in a YAML text: path of the key, and message.

    Attributes:
        path: Keys and indices from the top to the value, such as "buses[0].legs.lf"; empty for the text as a whole.
        message: The fault, and what would be right.
    """

    path: str
    message: str

    def __str__(self) -> str:
        """Return the error as one line: the path of the setting, then the message."""
        return f"{self.path}: {self.message}" if self.path else self.message


def load(
    source: Path | str | bytes,
    type_: type[T],
    where: str | None = None,
    check: Callable[[T], Problem | None] | None = None,
    check_plain: Callable[[object], Problem | None] | None = None,
) -> T:
    """Return the object that a YAML text describes, or raise an error with the place of the first fault.

    Args:
        source: A file to read if it is a `Path`, else the text itself.
        type_: The struct that the text has to fit.
        where: Name of the text in errors; the path of the file if not given.
        check: Finds the first contradiction between fields that are each right by themselves.
        check_plain: Finds in the plain data what is told in other words than that it does not fit.

    Raises:
        ConfigError: The text is missing, is not such YAML, does not fit `type_`, or contradicts itself.
    """
    if where is None:
        where = str(source) if isinstance(source, Path) else "<text>"
    try:
        reader = YamlReader(read_text(source))
        data = reader.read()
    except YamlError as fault:
        place = where if fault.line is None else f"{where}:{fault.line}"
        raise ConfigError(f"{place}: {fault}") from None
    try:
        problem = check_plain(data) if check_plain else None
        if not problem:
            result = msgspec.convert(data, type_)
            problem = check(result) if check else None
    except msgspec.ValidationError as error:
        problem = _first_problem(data, type_, "") or Problem("", str(error))
    if problem:
        raise ConfigError(f"{where}:{reader.line_of(problem.path)}: {problem}")
    return result


def _first_problem(value: Any, hint: Any, path: str) -> Problem | None:  # noqa: ANN401 - type hints
    """Return the first place where plain data do not fit a type, in plain words; None if they fit."""
    try:
        msgspec.convert(value, hint)
    except msgspec.ValidationError:
        pass
    else:
        return None
    structs = [part for part in _parts(hint) if hasattr(part, "__struct_fields__")]
    if isinstance(value, dict) and structs:
        return _struct_problem(value, structs, path)
    for part in _parts(hint):
        kind, arguments = get_origin(part), get_args(part)
        items: Iterable[tuple[str, Any, Any]] = ()
        if isinstance(value, dict) and kind is dict:
            keys = [(item_path(path, key), key, arguments[0]) for key in value]
            items = keys + [(item_path(path, key), item, arguments[1]) for key, item in value.items()]
        elif isinstance(value, list) and kind in (list, tuple):
            fixed = kind is tuple and arguments[-1] is not ...
            hints = arguments if fixed else arguments[:1] * len(value)
            items = (
                (f"{path}[{n}]", item, of_item)
                for n, (item, of_item) in enumerate(zip(value, hints, strict=False))
            )
        for place, item, of_item in items:
            if problem := _first_problem(item, of_item, place):
                return problem
    return Problem(path, _value_fault(value, inspect.type_info(hint)))


def _struct_problem(value: dict[str, Any], structs: Sequence[Any], path: str) -> Problem | None:
    """Return the first fault of a section that is one of some structs, by its tag if there are several."""
    tag = structs[0].__struct_config__.tag_field
    by_kind = {struct.__struct_config__.tag: struct for struct in structs}
    kind = None if tag is None else value.get(tag)
    if tag is not None and kind not in list(by_kind):  # a list may stand there, which has no hash
        if tag not in value:
            return Problem(path, f"the key {tag} is missing: one of {', '.join(by_kind)}")
        return Problem(item_path(path, tag), _word_fault(kind, list(by_kind)))
    fields = {field.encode_name: field for field in msgspec.structs.fields(by_kind[kind])}
    known = [*fields] if tag is None else [tag, *fields]
    for key in value:
        if key not in known:
            near = _nearest(key, known)
            remedy = f"did you mean {near}?" if near else f"there are {', '.join(known)}"
            return Problem(item_path(path, key), f"unknown key; {remedy}")
    for name, field in fields.items():
        if field.required and name not in value:
            return Problem(path, f"the key {name} is missing: {_wanted(inspect.type_info(field.type))}")
    problems = (
        _first_problem(value[name], field.type, item_path(path, name))
        for name, field in fields.items()
        if name in value
    )
    return next(filter(None, problems), None)


def _parts(hint: Any) -> list[Any]:  # noqa: ANN401
    """Return the types of a union, or the type itself, without their annotations."""
    if get_origin(hint) is Annotated:
        return _parts(get_args(hint)[0])
    return (
        [part for each in get_args(hint) for part in _parts(each)]
        if get_origin(hint) in (Union, UnionType)
        else [hint]
    )


def _value_fault(value: object, info: inspect.Type) -> str:
    """Return the message about a value that does not fit a type: what it is, and what would be right."""
    for type_, hint in _members(info):
        if isinstance(type_, inspect.LiteralType):
            return _word_fault(value, type_.values) + (f" ({hint})" if hint else "")
    got = "an empty value" if value is None else json.dumps(value)[:40]
    if isinstance(value, dict | list):
        got = f"a section of {len(value)} keys" if isinstance(value, dict) else f"a list of {len(value)}"
    return f"{got} is wrong; it has to be {_wanted(info)}"


def _members(info: inspect.Type, hint: str = "") -> list[tuple[inspect.Type, str]]:
    """Return the types of a union, or the type itself, each with its description."""
    if isinstance(info, inspect.Metadata):
        return _members(info.type, (info.extra_json_schema or {}).get("description", hint))
    types = info.types if isinstance(info, inspect.UnionType) else ()
    return [member for type_ in types for member in _members(type_, hint)] or [(info, hint)]


_TYPE_WORDS: dict[type, str] = {
    inspect.BoolType: "true or false",
    inspect.IntType: "a whole number",
    inspect.FloatType: "a number",
    inspect.StrType: "text",
    inspect.StructType: "a section of keys",
    inspect.DictType: "a section of keys",
    inspect.ListType: "a list",
    inspect.VarTupleType: "a list",
    inspect.TupleType: "a list",
}
_BOUND_WORDS = {
    "ge": " from {}",
    "gt": " above {}",
    "le": " to {}",
    "lt": ", below {}",
    "min_length": " of at least {}",
    "max_length": ", at most {}",
}


def _wanted(info: inspect.Type) -> str:
    """Return what a type accepts, in words: kind, bounds, and the description in the schema."""
    texts = []
    for type_, hint in _members(info):
        if isinstance(type_, inspect.LiteralType):
            texts.append(f"one of {', '.join(map(str, type_.values))}")
        elif isinstance(type_, inspect.StrType) and hint:
            texts.append(f"text {hint}" if hint.startswith("such as") else hint)
        elif type(type_) in _TYPE_WORDS:
            found = ((words, getattr(type_, name, None)) for name, words in _BOUND_WORDS.items())
            bounds = (
                words.format(f"{bound}".removesuffix(".0")) for words, bound in found if bound is not None
            )
            text = "".join([_TYPE_WORDS[type(type_)], *bounds, f" ({hint})" if hint else ""])
            texts.append(re.sub(r" of at least (\d+), at most \1\b", r" of \1", text))
    return ", or ".join(dict.fromkeys(texts))


def _word_fault(word: object, choices: Sequence[object]) -> str:
    """Return the message about a word that is none of the choices, with the nearest of them."""
    near = _nearest(str(word), [choice for choice in choices if isinstance(choice, str)])
    remedy = f"; did you mean {near}?" if near else ""
    return f"{str(word)[:40]!r} is none of {', '.join(map(str, choices))}{remedy}"


def _nearest(word: str, choices: Sequence[str]) -> str | None:
    """Return the choice that a word was probably meant for: of the same letters, or nearly so.

    Example:
        >>> _nearest("fl", ["lf", "rf"]), _nearest("scna", ["can", "scan"]), _nearest("x", ["lf"])
        ('lf', 'scan', None)
    """
    letters = sorted(word.lower())
    same = [choice for choice in choices if sorted(choice) == letters]
    return next(iter(same or get_close_matches(word.lower(), choices, n=1)), None)
