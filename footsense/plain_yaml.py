"""Parse YAML text to plain Python data with the line number of every value; no other file imports yaml.

Not supported, because it makes YAML surprising, or a short text a large one: aliases, merge keys, tags, dates, several
documents, NaN and infinities.
"""

import math
import os
import re
from pathlib import Path
from typing import Any

import yaml

from footsense.regular_file import open_regular, read_regular

#: Longest text that is read [bytes]; a hand-written file has a few thousand.
MAX_BYTES = 262_144
#: How a recording begins, which is taken for a robot's file at times.
_MCAP_MAGIC = b"\x89MCAP0\r\n"
#: Deepest nesting: the reader recurses.
MAX_DEPTH = 30

_PLAIN_KEY_PATTERN = re.compile(r"[\w-]+")
_INDENTED_WITH_TAB = re.compile(r" *\t")
_TAG_PREFIX = "tag:yaml.org,2002:"
#: The C parser is seven times as fast, but not in every build of PyYAML.
_Loader: type[yaml.SafeLoader] = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


def item_path(path: str, key: str) -> str:
    """Return the path of the item `key` of the mapping at `path`."""
    return f"{path}.{key}" if path else key


class YamlError(Exception):
    """The text is not valid YAML, or uses an unsupported feature; `line` counts from 1, None where there is none."""

    def __init__(self, message: str, line: int | None = None) -> None:
        super().__init__(message)
        self.line = line


def read_text(source: Path | str | bytes) -> str:
    """Return the text of a path, string or bytes.

    Raises:
        YamlError: It cannot be read, is too large, or is not UTF-8.
    """
    try:
        if isinstance(source, Path):
            with os.fdopen(open_regular(source), "rb") as file:
                if file.read(len(_MCAP_MAGIC)) == _MCAP_MAGIC:
                    raise YamlError(f"is a recording; what is in it tells: footsense info {source}")
            source = read_regular(source, MAX_BYTES)
        if len(source) > MAX_BYTES:
            raise YamlError(f"has more than the {MAX_BYTES} bytes that are read")
        return source.decode() if isinstance(source, bytes) else source
    except UnicodeDecodeError as error:
        raise YamlError(
            f"is not UTF-8 text: byte {error.start} is {error.object[error.start]:#04x}"
        ) from None
    except FileNotFoundError:
        raise YamlError("no such file") from None
    except OSError as error:
        raise YamlError(f"cannot be read: {error.strerror}") from None


class YamlReader:
    """Reads the events of one YAML document as plain data, and keeps the line of every value by its path."""

    def __init__(self, text: str) -> None:
        self._text = text
        self._loader: Any = None
        self._line_by_path: dict[str, int] = {}

    def line_of(self, path: str) -> int:
        """Return the line number, from 1, of the value at `path`, or of the nearest enclosing value."""
        while path not in self._line_by_path:
            path = path[: max(path.rfind("."), path.rfind("["), 0)]
        return self._line_by_path[path]

    def read(self) -> object:
        """Return the data of the document: dicts with text keys, lists and scalars.

        Raises:
            YamlError: The text is not YAML, is empty, or uses an unsupported feature.
        """
        try:
            self._loader = _Loader(self._text)
            self._loader.get_event()  # start of the stream
            if self._loader.check_event(yaml.StreamEndEvent):
                raise YamlError("is empty")
            self._loader.get_event()  # start of the document
            data = self._value("", 0)
            self._loader.get_event()
            if not self._loader.check_event(yaml.StreamEndEvent):
                raise YamlError("holds several documents, separated by ---; one is read")
        except (yaml.YAMLError, ValueError, LookupError) as error:  # int() refuses thousands of digits
            mark = getattr(error, "problem_mark", None)
            line = _line(mark) if mark else None
            if line and _INDENTED_WITH_TAB.match("".join(self._text.splitlines()[line - 1 : line])):
                raise YamlError("the line begins with a tab; YAML is indented with spaces", line) from None
            problem = getattr(error, "problem", None) or error
            raise YamlError(f"is not valid YAML, here or just above: {problem}", line) from None
        if data is None:
            raise YamlError("is empty")
        return data

    def _value(self, path: str, depth: int) -> object:
        event = self._loader.get_event()
        line = _line(event.start_mark)
        self._line_by_path.setdefault(path, line)
        if isinstance(event, yaml.AliasEvent) or event.anchor:
            raise YamlError("aliases (& and *) are not supported; write the values out", line)
        if event.tag:
            raise YamlError(f"the tag {event.tag[:40]} is not supported; take it away", line)
        if depth > MAX_DEPTH:
            raise YamlError(f"is nested deeper than {MAX_DEPTH} levels", line)
        if isinstance(event, yaml.SequenceStartEvent):
            items: list[object] = []
            while not self._loader.check_event(yaml.SequenceEndEvent):
                items.append(self._value(f"{path}[{len(items)}]", depth + 1))
            self._loader.get_event()
            return items
        return (
            self._mapping(path, depth) if isinstance(event, yaml.MappingStartEvent) else self._scalar(event)
        )

    def _mapping(self, path: str, depth: int) -> dict[str, object]:
        data: dict[str, object] = {}
        while not self._loader.check_event(yaml.MappingEndEvent):
            event = self._loader.get_event()
            line = _line(event.start_mark)
            key = event.value if isinstance(event, yaml.ScalarEvent) else "a section or list"
            if not _PLAIN_KEY_PATTERN.fullmatch(key):
                raise YamlError(f"a key has to be a single word, not {key[:40]!r}", line)
            place = item_path(path, key)
            if key in data:
                raise YamlError(
                    f"the key {key!r} stands twice, first on line {self._line_by_path[place]}", line
                )
            self._line_by_path[place] = line
            data[key] = self._value(place, depth + 1)
        self._loader.get_event()
        return data

    def _scalar(self, event: yaml.ScalarEvent) -> object:
        tag = self._loader.resolve(yaml.ScalarNode, event.value, event.implicit)
        kind = tag.removeprefix(_TAG_PREFIX)
        if kind not in ("str", "int", "float", "bool", "null"):
            line = _line(event.start_mark)
            raise YamlError(f"{event.value[:40]!r} reads as a {kind}, which is not supported; quote it", line)
        value: object = self._loader.construct_object(yaml.ScalarNode(tag, event.value))
        if isinstance(value, float) and not math.isfinite(value):
            raise YamlError(f"{event.value} is not a finite number", _line(event.start_mark))
        return value


def _line(mark: Any) -> int:  # noqa: ANN401 - the two parsers of PyYAML have each their own class
    return int(mark.line) + 1
