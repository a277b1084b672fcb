"""Headline figures of the studies in their quick form, kept so that a change of code that moves a page is told.

    python -m tests.lab.quick_figures [STUDY ...]    computes them anew; all without a name

The seeds are those of the studies. Left out are studies of times, and those that train from a random start, whose last
bits another processor makes another network.
"""

import json
import re
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path

from footsense.lab.report import StudyContext, Values, make_page, targets_of

_FILE = Path(__file__).with_suffix(".json")
_FOOT = Path(__file__).parents[2] / "models" / "aoyagi-3x3"
#: Studies with targets whose quick form gives the same on each processor.
REPEATABLE = ("design", "experiment", "motion", "rest")
#: Largest difference of a number: over its size [1], or in units of its last digit.
_DIFFERENCE_REL, _DIFFERENCE_UNITS = 0.03, 1.01
_NUMBER = re.compile(r"\d+(?:\.(\d+))?")


def figures_of(values: Values) -> dict[str, str]:
    """Return what a page measured, by the figure's name."""
    return {row["figure"]: row["measured"] for row in targets_of(values)}


def read_quick_figures() -> dict[str, dict[str, str]]:
    """Return the kept figures by study."""
    kept: dict[str, dict[str, str]] = json.loads(_FILE.read_text(encoding="utf-8"))
    return kept


def differences(before: Mapping[str, str], now: Mapping[str, str]) -> Iterator[str]:
    """Yield a line for each figure that is another, but for the last digit of a number."""
    for figure in dict.fromkeys([*before, *now]):
        was, is_now = before.get(figure, "nothing"), now.get(figure, "nothing")
        numbers = zip(_NUMBER.finditer(was), _NUMBER.finditer(is_now), strict=False)
        same_words = _NUMBER.sub("#", was) == _NUMBER.sub("#", is_now)
        if not (same_words and all(_is_close(*pair) for pair in numbers)):
            yield f"{figure}: was {was}, is {is_now}; make the page anew, and python -m tests.lab.quick_figures"


def _is_close(was: re.Match[str], now: re.Match[str]) -> bool:
    one, other = float(was[0]), float(now[0])
    unit = 10.0 ** -len(was[1] or "")
    return abs(one - other) <= max(_DIFFERENCE_REL * abs(one), _DIFFERENCE_UNITS * unit)


def main() -> None:
    """Compute the figures of some studies anew, and keep them."""
    kept = read_quick_figures() if _FILE.exists() else {}
    for name in sys.argv[1:] or REPEATABLE:
        context = StudyContext(_FOOT, quick=True, report_progress=lambda _: None)
        kept[name] = figures_of(make_page(name, context, Path("build") / "quick")[1])
        _FILE.write_text(json.dumps(kept, indent=1, sort_keys=True) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
