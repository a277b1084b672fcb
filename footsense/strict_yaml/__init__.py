"""YAML text to frozen msgspec structs, or one line that says where the text is wrong and what would be right.

It exists because a typo in a robot's configuration must not become a default: an unknown, missing or doubled
key, a wrong type and a value out of range are errors that name the file, the line and the path of keys.
Declare the structs with `frozen=True, forbid_unknown_fields=True`; a `msgspec.Meta(description=...)` of a
field is quoted in the error as the reason for its range.

It leaves out what makes YAML surprising: merge keys, dates, tags, several documents, NaN and infinities.
"""

from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import TypeVar

import msgspec

from footsense.errors import ConfigError
from footsense.strict_yaml.nodes import Document, YamlError, parse
from footsense.strict_yaml.wording import Problem, dotted, first_problem

__all__ = ["MAX_BYTES", "Problem", "load"]

T = TypeVar("T")

#: Longest text that is read [bytes]; a hand-written file has a few thousand.
MAX_BYTES = 262_144


def load(
    source: Path | str | bytes,
    type_: type[T],
    where: str | None = None,
    check: Callable[[T], Problem | None] | None = None,
    old_keys: Mapping[tuple[str, ...], str] = MappingProxyType({}),
) -> T:
    """Return the object that a YAML text describes.

    Args:
        source: A file to read if it is a `Path`, else the text itself.
        type_: The struct that the text has to fit.
        where: Name of the text in errors; the path of the file if not given.
        check: Finds the first contradiction between fields that are each right by themselves.
        old_keys: Paths of keys of earlier versions, each with the message that names what replaces it.

    Returns:
        The object.

    Raises:
        ConfigError: The text is missing, is not such YAML, does not fit `type_`, or contradicts itself.
    """
    if where is None:
        where = str(source) if isinstance(source, Path) else "<text>"
    try:
        document = parse(_text(source))
    except YamlError as fault:
        raise ConfigError(_line(where, fault.line, "", str(fault))) from None
    for path, message in old_keys.items():
        if _has(document.data, path):
            raise ConfigError(_located(where, document, Problem(path, message)))
    try:
        result = msgspec.convert(document.data, type_)
    except msgspec.ValidationError as error:
        problem = first_problem(document.data, type_) or Problem((), str(error).replace("`", ""))
        raise ConfigError(_located(where, document, problem)) from None
    contradiction = check(result) if check else None
    if contradiction:
        raise ConfigError(_located(where, document, contradiction))
    return result


def _text(source: Path | str | bytes) -> str:
    try:
        data = source.read_bytes() if isinstance(source, Path) else source
        if len(data) > MAX_BYTES:
            raise YamlError(f"has {len(data)} bytes; at most {MAX_BYTES} are read")
        return data.decode() if isinstance(data, bytes) else data
    except UnicodeDecodeError as error:
        raise YamlError(
            f"is not UTF-8 text: byte {error.start} is {error.object[error.start]:#04x}"
        ) from None
    except FileNotFoundError:
        raise YamlError("no such file") from None
    except (OSError, ValueError) as error:  # ValueError: a path with a null character
        raise YamlError(f"cannot be read: {getattr(error, 'strerror', None) or error}") from None


def _has(data: object, path: tuple[str, ...]) -> bool:
    for key in path:
        if not (isinstance(data, dict) and key in data):
            return False
        data = data[key]
    return True


def _located(where: str, document: Document, problem: Problem) -> str:
    return _line(where, document.line_of(problem.path), dotted(problem.path), problem.message)


def _line(where: str, line: int | None, path: str, message: str) -> str:
    place = where if line is None else f"{where}, line {line}"
    text = f"{place}: {path}: {message}" if path else f"{place}: {message}"
    return " ".join(text.split())
