"""`footsense lab design`: similarity, prediction against solved tables, the paper's foot, conflicting requirements."""

from typing import get_args

import msgspec
import numpy as np
import pytest

from footsense.errors import FootsenseError
from footsense.foot.response_table import FootResponse
from footsense.foot.specimen import ContactLoads, Deviations, Specimen
from footsense.lab.build import response_in_force_unit
from footsense.lab.design.assess import assess_foot
from footsense.lab.design.design import choose_candidates, foot_text
from footsense.lab.design.materials import load_materials
from footsense.lab.design.processes import assumed_process, named_process
from footsense.lab.design.requirements import Requirements, converter
from footsense.lab.design.screen import TRAINED_RANGE_FACTOR
from footsense.lab.design.shapes import FootShapeLibrary
from footsense.lab.evaluation.force_range import UPRIGHT, force_range, friction_loads, largest_loads_n
from footsense.lab.fabrication.parts.flex import Board
from footsense.lab.fabrication.tolerances import manufacturing_problems
from footsense.lab.foot_file import load_foot
from footsense.lab.geometry import FootDesign, Material
from footsense.lab.training.load_cases import sensed_closure_um
from tests.lab.released import FOOT_DESIGN, RELEASED

pytestmark = pytest.mark.lab


def requirements(
    max_load_n: float,
    ball_mm: tuple[float, float],
    *material: str,
    process: str = "flex",
    board: str = "ad7147",
    lean_deg: float = 30.0,
) -> Requirements:
    """Return the requirements of a robot, with few materials."""
    return Requirements(
        max_load_n=max_load_n,
        min_load_n=max_load_n / 20.0,
        lean_deg=lean_deg,
        max_noise_direction_error_deg=2.5,
        ball_diameter_range_mm=ball_mm,
        materials=load_materials().select_materials(material),
        process=named_process(process),
        board=converter(board),
    )


@pytest.fixture(scope="module")
def library() -> FootShapeLibrary:
    """Return the solved shapes."""
    return FootShapeLibrary()


def test_a_foot_of_another_size_and_modulus_closes_alike(library: FootShapeLibrary) -> None:
    """Twice as large and three times as stiff under twelve times the force: the same closures over the gap."""
    small = FOOT_DESIGN
    lengths = {
        name: 2.0 * getattr(small, name) for name in msgspec.structs.asdict(small) if name.endswith("_mm")
    }
    large = msgspec.structs.replace(
        small,
        **lengths,
        gap_um=2.0 * small.gap_um,
        film_um=2.0 * small.film_um,
        rubber=Material(3.0 * small.rubber.youngs_mpa, small.rubber.poisson),
        pdms=Material(3.0 * small.pdms.youngs_mpa, small.pdms.poisson),
    )
    normal = np.array([[0.0, 0.0, 1.0], [0.5, 0.0, np.sqrt(0.75)]])
    closures = [
        sensed_closure_um(Specimen(library.response(foot)), normal, force * normal) / foot.gap_um
        for foot, force in ((small, 1.9), (large, 12.0 * 1.9))
    ]
    assert closures[0].max() > 0.85  # gaps touch
    np.testing.assert_allclose(closures[1], closures[0], rtol=1e-9)


def test_the_library_has_the_released_foot(library: FootShapeLibrary) -> None:
    """The paper's shape is one of those solved: its closures are the released table's."""
    released = FootResponse.load(RELEASED / "response.npz")
    normal = np.array([[0.0, 0.0, 1.0], [0.5, 0.3, np.sqrt(0.66)]])
    np.testing.assert_allclose(
        library.response(FOOT_DESIGN).free_element_closures_um(normal, normal),
        released.free_element_closures_um(normal, normal),
        rtol=0.01,
    )


