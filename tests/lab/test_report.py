"""Every page of the report in its quick form, about the released models, and how pages are bound."""

import json
from dataclasses import replace
from importlib import import_module
from pathlib import Path

import pytest

from footsense.cli.lab.study import DAEMON_STUDIES, STUDIES_NOT_RUN_BY_REPORT
from footsense.errors import FootsenseError
from footsense.lab.report import (
    DAEMON_PAGES,
    STUDY_MODULES,
    bind_pages,
    is_page_of_models,
    make_page,
    noted_stale_reasons,
    page_values,
    stale_reason,
)
from footsense.lab.studies.page import Page, StudyContext
from footsense.lab.targets import targets_markdown

pytestmark = pytest.mark.lab

#: Pages that take no time in full.
SAME_EITHER_WAY = {"pattern"}
RELEASED = Path(__file__).parents[2] / "models" / "aoyagi-3x3"
PAGES = Path(__file__).parents[2] / "docs" / "report"
#: Errors of an estimator on the page of the experiment, and their units.
_ERRORS = {"direction": "deg", "magnitude": "gf"}
ALL = STUDY_MODULES | DAEMON_STUDIES
#: Studies whose text is rendered from their JSON.
RENDERED = list(ALL | STUDIES_NOT_RUN_BY_REPORT)


@pytest.fixture
def context() -> StudyContext:
    """Return the quick form on the released models."""
    return StudyContext(models=RELEASED, quick=True, report_progress=lambda _: None)


@pytest.mark.parametrize("name", ALL)
@pytest.mark.slow
def test_a_study_makes_its_page(name: str, context: StudyContext, tmp_path: Path) -> None:
    """It says that it is quick, has a table and every figure that it shows, and its numbers are JSON."""
    page = make_page(name, context, ALL)
    page.write(tmp_path)
    text = (tmp_path / f"{name}.md").read_text(encoding="utf-8")
    assert text.startswith("## ")
    assert "quick" in text.lower() or page.name in SAME_EITHER_WAY
    assert "|---" in text
    assert {part.partition(")")[0] for part in text.split("![](")[1:]} == set(page.figures)
    values = json.loads((tmp_path / f"{name}.json").read_text(encoding="utf-8"))
    assert values["quick"] is True
    assert is_page_of_models(name, tmp_path, context)
    assert not is_page_of_models(name, tmp_path, replace(context, quick=False))
    if name == "hard-cases":
        assert not [case for group in values["groups"].values() for case in group if not case["passed"]]


def test_an_unknown_study_is_answered_with_those_that_are(context: StudyContext) -> None:
    """One line with the names."""
    with pytest.raises(FootsenseError, match=r"no study 'x': there are released, .*hard-cases"):
        make_page("x", context)


def test_pages_about_another_network_are_left_out(context: StudyContext, tmp_path: Path) -> None:
    """They are named instead of bound."""
    about = {"network_sha256": "0" * 64, "quick": True, "seconds": 1.0}
    Page(name="solid", title="Old", body="of another network", figures={}, values=about).write(tmp_path)
    text = bind_pages(tmp_path, context).read_text(encoding="utf-8")
    assert "of another network" not in text
    assert "Not made about this network yet: released" in text
    assert "not measured" in text


@pytest.mark.parametrize("name", RENDERED)
def test_a_committed_page_is_the_text_of_its_numbers(name: str) -> None:
    """Rendered again from its JSON, the page is the committed one to the byte."""
    page: Page = import_module((ALL | STUDIES_NOT_RUN_BY_REPORT)[name]).STUDY.rerender(
        page_values(name, PAGES)
    )
    assert page.markdown == (PAGES / f"{name}.md").read_text(encoding="utf-8")


def test_no_committed_page_is_stale_without_a_note(context: StudyContext) -> None:
    """A page whose code has changed is made again with `footsense lab study`, or noted with the reason."""
    full = replace(context, quick=False)
    stale = {name for name in RENDERED if stale_reason(name, PAGES, full, ALL | STUDIES_NOT_RUN_BY_REPORT)}
    assert stale == set(noted_stale_reasons(PAGES))


@pytest.mark.parametrize("foot_type", ["hexapod-2kg", "quadruped-12kg"])
def test_another_released_foot_has_a_fault_table(foot_type: str) -> None:
    """It is of the foot's network and of the code as it is, and is the text of its numbers."""
    folder = RELEASED.parent / foot_type
    assert stale_reason("faults", folder, StudyContext(models=folder), ALL) == ""
    page: Page = import_module(ALL["faults"]).STUDY.rerender(page_values("faults", folder))
    assert page.markdown == (folder / "faults.md").read_text(encoding="utf-8")


def test_the_committed_report_binds_the_committed_pages(context: StudyContext, tmp_path: Path) -> None:
    """Bound again, the document is the committed one."""
    for file in PAGES.glob("*.*"):
        (tmp_path / file.name).write_bytes(file.read_bytes())
    bound = bind_pages(tmp_path, replace(context, quick=False)).read_text(encoding="utf-8")
    assert bound == (PAGES / "README.md").read_text(encoding="utf-8")


def test_the_released_report_has_every_target_and_says_why_one_is_missed() -> None:
    """The committed pages hold all numbers that the table on top is made of."""
    values = {
        name: json.loads((PAGES / f"{name}.json").read_text(encoding="utf-8"))
        for name in (*STUDY_MODULES, *DAEMON_PAGES)
    }
    text = targets_markdown({**values, "report": {"minutes": 1.0}})
    assert "not measured" not in text
    assert "at 150 gf that makes" in text


def test_the_front_page_has_the_figures_of_the_experiment_and_of_the_matrix() -> None:
    """README's accuracies of made feet are those of the committed pages, the worst physics beside the supposed one."""
    front = (PAGES.parents[1] / "README.md").read_text(encoding="utf-8")
    experiment, matrix = (
        json.loads((PAGES / f"{name}.json").read_text("utf-8")) for name in STUDIES_NOT_RUN_BY_REPORT
    )

    def of_estimator(name: str, judge: str = "reference") -> str:
        one = experiment["errors_by_estimator"][name]
        mean = {unit: one[f"{error}_vs_{judge}_{unit}"]["mean"] for error, unit in _ERRORS.items()}
        return f"{mean['deg']:.2f} deg, {mean['gf']:.2f} gf"

    assert f"{experiment['n_feet']} feet fabricated as inexactly as the paper's" in front
    for name in ("design_only", "calibrated_20", "calibrated_362"):
        assert of_estimator(name) in front
    for name in ("calibrated_20", "calibrated_362"):
        assert of_estimator(name, "truth") in front
    accepted = {name: row for name, row in matrix["mean_over_feet"].items() if row["refused_all"] <= 0.5}
    assert (
        f"{matrix['n_feet']} feet of each of {len(matrix['mean_over_feet']) - 1} other kinds of physics"
        in front
    )
    for test in ("centred_all", "range_all"):
        supposed, worst = accepted["none"], {}
        for unit in ("deg", "gf"):
            worst[unit] = max(row[f"{test}_{unit}"] for row in accepted.values())
        assert f"{supposed[f'{test}_deg']:.2f} deg, {supposed[f'{test}_gf']:.2f} gf" in front
        assert f"{worst['deg']:.1f} deg, {worst['gf']:.1f} gf" in front
