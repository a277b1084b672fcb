"""Every page of the report in its quick form, and the committed pages."""

import json
import re
from pathlib import Path
from shutil import copyfile

import numpy as np
import pytest

from footsense.errors import FootsenseError
from footsense.lab.report import (
    StudyContext,
    make_page,
    page_text,
    require_study,
    spread,
    study_names,
    table,
    write_list_of_pages,
)
from footsense.lab.studies import experiment

pytestmark = pytest.mark.lab

MODELS = Path(__file__).parents[2] / "models"
PAGES = Path(__file__).parents[2] / "docs" / "report"
COMMITTED = [
    *(PAGES / f"{name}.json" for name in study_names()),
    *(MODELS / foot / "faults.json" for foot in ("hexapod-2kg", "quadruped-12kg")),
]


@pytest.mark.parametrize("name", study_names())
@pytest.mark.slow
def test_a_study_makes_its_page_in_its_quick_form(name: str, tmp_path: Path) -> None:
    context = StudyContext(models=MODELS / "aoyagi-3x3", quick=True, report_progress=lambda _: None)
    make_page(name, context, tmp_path)
    text = (tmp_path / f"{name}.md").read_text(encoding="utf-8")
    assert "Quick form" in text
    assert "|---" in text
    shown = {part.partition(")")[0] for part in text.split("![](")[1:]}
    assert shown == {file.name for file in tmp_path.glob("*.png")}
    assert json.loads((tmp_path / f"{name}.json").read_text(encoding="utf-8"))["quick"] is True
    assert f"[{name}]({name}.md)" in write_list_of_pages(tmp_path).read_text(encoding="utf-8")


@pytest.mark.parametrize("file", COMMITTED, ids=lambda file: f"{file.parent.name}-{file.stem}")
def test_a_committed_page_is_the_text_of_its_figures(file: Path) -> None:
    values = json.loads(file.read_text(encoding="utf-8"))
    assert not values["quick"]
    assert page_text(values) == file.with_suffix(".md").read_text(encoding="utf-8")


def test_the_committed_list_has_all_pages(tmp_path: Path) -> None:
    for name in study_names():
        copyfile(PAGES / f"{name}.json", tmp_path / f"{name}.json")
    written = write_list_of_pages(tmp_path).read_text("utf-8")
    assert written == (PAGES / "README.md").read_text("utf-8")
    assert all(f"| [{name}]({name}.md) |" in written for name in study_names())


def test_an_unknown_study_is_answered_with_those_that_are() -> None:
    with pytest.raises(FootsenseError, match=r"no study 'x': there are .*faults"):
        require_study("x")


def test_a_spread_is_that_of_a_sample_and_a_table_has_its_columns() -> None:
    assert spread([1.0, 2.0, 6.0], 1) == "3.0 +- 2.6, worst 6.0"
    written = "| case | error |\n|---|---:|\n| a | 1.0 |"
    assert table("case | error", [("a", 1.0)]) == written
    assert table("case | error", {"a": {"deg": 1.0}}, "{name} | {deg:.1f}") == written


def test_the_front_page_has_the_figures_of_the_pages() -> None:
    front = (PAGES.parents[1] / "README.md").read_text(encoding="utf-8")
    motion, rest = (json.loads((PAGES / f"{name}.json").read_text("utf-8")) for name in ("motion", "rest"))
    rough, paper = motion["rough"], rest["errors"]["paper_network"]
    assert "use one response table, with vented cavities (the paper's are sealed)" in " ".join(front.split())
    for text in (
        f"{rough['leg_minutes']:.0f} minutes of legs",
        f"{rough['n_false_touchdowns']} in {rough['swing_minutes']:.0f} min of swing;",
        f"; {100 * rough['contact_correct_share']:.0f} %;",
        f"{100 * rough['missed_slide_share']:.0f} % |",
        f"{paper['direction_deg']:.2f} deg, {paper['magnitude_gf']:.2f} gf;",
        f"; {paper['direction_max_deg']:.1f} deg, {paper['magnitude_max_gf']:.1f} gf",
    ):
        assert text in front


def test_errors_of_starts_feet_and_draws_stand_on_several() -> None:
    """One start, one foot or one draw of gains behind a row would make a table of luck."""
    motion, paper, speed, experiment_ = (
        json.loads((PAGES / f"{name}.json").read_text("utf-8"))
        for name in ("motion", "paper", "speed-error", "experiment")
    )
    spreads = [
        *((draws["direction_deg"], 20) for draws in motion["wrong_gains"].values()),
        *((row["direction_deg"], 5) for row in paper["sizes"]),
        *((row["direction_deg"][test], 5) for row in speed["sizes"] for test in ("gaits", "rest")),
        *((cause["deg"], 20) for cause in experiment_["causes"].values()),
        (experiment_["kinds"]["supposed"]["own_network"]["centred"]["deg"], 20),
    ]
    for errors, n in spreads:
        assert len(set(errors)) == n


def test_each_figure_of_the_paper_has_its_page() -> None:
    text = (PAGES.parent / "paper-figures.md").read_text("utf-8")
    named = set(re.findall(r"\(report/([a-z-]+)\.md\)", text))
    assert {"paper", "rest", "physics", "experiment", "outlook"} <= named <= set(study_names())


def test_the_front_page_has_the_range_of_the_page_design() -> None:
    front = (PAGES.parents[1] / "README.md").read_text(encoding="utf-8")
    foot = json.loads((PAGES / "design.json").read_text("utf-8"))["feet"]["aoyagi-3x3"]
    centred, leaning = foot["limits"][:2]
    for text in (
        f"to {centred['range'][0]:.2f} N within 30 deg",
        f"ends at {centred['converter'][0]:.2f} N",
        f"leaves {leaning['range'][0]:.2f} and {leaning['converter'][0]:.2f} N",
    ):
        assert text in front


def test_the_front_page_says_of_made_feet_spread_and_worst() -> None:
    front = (PAGES.parents[1] / "README.md").read_text(encoding="utf-8")
    values = json.loads((PAGES / "experiment.json").read_text("utf-8"))
    assert f"seed {values['seed']}, feet 0 to {values['n_feet'] - 1}" in front
    assert "tuned to give the paper's error" in front
    made = values["kinds"]["supposed"]
    for estimator, test, kind in (
        ("design", "centred", ""),
        ("own_network", "centred", ""),
        *(("few", "centred", kind) for kind in ("", "true_")),
        *(("all", "centred", kind) for kind in ("", "true_")),
        ("all", "range", "true_"),
    ):
        errors = made[estimator][test]
        assert f"| {spread(errors[f'{kind}deg'])} deg; {spread(errors[f'{kind}gf'])} gf |" in front
    worst = {
        (test, unit): experiment.worst_accepted(values, test, f"true_{unit}")[0]
        for test in ("centred", "range")
        for unit in ("deg", "gf")
    }
    assert (
        "worst {:.2f} deg, {:.2f} gf; over the range {:.2f} deg, {:.2f} gf".format(*worst.values()) in front
    )
    shares = [np.mean(columns["all"]["range"]["no_force"]) for columns in values["kinds"].values()]
    assert f"{100 * min(shares):.0f} to {100 * max(shares):.0f} % of the loads have no force" in front
    n_accepted = {name: len(experiment.accepted(columns, "all")) for name, columns in values["kinds"].items()}
    assert f"one bar not bonded: {n_accepted['bar_not_bonded']} of {values['n_feet']} pass" in front