def test_the_range_ends_at_four_fifths_of_the_gap_or_with_the_converter() -> None:
    """Of a foot with strays and gaps of its own, too."""
    released = FootResponse.load(RELEASED / "response.npz")
    stray_pf, gap_um = np.full(9, 0.5), np.linspace(-2.0, 2.0, 9)
    foot = Specimen(released, Deviations(stray_pf=stray_pf, gap_um=gap_um))
    loads = friction_loads(UPRIGHT, 14.0)
    readable_n = largest_loads_n(foot, loads, np.inf)
    capacitance_pf = foot.capacitance_pf(loads.normal, readable_n[:, None] * loads.force_n) - stray_pf
    closure_rel = released.design.closure_um(capacitance_pf, foot.unloaded_pf - stray_pf) / foot.gap_um
    np.testing.assert_allclose(closure_rel.max(axis=1), 0.8, rtol=1e-3)
    converter_n = largest_loads_n(foot, loads, 10.0)
    at_end_pf = foot.capacitance_pf(loads.normal, converter_n[:, None] * loads.force_n)
    np.testing.assert_allclose(at_end_pf.max(axis=1), 10.0, rtol=3e-3)
    assert (converter_n < readable_n).all()


def test_a_leaning_force_ends_the_range_first() -> None:
    """Its load on an upright contact falls with the lean, no azimuth between is worse; the training is an end, too."""
    foot = Specimen(FootResponse.load(RELEASED / "response.npz"))
    stated = force_range(foot, 2.0)
    assert (np.diff(stated.upright_n) < 0.0).all()
    assert stated.centred_n < stated.upright_n[0]
    azimuth = np.radians(np.arange(0.0, 360.0, 9.0))
    around = np.stack([np.cos(azimuth), np.sin(azimuth), np.zeros_like(azimuth)], axis=1)
    loads = ContactLoads(np.tile(UPRIGHT, (40, 1)), UPRIGHT + np.tan(np.radians(30.0)) * around)
    assert largest_loads_n(foot, loads).min() == pytest.approx(stated.upright_n[2], rel=0.01)
    capped = force_range(foot, 0.5)
    np.testing.assert_allclose(capped.upright_n[:2], 0.5 * np.cos(np.radians([0.0, 14.0])))
    assert (capped.upright_n[2], capped.centred_n) == (stated.upright_n[2], 0.5)


def test_a_force_unit_leaves_closures_alone() -> None:
    """A foot in a unit of 6 closes under 0.3 N as it does under 1.8 N."""
    released = FootResponse.load(RELEASED / "response.npz")
    normal = np.array([[0.0, 0.0, 1.0], [0.5, 0.3, np.sqrt(0.66)]])
    scaled = response_in_force_unit(released, 6.0)
    np.testing.assert_allclose(
        sensed_closure_um(Specimen(scaled), normal, 0.3 * normal),
        sensed_closure_um(Specimen(released), normal, 1.8 * normal),
        rtol=1e-9,
    )
    assert response_in_force_unit(released, 1.0).hertz_modulus_mpa == released.hertz_modulus_mpa


def paper_design(library: FootShapeLibrary) -> FootDesign:
    """Return the most accurate foot for the paper's own numbers: its ball, materials, process and forces."""
    asked = requirements(1.0, (20.0, 20.0), "butadiene-paper", "pdms-paper", process="paper", lean_deg=5.0)
    choice = choose_candidates(library, asked, 1)
    return load_foot(
        foot_text(
            "again", "The paper's numbers", choice.manufacturable, int(choice.rows_to_assess[0][0]), asked
        ).encode()
    )


def test_the_papers_foot_comes_out_of_its_own_numbers(library: FootShapeLibrary) -> None:
    """150 gf on a ball of 20 mm, of its rubber and PDMS: gap, pitch and electrodes of the paper."""
    found = paper_design(library)
    same = (
        "ball_radius_mm",
        "sheet_mm",
        "plate_mm",
        "pitch_mm",
        "electrode_mm",
        "gap_um",
        "film_um",
        "spacer_mm",
    )
    assert {name: getattr(found, name) for name in same} == {
        name: getattr(FOOT_DESIGN, name) for name in same
    }


