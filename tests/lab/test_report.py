"""Every page of the report in its quick form, and the committed pages."""

import json
import re
import sys
from pathlib import Path
from shutil import copyfile, copytree

import pytest

from footsense.errors import FootsenseError
from footsense.lab.page_inputs import changed_inputs
from footsense.lab.report import (
    StudyContext,
    make_page,
    page_text,
    spread,
    study_names,
    table,
    targets_of,
    write_list_of_pages,
)
from tests.lab.quick_figures import REPEATABLE, differences, figures_of, read_quick_figures

pytestmark = pytest.mark.lab

ROOT = Path(__file__).parents[2]
MODELS = ROOT / "models"
PAGES = ROOT / "docs" / "report"
COMMITTED = [PAGES / f"{name}.json" for name in study_names()]


#: Tables and model files that this process has opened.
_OPENED: set[Path] = set()


def _note_opening(event: str, arguments: tuple[object, ...]) -> None:
    if (
        event == "open"
        and isinstance(arguments[0], str)
        and arguments[0].endswith((".onnx", ".npz", ".yaml"))
    ):
        _OPENED.add(Path(arguments[0]).resolve())


@pytest.mark.parametrize("name", study_names())
@pytest.mark.slow
def test_a_study_makes_its_page_in_its_quick_form(name: str, tmp_path: Path) -> None:
    """With every table that it opened among the page's inputs, and the figures of before."""
    data = Path(__file__).parent / "data"
    context = StudyContext(MODELS / "aoyagi-3x3", quick=True, data=data, report_progress=lambda _: None)
    sys.addaudithook(_note_opening)
    _OPENED.clear()
    _, values = make_page(name, context, tmp_path)
    named = {(ROOT / one).resolve() for one in values["inputs"]}
    assert {file for file in _OPENED if file.is_relative_to(ROOT)} <= named
    assert changed_inputs(values["inputs"]) == []
    text = (tmp_path / f"{name}.md").read_text(encoding="utf-8")
    assert "Quick form" in text
    assert "|---" in text
    shown = set(re.findall(r"!\[[^\]]*\]\(([^)]*)\)", text))
    assert shown == {file.name for file in tmp_path.glob("*.png")}
    assert json.loads((tmp_path / f"{name}.json").read_text(encoding="utf-8"))["quick"] is True
    assert f"[{name}]({name}.md)" in write_list_of_pages(tmp_path).read_text(encoding="utf-8")
    if name in REPEATABLE:
        assert list(differences(read_quick_figures()[name], figures_of(values))) == []


def test_figures_that_moved_are_told() -> None:
    """The last digit may be another on another processor; a figure, a unit or a row may not."""
    before = {"walk": "0.30 / 1.1 deg", "found": "97.0% of 90"}
    assert not list(differences(before, {"walk": "0.31 / 1.1 deg", "found": "97.1% of 90"}))
    for now in ({"walk": "0.36 / 1.1 deg"}, {"walk": "0.30 / 1.1 mN"}, {}):
        assert list(differences(before, before | now if now else {"found": "97.0% of 90"}))


@pytest.mark.parametrize("file", COMMITTED, ids=study_names())
def test_a_committed_page_is_the_text_of_its_figures(file: Path) -> None:
    values = json.loads(file.read_text(encoding="utf-8"))
    assert not values["quick"]
    assert not values["commit"].endswith("+")
    assert page_text(values) == file.with_suffix(".md").read_text(encoding="utf-8")


@pytest.mark.slow
@pytest.mark.parametrize("file", COMMITTED, ids=study_names())
def test_a_committed_page_is_of_todays_models(file: Path) -> None:
    """Otherwise its study has to be run anew."""
    inputs = json.loads(file.read_text(encoding="utf-8"))["inputs"]
    assert inputs
    assert changed_inputs(inputs) == []


