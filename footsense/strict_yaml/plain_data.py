"""Parse YAML text to plain Python data with the line number of every value; no other file imports yaml."""

import math
import re
from pathlib import Path
from typing import Any, NamedTuple

import yaml

#: Longest text that is read [bytes]; a hand-written file has a few thousand.
MAX_BYTES = 262_144

#: Deepest nesting; the composer recurses in C and would overflow the stack of the process.
MAX_DEPTH = 30

#: Most values, each use of an alias counted: a text of ten lines can stand for 10^9 of them.
MAX_VALUES = 50_000

_PLAIN_KEY_PATTERN = re.compile(r"[\w-]+")
_YAML_TAG_PREFIX = "tag:yaml.org,2002:"
_ALLOWED_TAGS = {
    yaml.MappingNode: {"map"},
    yaml.SequenceNode: {"seq"},
    yaml.ScalarNode: {"str", "int", "float", "bool", "null"},
}

#: The C parser is seven times as fast, but not in every build of PyYAML.
_Loader: type[yaml.SafeLoader] = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


class YamlError(Exception):
    """The text is not valid YAML, or uses an unsupported feature.

    Attributes:
        line: Line of the fault, from 1; None where there is none.
    """

    def __init__(self, message: str, line: int | None = None) -> None:
        super().__init__(message)
        self.line = line


class PlainData(NamedTuple):
    """Python data of one YAML text, with the line number of each key.

    Attributes:
        root_value: Dicts with text keys, lists and scalars.
        line_by_path: Line of every value, from 1, by its path, such as "buses[0].legs"; of a dict's item that of its
            key.
    """

    root_value: object
    line_by_path: dict[str, int]

    def line_of(self, path: str) -> int:
        """Return the line number, from 1, of the value at `path`, or of the nearest enclosing value."""
        while path not in self.line_by_path:
            path = path[: max(path.rfind("."), path.rfind("["), 0)]
        return self.line_by_path[path]


def item_path(path: str, key: str | int) -> str:
    """Return the path of the item `key` of the value at `path`.

    Example:
        >>> item_path(item_path("legs", 2), "lf")
        'legs[2].lf'
    """
    return f"{path}[{key}]" if isinstance(key, int) else f"{path}.{key}" if path else key


def read_yaml(source: Path | str | bytes) -> PlainData:
    """Parse the YAML text of a single document; return its plain data with line numbers.

    Args:
        source: A file to read if it is a `Path`, else the text itself.

    Raises:
        YamlError: The file cannot be read, or the text is not YAML, is empty, or uses an unsupported feature.
    """
    text = _read_text(source)
    lines: dict[str, int] = {}
    try:
        _check_depth(text)
        loader = _Loader(text)
        root = loader.get_single_node()
        if root is None:
            raise YamlError("is empty")
        data = _plain_value(root, "", 0, _line_number(root.start_mark), loader, lines)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        fault = ", ".join(part for part in (error.context, error.problem) if part)
        raise YamlError(f"is not valid YAML: {fault}", _line_number(mark) if mark else None) from None
    except (yaml.YAMLError, ValueError, LookupError, RecursionError) as error:
        # Numbers go through int() and float(), which refuse thousands of digits.
        raise YamlError(f"is not valid YAML: {error}") from None
    if data is None:
        raise YamlError("is empty")
    return PlainData(data, lines)


def _read_text(source: Path | str | bytes) -> str:
    """Return the text of a path, string or bytes.

    Raises:
        YamlError: It cannot be read, is too large, or is not UTF-8.
    """
    try:
        if isinstance(source, Path):
            with source.open("rb") as file:
                data: str | bytes = file.read(MAX_BYTES + 1)
        else:
            data = source
        if len(data) > MAX_BYTES:
            raise YamlError(f"has more than the {MAX_BYTES} bytes that are read")
        return data.decode() if isinstance(data, bytes) else data
    except UnicodeDecodeError as error:
        raise YamlError(
            f"is not UTF-8 text: byte {error.start} is {error.object[error.start]:#04x}"
        ) from None
    except FileNotFoundError:
        raise YamlError("no such file") from None
    except (OSError, ValueError) as error:  # ValueError: a path with a null character
        raise YamlError(f"cannot be read: {getattr(error, 'strerror', None) or error}") from None


def _check_depth(text: str) -> None:
    """Raise an error if the YAML text is nested too deeply, before any nodes are built.

    Raises:
        YamlError: It is deeper than `MAX_DEPTH`.
    """
    depth = 0
    for event in yaml.parse(text, Loader=_Loader):
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        if depth > MAX_DEPTH:
            raise YamlError(f"is nested deeper than {MAX_DEPTH} levels", _line_number(event.start_mark))


def _plain_value(
    node: yaml.Node, path: str, depth: int, line: int, loader: yaml.SafeLoader, lines: dict[str, int]
) -> object:
    """Return the Python value of a YAML node, aliases expanded, and store the line numbers in `lines`.

    Raises:
        YamlError: A value uses an unsupported feature, or there are too many.
    """
    if len(lines) >= MAX_VALUES or depth > MAX_DEPTH:
        raise YamlError(
            f"stands for more than {MAX_VALUES} values or {MAX_DEPTH} levels: aliases multiply", line
        )
    lines[path] = line
    kind = node.tag.removeprefix(_YAML_TAG_PREFIX)
    if kind not in _ALLOWED_TAGS[type(node)]:
        raise YamlError(f"{str(node.value)[:40]!r} reads as a {kind}, which is not supported; quote it", line)
    if isinstance(node, yaml.SequenceNode):
        return [
            _plain_value(item, item_path(path, n), depth + 1, _line_number(item.start_mark), loader, lines)
            for n, item in enumerate(node.value)
        ]
    if isinstance(node, yaml.MappingNode):
        return _plain_mapping(node, path, depth, loader, lines)
    value = loader.construct_object(node)
    if isinstance(value, float) and not math.isfinite(value):
        raise YamlError(f"{node.value} is not a finite number", line)
    return value


def _plain_mapping(
    node: yaml.MappingNode, path: str, depth: int, loader: yaml.SafeLoader, lines: dict[str, int]
) -> dict[str, object]:
    """Return a YAML mapping as a dict; a duplicate key is an error.

    Raises:
        YamlError: A key stands twice, is not a word, or is the merge key; or as `_plain_value`.
    """
    data: dict[str, object] = {}
    for key, item in node.value:
        line = _line_number(key.start_mark)
        if key.tag == f"{_YAML_TAG_PREFIX}merge":
            raise YamlError("the merge key << is not supported; write the keys out", line)
        if not isinstance(key, yaml.ScalarNode) or not _PLAIN_KEY_PATTERN.fullmatch(key.value):
            raise YamlError("a key has to be a single word", line)
        place = item_path(path, key.value)
        if key.value in data:
            raise YamlError(f"the key {key.value!r} stands twice, first on line {lines[place]}", line)
        data[key.value] = _plain_value(item, place, depth + 1, line, loader, lines)
    return data


def _line_number(mark: Any) -> int:  # noqa: ANN401 - the two parsers of PyYAML have each their own class
    """Return the line number, from 1, of a YAML mark."""
    return int(mark.line) + 1
