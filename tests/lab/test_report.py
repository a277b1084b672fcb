"""Every page of the report in its quick form, about the released models, and how pages are bound."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from footsense.cli.lab.study import DAEMON_STUDIES
from footsense.errors import FootsenseError
from footsense.lab.report import OTHERS, STUDIES, bind, is_made, make_page
from footsense.lab.studies.page import Page, Workbench
from footsense.lab.targets import targets

pytestmark = pytest.mark.lab

#: Pages that take no time in full.
SAME_EITHER_WAY = {"pattern"}
RELEASED = Path(__file__).parents[2] / "models" / "aoyagi-3x3"


@pytest.fixture
def bench() -> Workbench:
    """Return the quick form on the released models."""
    return Workbench(models=RELEASED, quick=True, say=lambda _: None)


@pytest.mark.parametrize("name", STUDIES | DAEMON_STUDIES)
def test_a_study_makes_its_page(name: str, bench: Workbench, tmp_path: Path) -> None:
    """It says that it is quick, has a table and every figure that it shows, and its numbers are JSON."""
    page = make_page(name, bench, STUDIES | DAEMON_STUDIES)
    page.write(tmp_path)
    text = (tmp_path / f"{name}.md").read_text(encoding="utf-8")
    assert text.startswith("## ")
    assert "quick" in text.lower() or page.name in SAME_EITHER_WAY
    assert "|---" in text
    assert {part.partition(")")[0] for part in text.split("![](")[1:]} == set(page.figures)
    values = json.loads((tmp_path / f"{name}.json").read_text(encoding="utf-8"))
    assert values["quick"] is True
    assert is_made(name, tmp_path, bench)
    assert not is_made(name, tmp_path, replace(bench, quick=False))
    if name == "hard-cases":
        assert all(case["held"] for case in values["cases"]), [c for c in values["cases"] if not c["held"]]


def test_an_unknown_study_is_answered_with_those_that_are(bench: Workbench) -> None:
    """One line with the names."""
    with pytest.raises(FootsenseError, match=r"no study 'x': there are shipped, .*hard-cases"):
        make_page("x", bench)


def test_pages_about_another_network_are_left_out(bench: Workbench, tmp_path: Path) -> None:
    """They are named instead of bound."""
    about = {"network_sha256": "0" * 64, "quick": True}
    Page(name="solid", title="Old", body="of another network", values=about).write(tmp_path)
    text = bind(tmp_path, bench).read_text(encoding="utf-8")
    assert "of another network" not in text
    assert "Not made about this network yet: shipped" in text
    assert "not measured" in text


def test_the_released_report_has_every_target_and_says_why_one_is_missed() -> None:
    """The committed pages hold all numbers that the table on top is made of."""
    pages = Path(__file__).parents[2] / "docs" / "report"
    values = {
        name: json.loads((pages / f"{name}.json").read_text(encoding="utf-8")) for name in (*STUDIES, *OTHERS)
    }
    text = targets({**values, "report": {"minutes": 1.0}})
    assert "not measured" not in text
    assert "at 150 gf that makes" in text
