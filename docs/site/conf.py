"""Settings of the documentation site; `make docs` builds it into build/site.

The pages are the Markdown files of the checkout where they lie, so that their links work in both places. A line
`<!-- generated: NAME -->` in a page is replaced by reference material that the code of the same checkout gives.
"""

import re
import sys
from collections.abc import Callable
from pathlib import Path

from sphinx.application import Sphinx

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(Path(__file__).parent), str(ROOT)]

import c_headers  # noqa: E402 - from this folder
import can_frames  # noqa: E402
import configuration  # noqa: E402
import metrics  # noqa: E402
import recordings  # noqa: E402

import footsense  # noqa: E402

project = "footsense"
author = "the authors of footsense"
release = version = footsense.__version__

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx_click"]
root_doc = "docs/index"
include_patterns = [
    "docs/**",
    "deploy/README.md",
    "firmware_interface/**.md",
    "models/**.md",
    "CHANGELOG.md",
    "CONTRIBUTING.md",
]
exclude_patterns = [".*", "build", "dist", "footsense", "tests/golden", "docs/site"]

myst_enable_extensions = ["colon_fence"]
myst_heading_anchors = 4
# Pages begin where they need to; a link to a file of the checkout is a download of it.
suppress_warnings = ["myst.header"]

autodoc_member_order = "bysource"
autodoc_typehints = "description"
autodoc_typehints_description_target = "documented"
# One backtick in a docstring marks code.
default_role = "code"
napoleon_use_ivar = True

html_theme = "furo"
html_title = f"footsense {release}"
html_static_path = ["static"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_sphinx = False
html_show_copyright = False
pygments_style = "friendly"
pygments_dark_style = "monokai"
linkcheck_ignore = [r"http://127\.0\.0\.1.*"]

_MARK = re.compile(r"^<!-- generated: ([\w-]+)(?: (\S+))? -->$", re.MULTILINE)
#: Lists of pages that the site needs and a reader of the checkout does not.
_ADDED = {"docs/report/README": "```{toctree}\n:glob:\n:hidden:\n\n*\n```\n"}
_GENERATORS: dict[str, Callable[..., str]] = {
    "configuration": configuration.markdown,
    "can-frames": can_frames.markdown,
    "metrics": metrics.markdown,
    "recordings": recordings.markdown,
    "c-header": c_headers.markdown,
}


def _insert_generated(app: Sphinx, page: str, source: list[str]) -> None:
    """Replace the marks of a page by generated Markdown."""
    del app

    def generated(mark: re.Match[str]) -> str:
        name, argument = mark.groups()
        return _GENERATORS[name](ROOT / argument) if argument else _GENERATORS[name]()

    source[0] = _MARK.sub(generated, source[0]) + _ADDED.get(page, "")


def _skip_fields(app: Sphinx, kind: str, name: str, member: object, *_: object) -> bool | None:
    """Leave out the fields of a named tuple: its docstring has them with their meaning."""
    del app, kind, name
    return True if type(member).__name__ == "_tuplegetter" else None


def setup(app: Sphinx) -> None:
    """Connect the generators."""
    app.connect("source-read", _insert_generated)
    app.connect("autodoc-skip-member", _skip_fields)
