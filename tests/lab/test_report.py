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
    context = StudyContext(MODELS / "aoyagi-3x3", quick=True, report_progress=lambda _: None)
    make_page(name, context, tmp_path)
    text = (tmp_path / f"{name}.md").read_text(encoding="utf-8")
    assert "Quick form" in text
    assert "|---" in text
    shown = set(re.findall(r"!\[[^\]]*\]\(([^)]*)\)", text))
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


def test_errors_of_starts_feet_and_draws_stand_on_several() -> None:
    """One start, one foot or one draw of gains behind a row would make a table of luck."""
    motion, paper, speed, experiment_ = (
        json.loads((PAGES / f"{name}.json").read_text("utf-8"))
        for name in ("motion", "paper", "speed-error", "experiment")
    )
    spreads = [
        *((draws["direction_deg"], 20) for draws in motion["wrong_gains"].values()),
        *((row["direction_deg"], 5) for row in paper["sizes"]),
        *(
            (starts, 5)
            for networks in speed["networks"].values()
            for network in networks[:-1]  # the last one is the released network
            for errors in network["direction_deg"].values()
            for starts in errors.values()
        ),
        *((cause["deg"], 20) for cause in experiment_["causes"].values()),
        (experiment_["kinds"]["supposed"]["own_network"]["centred"]["deg"], 20),
    ]
    for errors, n in spreads:
        assert len(set(errors)) == n


def test_each_figure_of_the_paper_has_its_page() -> None:
    text = (PAGES.parent / "paper-figures.md").read_text("utf-8")
    named = set(re.findall(r"\(report/([a-z-]+)\.md\)", text))
    assert {"paper", "rest", "physics", "experiment", "outlook"} <= named <= set(study_names())


#: Of a gram of force [mN].
_MN_PER_GF = 9.80665


def test_the_front_page_has_the_figures_of_the_pages() -> None:
    front = (PAGES.parents[1] / "README.md").read_text(encoding="utf-8")
    small, motion, design, made = (
        json.loads((PAGES / f"{name}.json").read_text("utf-8"))
        for name in ("motion", "motion-rows", "design", "experiment")
    )
    own, *others = (motion["pooled"][name] for name in design["feet"])
    of_small = small["pooled"]["aoyagi-3x3"]
    walk, trot = (
        next(row for row in motion["gaits"] if row["load"] == load)
        for load in ("measured walk", "trot of a robot dog")
    )
    feet = made["kinds"]["supposed"]
    n_touches, n_missed, n_in_air = (
        sum(robot[key] for robot in others) for key in ("n_touches", "n_missed", "n_in_air")
    )
    calibrated, uncalibrated = feet["all"]["centred"], feet["design"]["centred"]
    deg, gf = np.array(calibrated["true_deg"]), np.array(calibrated["true_gf"])
    worst_deg, worst_gf = (
        experiment.worst_accepted(made, "centred", f"true_{unit}")[0] for unit in ("deg", "gf")
    )
    standing_deg = feet["standing"]["centred"]["true_deg"]
    worst_uncalibrated_n = 1e-3 * _MN_PER_GF * max(uncalibrated["true_gf"])
    ranges_n = [foot["built"]["upright_range_n"][1:] for foot in design["feet"].values()]
    for text in (
        f"{own['n_runs']} runs of a hexapod and a quadruped: direction {own['direction_deg']:.1f} deg on average, "
        f"{own['mid_stance_deg']:.1f} deg in mid-stance; on the feet of their own size "
        + " and ".join(f"{one['direction_deg']:.1f}" for one in others)
        + " deg",
        f"the worst gait, hopping: {own['worst_direction_deg']:.1f} deg; hard landings",
        f"walking robots: direction {of_small['direction_deg']:.1f} deg on average",
        f"on average, {of_small['mid_stance_deg']:.1f} deg in mid-stance; the smooth walk",
        f"the worst gait {of_small['worst_direction_deg']:.1f} deg; hard landings",
        f"{walk['direction_deg']:.1f} deg on average, 1 force in 20 more than {walk['direction_p95_deg']:.1f}",
        f"robot dog's trot {trot['direction_deg']:.1f} and {trot['direction_p95_deg']:.1f} deg",
        f"{100 * (1 - n_missed / n_touches):.0f} % of {n_touches} touchdowns are told",
        f"{n_in_air} false ones in the air; on the smallest foot {own['n_in_air']} for {own['n_touches']} touches",
        f"mean of {len(deg)} feet: direction {deg.mean():.2f} deg, magnitude {_MN_PER_GF * gf.mean():.0f} mN",
        f"without a force sensor, {np.mean(standing_deg):.1f} deg",
        f"by standing {max(standing_deg):.1f} deg",
        f"the worst of these feet: {deg.max():.2f} deg, {_MN_PER_GF * gf.max():.0f} mN",
        f"does not know: {worst_deg:.2f} deg, {_MN_PER_GF * worst_gf:.0f} mN",
        f"without calibration: {max(uncalibrated['true_deg']):.0f} deg, {worst_uncalibrated_n:.2f} N",
        *(
            f"leaning by {lean_deg} deg: {small:.2f} N, {middle:.1f} N, {large:.0f} N"
            for lean_deg, (small, middle, large) in zip((14, 30), zip(*ranges_n, strict=True), strict=True)
        ),
    ):
        assert text in front
