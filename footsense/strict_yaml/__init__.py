"""Load YAML text into frozen msgspec structs; errors are one line of text with path and line number.

A typo in a robot's configuration must not become a default: an unknown, missing or doubled key, a wrong type and
a value out of range are errors that name the file, the line and the path of keys. Declare the structs with
`frozen=True, forbid_unknown_fields=True`; the error quotes the `msgspec.Meta(description=...)` of a field.

Not supported, because it makes YAML surprising: merge keys, dates, tags, several documents, NaN and infinities.
"""

from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import msgspec

from footsense.errors import ConfigError
from footsense.strict_yaml.error_details import Problem, problem_from_error
from footsense.strict_yaml.plain_data import MAX_BYTES, YamlError, read_yaml

__all__ = ["MAX_BYTES", "Problem", "load"]

T = TypeVar("T")


def load(
    source: Path | str | bytes,
    type_: type[T],
    where: str | None = None,
    check: Callable[[T], Problem | None] | None = None,
) -> T:
    """Return the object that a YAML text describes, or raise an error with the place of the first fault.

    Args:
        source: A file to read if it is a `Path`, else the text itself.
        type_: The struct that the text has to fit.
        where: Name of the text in errors; the path of the file if not given.
        check: Finds the first contradiction between fields that are each right by themselves.

    Raises:
        ConfigError: The text is missing, is not such YAML, does not fit `type_`, or contradicts itself.
    """
    if where is None:
        where = str(source) if isinstance(source, Path) else "<text>"
    try:
        text = read_yaml(source)
    except YamlError as fault:
        place = where if fault.line is None else f"{where}:{fault.line}"
        raise ConfigError(f"{place}: {fault}") from None
    try:
        result = msgspec.convert(text.root_value, type_)
        problem = check(result) if check else None
    except msgspec.ValidationError as error:
        problem = problem_from_error(text.root_value, type_, str(error))
    if problem:
        raise ConfigError(f"{where}:{text.line_of(problem.path)}: {problem}")
    return result
