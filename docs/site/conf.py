"""Settings of the documentation site; `make docs` builds it into build/site.

The pages are the Markdown files of the checkout where they lie, so that their links work in both places.
"""

import sys
from pathlib import Path

from sphinx.application import Sphinx

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT))

import footsense  # noqa: E402

project = "footsense"
author = "the authors of footsense"
release = version = footsense.__version__

extensions = ["myst_parser"]
root_doc = "docs/index"
include_patterns = [
    "docs/**",
    "deploy/README.md",
    "firmware_interface/**.md",
    "models/**.md",
    "tests/kernel/README.md",
    "*.md",
]
exclude_patterns = [".*", "build", "dist", "footsense", "tests/golden", "docs/site"]

myst_enable_extensions = ["colon_fence"]
myst_heading_anchors = 4
# Pages begin where they need to; a link to a file of the checkout is a download of it.
suppress_warnings = ["myst.header"]

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

#: Lists of pages that the site needs and a reader of the checkout does not.
_ADDED = {"docs/report/README": "```{toctree}\n:glob:\n:hidden:\n\n*\n```\n"}


def _add_lists(app: Sphinx, page: str, source: list[str]) -> None:
    del app
    source[0] += _ADDED.get(page, "")


def setup(app: Sphinx) -> None:
    """Connect what changes a page on its way to the site."""
    app.connect("source-read", _add_lists)
