"""Descriptions of attributes, from the Google docstring of their class."""

import inspect
import re
from collections.abc import Sequence

_ATTRIBUTE = re.compile(r"^    (\w+): (.*?)(?=^    \w+: |^\S|\Z)", re.MULTILINE | re.DOTALL)


def attributes(documented: type) -> dict[str, str]:
    """Return the description of each attribute, on one line.

    Raises:
        ValueError: The docstring has no attributes.
    """
    text = inspect.cleandoc(documented.__doc__ or "")
    _, found, section = text.partition("Attributes:\n")
    if not found:
        raise ValueError(f"{documented.__name__} does not document its attributes")
    return {name: " ".join(words.split()) for name, words in _ATTRIBUTE.findall(section)}


def cell(text: object) -> str:
    """Return a text as a cell of a Markdown table."""
    return str(text).replace("|", "\\|").replace("\n", " ")


def table(header: list[str], rows: Sequence[Sequence[object]]) -> str:
    """Return a Markdown table."""
    lines: list[Sequence[object]] = [header, ["---"] * len(header), *rows]
    return "\n".join("| " + " | ".join(cell(value) for value in line) + " |" for line in lines) + "\n"
