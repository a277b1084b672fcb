"""The only file that imports yaml: text to plain data, with the line of every value."""

import math
from collections.abc import Iterator
from typing import Protocol

import yaml

__all__ = ["Document", "YamlError", "parse"]

#: Deepest nesting; the composer recurses in C and would take the whole process down.
MAX_DEPTH = 30

#: Most values, each use of an alias counted: a text of ten lines can stand for 10^9 of them.
MAX_VALUES = 50_000

_PLAIN = tuple(f"tag:yaml.org,2002:{kind}" for kind in ("map", "seq", "str", "int", "float", "bool", "null"))
_MERGE = "tag:yaml.org,2002:merge"
_FLOAT = "tag:yaml.org,2002:float"

#: The C parser is seven times as fast, but not in every build of PyYAML.
_Loader: type[yaml.SafeLoader] = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


class YamlError(Exception):
    """The text is not such YAML as is read here.

    Attributes:
        line: Line of the fault, from 1; None where there is none.
    """

    def __init__(self, message: str, line: int | None = None) -> None:
        super().__init__(message)
        self.line = line


class Document:
    """One parsed text.

    Attributes:
        data: The same as plain dicts, lists and scalars.
    """

    def __init__(self, data: object, root: yaml.Node) -> None:
        self.data = data
        self._root = root

    def line_of(self, path: tuple[str | int, ...]) -> int:
        """Return the line, from 1, of the value at `path`, or of the nearest one that encloses it."""
        node, line = self._root, self._root.start_mark.line
        for step in path:
            if isinstance(node, yaml.MappingNode):
                found = next(((k, v) for k, v in node.value if k.value == str(step)), None)
                if found is None:
                    break
                line, node = found[0].start_mark.line, found[1]
            elif isinstance(node, yaml.SequenceNode) and isinstance(step, int) and step < len(node.value):
                node = node.value[step]
                line = node.start_mark.line
            else:
                break
        return int(line) + 1


def parse(text: str) -> Document:
    """Return the one document of a YAML text.

    Args:
        text: The text.

    Returns:
        Its data and lines.

    Raises:
        YamlError: It is not YAML, is empty, or uses what is not supported here.
    """
    try:
        _check_depth(text)
        loader = _Loader(text)
        root = loader.get_single_node()
        if root is None:
            raise YamlError("is empty")
        _check_values(root, 0, iter(range(MAX_VALUES)))
        data = loader.construct_document(root)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        what = ", ".join(part for part in (error.context, error.problem) if part)
        raise YamlError(f"is not valid YAML: {what}", _line(mark)) from None
    except (yaml.YAMLError, ValueError, LookupError, RecursionError) as error:
        # Text that resolves to a number goes through int() and float(), which have limits of their own.
        raise YamlError(f"is not valid YAML: {error}") from None
    if data is None:
        raise YamlError("is empty")
    return Document(data, root)


def _check_depth(text: str) -> None:
    """Follow the nesting without building anything.

    Raises:
        YamlError: It is deeper than `MAX_DEPTH`.
    """
    depth = 0
    for event in yaml.parse(text, Loader=_Loader):
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        if depth > MAX_DEPTH:
            raise YamlError(f"is nested deeper than {MAX_DEPTH} levels", _line(event.start_mark))


def _check_values(node: yaml.Node, depth: int, budget: Iterator[int]) -> None:
    """Check every value below a node, as often as aliases repeat it.

    Raises:
        YamlError: A value uses what is not supported, or there are too many.
    """
    line = _line(node.start_mark)
    if next(budget, None) is None or depth > MAX_DEPTH:
        raise YamlError(
            f"stands for more than {MAX_VALUES} values or {MAX_DEPTH} levels: aliases multiply", line
        )
    if node.tag not in _PLAIN:
        kind = node.tag.rpartition(":")[2]
        raise YamlError(f"{str(node.value)[:40]!r} reads as a {kind}, which is not supported; quote it", line)
    if isinstance(node, yaml.ScalarNode):
        if node.tag == _FLOAT and not math.isfinite(_Loader("").construct_yaml_float(node)):
            raise YamlError(f"{node.value} is not a finite number", line)
    elif isinstance(node, yaml.MappingNode):
        _check_keys(node)
        for key, value in node.value:
            _check_values(key, depth + 1, budget)
            _check_values(value, depth + 1, budget)
    else:
        for item in node.value:
            _check_values(item, depth + 1, budget)


def _check_keys(mapping: yaml.MappingNode) -> None:
    """Check the keys of one mapping; PyYAML would let the last of two equal ones win.

    Raises:
        YamlError: A key stands twice, is not a word, or is the merge key.
    """
    seen: dict[str, int] = {}
    for key, _ in mapping.value:
        line = _line(key.start_mark)
        if key.tag == _MERGE:
            raise YamlError("the merge key << is not supported; write the keys out", line)
        if not isinstance(key, yaml.ScalarNode):
            raise YamlError("a key has to be a single word", line)
        if key.value in seen:
            raise YamlError(f"the key {key.value!r} stands twice, first on line {seen[key.value]}", line)
        seen[key.value] = line or 0


class _Mark(Protocol):
    """A place in the text; the two parsers of PyYAML have each their own class."""

    line: int


def _line(mark: _Mark | None) -> int | None:
    return None if mark is None else mark.line + 1