def test_the_outer_elements_end_with_the_sheet(library: FootShapeLibrary) -> None:
    """A strip beside them, were it of rounding alone, would join the plates and take a quarter off the closures."""
    asked = requirements(12.0, (36.0, 36.0), "urethane-90a", "tpu-85a")
    choice = choose_candidates(library, asked, 1)
    found = load_foot(
        foot_text("again", "Thirty", choice.manufacturable, int(choice.rows_to_assess[0][0]), asked).encode()
    )
    assert found.sheet_mm == pytest.approx(2.0 * found.pitch_mm + found.electrode_mm, abs=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("board", get_args(Board))
def test_what_is_chosen_for_a_board_can_be_made_for_it(library: FootShapeLibrary, board: Board) -> None:
    """Five traces in a bar between two columns need a wider one, and their tail a larger ball."""
    asked = requirements(0.7, (10.0, 18.0), board=board)
    found = choose_candidates(library, asked, 1).manufacturable
    bar_mm = found.pitch_mm - found.electrode_mm
    has_lines = board != "fdc1004"
    assert (bar_mm.min() > 0.9525, found.ball_radius_mm.min() >= 8.4) == (has_lines, has_lines)
    for row in (int(bar_mm.argmin()), int(found.ball_radius_mm.argmin())):
        foot = load_foot(foot_text("small", "The smallest", found, row, asked).encode())
        problems = manufacturing_problems(foot, assumed_process(foot, "flex"), board)
        assert [problem for problem in problems if "bars of" in problem or "tail of" in problem] == []


@pytest.mark.parametrize("foot_type", ["hexapod-2kg", "quadruped-12kg"])
def test_a_released_foot_is_as_predicted(library: FootShapeLibrary, foot_type: str) -> None:
    """Ranges and errors of the solved table are within 8 % of the prediction without a mesh, and it reads its load."""
    folder = RELEASED.parent / foot_type
    design, built = load_foot(folder / "foot.yaml"), FootResponse.load(folder / "response.npz")
    asked = requirements(design.loads.max_n / TRAINED_RANGE_FACTOR, (20.0, 60.0))
    predicted, measured = (
        assess_foot(design, response, asked) for response in (library.response(design), built)
    )
    for name, value in predicted._asdict().items():
        np.testing.assert_allclose(value, getattr(measured, name), rtol=0.08, err_msg=name)
    assert measured.design_range_n >= asked.max_load_n


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        (
            requirements(50.0, (20.0, 20.0), "urethane-80a"),
            r"--max-load 50 and --ball 20 conflict.*leaning 30 deg.*nearest that works: --ball",
        ),
        (
            requirements(1.5, (3.0, 3.0), board="fdc1004"),
            r"--ball 3 and bars of at least 0\.8 mm conflict.*use a ball from",
        ),
        (
            requirements(1.5, (3.0, 16.0)),
            r"--ball 16 and --board ad7147 conflict.*use a ball from 17 mm",
        ),
        (
            requirements(1.5, (110.0, 120.0), process="paper"),
            r"--ball 110 120 and --board ad7147 conflict.*up to",
        ),
        (
            requirements(4.0, (20.0, 30.0), "urethane-90a")._replace(min_load_n=1e-3),
            r"--min-load 0\.001 and --max-load 4 conflict at --error 2\.5:.*process makes 20 um.*--error",
        ),
    ],
    ids=["load", "bars", "tail", "board", "noise"],
)
@pytest.mark.slow
def test_requirements_that_conflict_are_named(
    library: FootShapeLibrary, asked: Requirements, message: str
) -> None:
    """One line: which requirement conflicts with which, and the nearest design that works."""
    with pytest.raises(FootsenseError, match=message) as refused:
        choose_candidates(library, asked, 1)
    assert "\n" not in str(refused.value)
