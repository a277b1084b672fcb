"""A C header as Markdown: each declaration under the comment that explains it."""

import re
from pathlib import Path

_COMMENT = re.compile(r"^/\*\s?(.*?)\s*\*/$", re.DOTALL | re.MULTILINE)
#: Lines that no reader of the interface needs.
_FRAME = re.compile(
    r"^#ifdef __cplusplus\n(?:extern \"C\" \{|\})\n#endif$|^#ifndef \w+_H\n#define \w+_H$|^#include .*$|^#endif$",
    re.MULTILINE,
)
_DRAWING = re.compile(r"(?:^ {4,}.*\n)+", re.MULTILINE)


def markdown(header: Path) -> str:
    """Return what a header declares, in its order."""
    # Comments at the beginning of a line stand at the odd places.
    pieces = _COMMENT.split(header.read_text(encoding="utf-8"))
    parts = [f"## `{header.name}`\n"]
    for at, piece in enumerate(pieces):
        if at % 2:
            parts.append(_words(piece))
        elif code := _FRAME.sub("", piece).strip():
            tight = re.sub(r"\n{3,}", "\n\n", code)
            parts.append(f"```c\n{tight}\n```\n")
    return "\n".join(parts)


def _words(comment: str) -> str:
    """Return a comment as Markdown; drawings, which are indented, stay as they are."""
    lines = "".join(re.sub(r"^\s*\* ?", "", line) + "\n" for line in comment.split("\n"))
    return _DRAWING.sub(lambda block: f"\n```text\n{block[0].rstrip()}\n```\n", lines)
