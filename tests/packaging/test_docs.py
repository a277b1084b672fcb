"""What the documentation names exists."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGES = sorted(
    path.relative_to(ROOT)
    for pattern in ("*.md", "deploy/*.md", "docs/*.md", "docs/adr/*.md", "firmware_interface/**/*.md")
    for path in ROOT.glob(pattern)
    if path.name != "CHANGELOG.md"
)
_LINK = re.compile(r"\]\(([^)#:\s]+)(?:#[^)]*)?\)")
_PATH = re.compile(
    r"`((?:[\w.-]+/)+[\w.-]*\.(?:py|md|yaml|c|h|dbc|toml|csv|onnx|npz|network|service|rules))`"
)
#: Folders that a path in the text may start from, beside the page's own.
_STARTS = (
    "",
    "footsense",
    "footsense/acquisition",
    "footsense/estimation",
    "footsense/sim",
    "footsense/lab",
    "firmware_interface",
)


@pytest.mark.parametrize("page", PAGES, ids=str)
def test_links_and_paths_of_a_page_exist(page: Path) -> None:
    """A link leads to a file of the checkout, and a path in backticks is one of it."""
    text = (ROOT / page).read_text(encoding="utf-8")
    here = (ROOT / page).parent
    missing = [link for link in _LINK.findall(text) if not (here / link).exists()]
    for path in _PATH.findall(text):
        found = (here / path).exists() or any((ROOT / start / path).exists() for start in _STARTS)
        if not found and not path.startswith(("my-", "walk", "/")):
            missing.append(path)
    assert not missing


def test_documents_that_code_refers_to_exist() -> None:
    """Docstrings and comments name documents by path, decisions by number."""
    missing = []
    for path in (*ROOT.glob("footsense/**/*.py"), *ROOT.glob("firmware_interface/**/*.[pch]*")):
        for named in re.findall(r"\bdocs/[\w./-]*\w", path.read_text(encoding="utf-8", errors="ignore")):
            made_by_a_command = named.startswith("docs/report-quick")
            if not made_by_a_command and not (ROOT / named).exists() and not list(ROOT.glob(f"{named}*")):
                missing.append(f"{path.relative_to(ROOT)}: {named}")
    assert not missing
