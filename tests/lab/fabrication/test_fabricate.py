"""The files for manufacture, read back; a wrong file is found, a foot that cannot be made is refused in one line."""

import re
import shutil
from collections.abc import Callable
from dataclasses import replace as replace_deviations
from pathlib import Path
from typing import Any, get_args

import ezdxf
import numpy as np
import pytest
from click.testing import CliRunner
from msgspec.structs import replace

from footsense.cli.lab.group import lab
from footsense.config import load_config
from footsense.errors import FootsenseError
from footsense.foot.response_table import FootResponse
from footsense.foot.specimen import Deviations, Specimen
from footsense.lab.design.processes import assumed_process
from footsense.lab.fabrication.package import FabricationPackage, write_fabrication_package
from footsense.lab.fabrication.parts.flex import Board
from footsense.lab.fabrication.tolerances import manufacturing_problems
from footsense.lab.foot_file import FOOT_FILE
from footsense.sim.fabrication import draw_deviations as sim_fabricate
from tests.lab.fabrication import file_checks
from tests.lab.released import FOOT_DESIGN, RELEASED

pytestmark = pytest.mark.lab

BOARDS = get_args(Board)
ASSUMED = assumed_process(FOOT_DESIGN)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("foot")


@pytest.fixture(scope="module")
def package(folder: Path) -> FabricationPackage:
    return write_fabrication_package(FOOT_DESIGN, folder)


@pytest.mark.parametrize("board", BOARDS)
def test_the_files_of_the_released_foot_pass_every_check(board: Board, tmp_path: Path) -> None:
    package = write_fabrication_package(FOOT_DESIGN, tmp_path, board=board)
    file_checks.check_all_files(tmp_path, FOOT_DESIGN, package.flexes)
    # Plates of 5.387 pF, as the daemon assumes, and the fringe field beside them.
    element = package.expected
    assert element.plate_formula_pf == FOOT_DESIGN.capacitor.unloaded_pf
    assert element.min_unloaded_pf < element.plate_formula_pf + element.fringe_pf < element.max_unloaded_pf


def test_the_command_gives_the_same_bytes(package: FabricationPackage, folder: Path, tmp_path: Path) -> None:
    result = CliRunner().invoke(lab, ["fabricate", "aoyagi-3x3", "--out", str(tmp_path)])
    assert result.exit_code == 0, result.exception
    assert "board ad7147, process paper: elements of 5.85 pF (4.31 to 7.38)" in result.output
    files = [path.relative_to(folder) for path in folder.rglob("*") if path.is_file()]
    assert len(files) > 12
    assert [f for f in files if (folder / f).read_bytes() != (tmp_path / f).read_bytes()] == []


def test_a_drawing_does_not_follow_the_order_of_a_set(package: FabricationPackage, folder: Path) -> None:
    """Which differs from process to process, where all else of a drawing is the same."""
    del package
    classes = [each.key for each in ezdxf.readfile(folder / "film.dxf").classes]
    assert classes == sorted(classes)


@pytest.mark.parametrize(
    ("board", "chips", "wiring"),
    [
        (
            "ad7147",
            {"AD7147-1": "1"},
            {
                "| 1 | gnd | GND |",
                "| 2 | row1col1 | AD7147: CIN0 |",
                "| 7 | acshield | AD7147: ACSHIELD |",
                "| 9 | row2col2 | AD7147: CIN4 |",
                "| 16 | row3col3 | AD7147: CIN8 |",
            },
        ),
        (
            "fdc1004",
            {"FDC1004": "1", "ADG715": "1"},
            {
                "| 2 | row1 | ADG715 0x49: S1 (to GND), S4 (to SHLD) |",
                "| 6 | col3 | FDC1004: CIN3 |",
                "| 7 | shld | SHLD |",
            },
        ),
    ],
)
def test_parts_and_wiring_are_of_the_board(
    board: Board, chips: dict[str, str], wiring: set[str], tmp_path: Path
) -> None:
    """As in docs/wiring.md and firmware_interface/README.md."""
    package = write_fabrication_package(FOOT_DESIGN, tmp_path, board=board)
    parts = [line.split(",") for line in (tmp_path / "bill-of-materials.csv").read_text().splitlines()]
    known = {"AD7147-1", "FDC1004", "ADG715"}
    assert {name: quantity for quantity, _, name, *_ in parts if name in known} == chips
    assert wiring <= set((tmp_path / "checklist.md").read_text().splitlines())
    assert {flex.name for flex in package.flexes} <= {line[-2].rstrip("/") for line in parts}
    assert all(float(line[-1]) > 0 for line in parts if line[2] in known)


