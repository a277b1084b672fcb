"""Print the words of the pages written by hand, by folder: `python -m tests.support.words`.

Not counted: parts that `reference.py` generates, and tables of the report, whose cells code fills.
"""

import re
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).parents[2]
_GENERATED = re.compile(r"<!-- generated:.*?<!-- end -->|<!--.*?-->", re.DOTALL)
_TABLE_ROW = re.compile(r"^\|.*$", re.MULTILINE)
_WORD = re.compile(r"\S*\w\S*")
_OUTSIDE = ("README.md", "CONTRIBUTING.md", "SECURITY.md", "deploy/**/*.md", "firmware_interface/**/*.md")


def words() -> Counter[str]:
    """Return the number of words written by hand in each folder."""
    found: Counter[str] = Counter()
    pages = [*ROOT.glob("docs/**/*.md"), *(page for pattern in _OUTSIDE for page in ROOT.glob(pattern))]
    for page in pages:
        folder = str(page.parent.relative_to(ROOT))
        text = _GENERATED.sub("", page.read_text(encoding="utf-8"))
        if folder == "docs/report":
            text = _TABLE_ROW.sub("", text)
        found[folder] += len(_WORD.findall(text))
    return found


if __name__ == "__main__":
    found = words()
    for folder, number in sorted(found.items()):
        print(f"{number:6}  {folder}")
    print(f"{found.total():6}  in total")
