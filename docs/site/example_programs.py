"""The examples, each with what its first line says that it shows."""

import re
from pathlib import Path

from docstrings import table

_FOLDER = Path(__file__).parents[2] / "examples"
_FIRST_LINE = re.compile(r'\A(?:"""|/\* ?)(.+?)(?:""")?$', re.MULTILINE)


def markdown() -> str:
    """Return a table of all examples, with links from a page of `docs/reference`."""
    files = sorted(path for path in _FOLDER.iterdir() if path.suffix in {".py", ".c"})
    lines = [(path.name, _FIRST_LINE.match(path.read_text(encoding="utf-8"))) for path in files]
    rows = [[f"[{name}](../../examples/{name})", line[1]] for name, line in lines if line]
    return table(["example", "shows"], rows)