def test_a_changed_byte_of_a_model_turns_its_pages_red(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is told which, and the page says so on itself."""
    pages = [json.loads(file.read_text(encoding="utf-8")) for file in COMMITTED]
    copytree(MODELS, tmp_path, dirs_exist_ok=True)
    monkeypatch.setattr("footsense.lab.page_inputs.released_folder", tmp_path.joinpath)
    file = tmp_path / "aoyagi-3x3" / "network.onnx"
    changed = bytearray(file.read_bytes())
    changed[len(changed) // 2] ^= 1
    file.write_bytes(changed)
    for values in pages:
        of_foot = values["foot"] == "aoyagi-3x3" and values["study"] not in {
            "design",
            "physics",
            "odometry",
            "real-sensors",
        }
        assert changed_inputs(values["inputs"]) == ["models/aoyagi-3x3/network.onnx"] * of_foot
        assert ("Out of date: models/aoyagi-3x3/network.onnx changed" in page_text(values)) == of_foot
    assert changed_inputs({"models/gone/foot.yaml": "", "robot gone": "0"}) == ["robot gone"]


def test_no_page_is_made_from_uncommitted_changes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("footsense.lab.report._git", lambda *_: " M footsense/frames.py")
    context = StudyContext(MODELS / "aoyagi-3x3", report_progress=lambda _: None)
    with pytest.raises(FootsenseError, match=r"^footsense/frames.py: differs from the commit"):
        make_page("design", context, tmp_path)


def test_the_committed_list_has_all_pages(tmp_path: Path) -> None:
    for name in study_names():
        copyfile(PAGES / f"{name}.json", tmp_path / f"{name}.json")
    written = write_list_of_pages(tmp_path).read_text("utf-8")
    assert written == (PAGES / "README.md").read_text("utf-8")
    assert all(f"| [{name}]({name}.md) |" in written for name in study_names())


@pytest.mark.parametrize(
    ("share", "dated_ms", "told"),
    [
        (0.9, 4.0, ["90% of 10", "4.0 ms; 1.00"]),
        (0.89, 4.1, ["89% of 10, **missed**", "4.1 ms; 1.00, **missed**"]),
    ],
)
def test_a_figure_beyond_its_limit_is_missed(share: float, dated_ms: float, told: list[str]) -> None:
    """One that is at it is not, be it the most or the least that is wanted."""
    page = json.loads((PAGES / "motion.json").read_text("utf-8"))
    page["boards"]["ad7147"]["contacts"] |= {
        "dragged_found_share": share,
        "n_dragged_touches": 10,
        "dated_rms_ms": dated_ms,
        "dated_rms_over_sigma": 1.0,
    }
    rows = {row["figure"]: row for row in targets_of(page)}
    found = [
        rows["`ad7147`: feet that drag, found at their first touch"],
        rows["`ad7147`: touches, new gaits, error of the time, rms; rms over sigma"],
    ]
    assert [row["told"] for row in found] == told
    assert [row["target"] for row in found] == ["90%", "4 ms; 0.8 to 1.2"]


def test_an_unknown_study_is_answered_with_those_that_are(tmp_path: Path) -> None:
    with pytest.raises(FootsenseError, match=r"no study 'x': there are .*faults"):
        make_page("x", StudyContext(MODELS / "aoyagi-3x3"), tmp_path)


def test_a_spread_is_that_of_a_sample_and_a_table_has_its_columns() -> None:
    assert spread([1.0, 2.0, 6.0], 1) == "3.0 +- 2.6, worst 6.0"
    written = "| case | error |\n|---|---:|\n| a | 1.0 |"
    assert table("case | error", [("a", 1.0)]) == written
    assert table("case | error", {"a": {"deg": 1.0}}, "{name} | {deg:.1f}") == written


def test_errors_of_starts_and_feet_stand_on_several() -> None:
    """One start or one foot behind a row would make a table of luck."""
    paper, experiment = (
        json.loads((PAGES / f"{name}.json").read_text("utf-8")) for name in ("paper", "experiment")
    )
    spreads = [
        *((row["direction_deg"], 5) for row in paper["sizes"]),
        *((cause["deg"], 20) for cause in experiment["causes"].values()),
        (experiment["kinds"]["supposed"]["own_network"]["centred"]["deg"], 20),
    ]
    for errors, n in spreads:
        assert len(set(errors)) == n


def test_each_figure_of_the_paper_has_its_page() -> None:
    text = (PAGES.parent / "paper-figures.md").read_text("utf-8")
    named = set(re.findall(r"\(report/([a-z-]+)\.md\)", text))
    assert {"paper", "rest", "physics", "experiment", "outlook"} <= named <= set(study_names())
