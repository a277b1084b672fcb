"""Write what documents take from the code and from the report, or say which are not what these give.

A page has a generated part between a line `<!-- generated: NAME -->`, or with an argument behind the name, and a line
`<!-- end -->`; a figure of the report as `figures.py` says; what stands around them is written by hand. Pages of the
report are written by `footsense lab report --text`. `make docs` does both, and tests check it.
"""

import re
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import c_headers
import can_frames
import commands
import configuration
import example_programs
import figures
import leg_words
import metrics
import python_api
import recordings
import scenes

ROOT = Path(__file__).parents[2]
PAGES = ROOT / "docs"

_PART = re.compile(
    r"^(?P<mark><!-- generated: (?P<name>[\w-]+)(?: (?P<argument>\S+))? -->)\n.*?^<!-- end -->$",
    re.MULTILINE | re.DOTALL,
)
_GENERATORS: dict[str, Callable[..., str]] = {
    "c-header": lambda path: c_headers.markdown(ROOT / path),
    "can-frames": can_frames.markdown,
    "causes": leg_words.causes,
    "commands": commands.markdown,
    "configuration": configuration.markdown,
    "examples": example_programs.markdown,
    "metrics": metrics.markdown,
    "python": python_api.markdown,
    "recordings": recordings.markdown,
    "scene": scenes.markdown,
    "scene-faults": scenes.faults,
    "states": leg_words.states,
    **figures.TABLES,
}
#: Documents that are no pages of the site.
_OTHERS = ("README.md", "CHANGELOG.md", "deploy/README.md", "models/*/README.md")


def _generated(part: re.Match[str]) -> str:
    arguments = [part["argument"]] if part["argument"] else []
    return f"{part['mark']}\n\n{_GENERATORS[part['name']](*arguments).strip()}\n\n<!-- end -->"


def outdated() -> Iterator[tuple[Path, str]]:
    """Yield each page whose generated parts are not what the code gives, with its text as it should be."""
    for path in sorted([*PAGES.rglob("*.md"), *(path for one in _OTHERS for path in ROOT.glob(one))]):
        text = path.read_text(encoding="utf-8")
        current = figures.filled(_PART.sub(_generated, text), str(path.relative_to(ROOT)))
        if current != text:
            yield path, current


if __name__ == "__main__":
    pages = list(outdated())
    if sys.argv[1:] == ["--check"]:
        if pages:
            names = ", ".join(str(path.relative_to(ROOT)) for path, _ in pages)
            sys.exit(f"{names}: not what the code says; run `make docs`, and commit what it writes")
    else:
        for path, text in pages:
            path.write_text(text, encoding="utf-8")
            print(path.relative_to(ROOT))