def test_a_foot_with_its_fringe_field_reads_as_expected(package: FabricationPackage) -> None:
    foot = Specimen(FootResponse.load(RELEASED / "response.npz"), Deviations(fringe=True))
    assert [package.expected.unloaded_pf] * 9 == pytest.approx(foot.unloaded_pf, rel=1e-3)


def test_most_fabricated_elements_read_within_the_limits(package: FabricationPackage) -> None:
    response, element = FootResponse.load(RELEASED / "response.npz"), package.expected
    own = [
        replace_deviations(sim_fabricate(response, ASSUMED.rms_deviations, 1, foot), fringe=True)
        for foot in range(60)
    ]
    readings = np.array([Specimen(response, deviations).unloaded_pf for deviations in own])
    within = (element.min_unloaded_pf < readings) & (readings < element.max_unloaded_pf)
    assert 0.95 < within.mean() < 1.0


def test_the_lines_of_the_checklist_are_of_the_configuration(
    package: FabricationPackage, folder: Path, tmp_path: Path
) -> None:
    lines = re.search(r"```yaml\n(.*?)```", (folder / "checklist.md").read_text(), re.DOTALL)
    assert lines is not None
    robot = tmp_path / "robot.yaml"
    robot.write_text("buses: [{device: sim, legs: {lf: 0}}]\ncan: {interface: virtual}\n" + lines[1])
    expected = [package.expected.fringe_pf] * 9
    assert load_config(robot).stray_pf == {"lf": pytest.approx(expected, abs=0.005)}


def swapped_nets(text: str) -> str:
    return text.replace("row1col1", "x").replace("row2col1", "row1col1").replace("x", "row2col1")


def broken_trace(text: str) -> str:
    return text.replace("X7600000Y0D01*", "X7600000Y0D02*")


def touching_trace(text: str) -> str:
    return text.replace("Y-2500000", "Y-2590000")


def shifted_via(text: str) -> str:
    return text.replace("X65.000Y0.500", "X65.000Y0.400")


def short_shield(text: str) -> str:
    return text.replace("R,58.700000X", "R,57.700000X")


@pytest.mark.parametrize(
    ("name", "spoil"),
    [
        ("copper.gbr", swapped_nets),
        ("copper.gbr", broken_trace),
        ("copper.gbr", touching_trace),
        ("vias.drl", shifted_via),
        ("shield.gbr", short_shield),
    ],
)
def test_a_spoilt_flex_is_found(
    package: FabricationPackage, folder: Path, tmp_path: Path, name: str, spoil: Callable[[str], str]
) -> None:
    flex = package.flexes[1]
    shutil.copytree(folder / flex.name, tmp_path / flex.name)
    file = tmp_path / flex.name / name
    spoilt = spoil(file.read_text())
    assert spoilt != file.read_text()
    file.write_text(spoilt)
    with pytest.raises(AssertionError):
        file_checks.check_flex_files(tmp_path, flex)


def test_the_flexes_face_each_other_with_their_tails_to_the_left_and_forward(
    package: FabricationPackage,
) -> None:
    below, above = package.flexes
    # From above, copper that faces up is seen as it is; copper that faces down is mirrored.
    for flex, seen in ((below, 1.0), (above, -1.0)):
        (a, d), (b, e) = flex.artwork_to_foot((1.0, 0.0)), flex.artwork_to_foot((0.0, 1.0))
        assert a * e - b * d == seen
    assert below.artwork_to_foot((1.0, 0.0)) == (0.0, 1.0)
    assert above.artwork_to_foot((1.0, 0.0)) == (1.0, 0.0)
    pitch_mm = FOOT_DESIGN.pitch_mm
    assert dict(above.electrodes)["row1col1"] == (pitch_mm, -pitch_mm)
    assert above.artwork_to_foot((pitch_mm, -pitch_mm)) == (pitch_mm, pitch_mm)


@pytest.mark.parametrize("board", BOARDS)
@pytest.mark.parametrize("radius_mm", [12.0, 20.0, 40.0])
def test_larger_feet_of_the_same_shape_pass_every_check(
    tmp_path: Path, radius_mm: float, board: Board
) -> None:
    size = radius_mm / 10.0
    foot = replace(
        FOOT_DESIGN,
        ball_radius_mm=radius_mm,
        sheet_mm=14.0 * size + 0.01,
        pitch_mm=5.0 * size,
        electrode_mm=4.0 * size,
    )
    package = write_fabrication_package(foot, tmp_path, board=board)
    file_checks.check_all_files(tmp_path, foot, package.flexes)


@pytest.mark.parametrize(
    ("old", "new", "line"),
    [
        (
            "pitch_mm: 5",
            "pitch_mm: 4.2",
            "electrode_mm: .* leave bars of 0.2 mm .*process paper needs 1; use at most 3.2",
        ),
        (
            "gap_um: 20\nfilm_um: 17",
            "gap_um: 45\nfilm_um: 17",
            "gap_um: a gap of 45 um cannot be made, process paper makes .* use at most 40",
        ),
        ("spacer_mm: 0.037", "spacer_mm: 0.03", "spacer_mm: film and spacer are two layers .*use 0.037"),
        (
            "film_eps_r: 2.7",
            "film_eps_r: 3.0",
            "film_um: no process has a film of 17 um .*17 um of 2.7 .paper.",
        ),
    ],
)
def test_a_foot_that_cannot_be_made_is_refused_in_one_line(
    tmp_path: Path, old: str, new: str, line: str
) -> None:
    text = (RELEASED / FOOT_FILE).read_text()
    assert old in text
    text = text.replace("spacer_mm: 0.037", "spacer_mm: 0.062") if "gap_um" in new else text
    (tmp_path / FOOT_FILE).write_text(text.replace(old, new))
    result = CliRunner().invoke(lab, ["fabricate", str(tmp_path), "--out", str(tmp_path / "out")])
    assert isinstance(result.exception, FootsenseError)
    assert str(result.exception).startswith(str(tmp_path / FOOT_FILE))
    assert len(str(result.exception).splitlines()) == 1
    assert re.search(line, str(result.exception)), str(result.exception)


@pytest.mark.parametrize(
    "requirement",
    [
        {"pitch_mm": 4.2},
        {"gap_um": 3.0, "spacer_mm": 0.02},
        {"spacer_mm": 0.03},
        {
            "ball_radius_mm": 1.2,
            "sheet_mm": 5.0,
            "pitch_mm": 2.0,
            "electrode_mm": 1.0,
            "film_um": 12.5,
            "film_eps_r": 3.4,
            "spacer_mm": 0.0325,
        },
    ],
)
@pytest.mark.parametrize("board", BOARDS)
def test_the_value_that_an_error_names_works(requirement: dict[str, Any], board: Board) -> None:
    design, keys = replace(FOOT_DESIGN, **requirement), []
    while problem := next(manufacturing_problems(design, assumed_process(design), board), None):
        found = re.search(r"use (?:(\w+): |at least |at most |)([\d.]*\d)", problem)
        assert found is not None, problem
        key = found[1] or problem.partition(":")[0]
        assert key not in keys, problem  # no problem comes back
        design = replace(design, **{key: float(found[2])})
        keys.append(key)
    assert keys


def test_an_unknown_process_is_refused_with_the_known_ones(tmp_path: Path) -> None:
    arguments = ["fabricate", "aoyagi-3x3", "--out", str(tmp_path), "--process", "printed"]
    assert str(CliRunner().invoke(lab, arguments).exception).startswith(
        "--process printed: not in the table, which"
    )


def test_an_unknown_foot_is_refused_with_the_known_ones(tmp_path: Path) -> None:
    result = CliRunner().invoke(lab, ["fabricate", "aoyagi-9x9", "--out", str(tmp_path)])
    assert "no foot aoyagi-9x9" in str(result.exception)
    assert "aoyagi-3x3" in str(result.exception)
