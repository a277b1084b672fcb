"""One specimen of a foot: what its deviations do, and what a gap that shuts does."""

import numpy as np
import pytest

from footsense.foot.directions import rotation
from footsense.foot.gap_contact import CELLS_PER_ELEMENT, solve_contact_lcp
from footsense.foot.specimen import Deviations, Specimen
from tests.unit.foot.test_response_table import DESIGN, UP, made_up, random_normals

#: Cells of the paper's foot.
ALL_CELLS = 9 * CELLS_PER_ELEMENT

RESPONSE = made_up()
NORMAL = random_normals(4)
LIGHT_N = 0.05 * NORMAL
#: Presses some of the cells beyond their gaps, by far.
HEAVY_N = 20.0 * NORMAL


def test_a_foot_as_designed_is_the_design() -> None:
    """Unloaded it reads the designed capacitance, and under a light load it closes as the table says."""
    foot = Specimen(RESPONSE)
    np.testing.assert_allclose(foot.unloaded_pf, DESIGN.unloaded_pf, rtol=1e-12)
    np.testing.assert_array_equal(
        foot.cell_closures_um(NORMAL, LIGHT_N), RESPONSE.free_closure_um(NORMAL, LIGHT_N)
    )


def test_rest_is_each_element_s_own() -> None:
    """unloaded_pf = eps0 A / (gap + film / eps_r) + stray, by hand."""
    steps = np.linspace(-1.0, 1.0, 9)
    own = Deviations(gap_um=steps, film_um=2.0 * steps, stray_pf=0.1 + 0.05 * steps)
    by_hand = 8.8541878128 * 16.0 / (20.0 + steps + (17.0 + 2.0 * steps) / 2.7) + 0.1 + 0.05 * steps
    foot = Specimen(RESPONSE, own)
    np.testing.assert_allclose(foot.unloaded_pf, by_hand, rtol=1e-12)
    np.testing.assert_array_equal(
        foot.capacitance_pf(NORMAL, 0.0 * NORMAL), np.tile(foot.unloaded_pf, (4, 1))
    )


def test_contact_is_what_a_limit_leaves_out() -> None:
    """Cells that yield each for itself feel nothing of a neighbour's contact; those that share a solid do."""
    limited = Specimen(RESPONSE, contact=False).cell_closures_um(NORMAL, HEAVY_N)
    np.testing.assert_allclose(Specimen(RESPONSE).cell_closures_um(NORMAL, HEAVY_N), limited, atol=1e-9)
    shared = made_up()
    shared.compliance_um_per_n[...] += 5.0
    touched = Specimen(shared).cell_closures_um(NORMAL, HEAVY_N)
    inside = limited < DESIGN.gap_um
    assert (touched[inside] < limited[inside] - 1e-3).all()


def test_a_shut_element_shows_its_film() -> None:
    """All cells shut give eps0 A eps_r / t: 16 mm2 over 17 um of 2.7 is 22.5 pF, beside the stray."""
    response = made_up()
    response.closure_coefficients[...] = 0.0
    response.closure_coefficients[0, 0, 2 * ALL_CELLS :] = 1.0  # fz alone, each cell by 1 um/N
    foot = Specimen(response, Deviations(stray_pf=np.full(9, 0.3)), contact=False)
    shut_pf = foot.capacitance_pf(UP[None], 25.0 * UP[None])
    np.testing.assert_allclose(shut_pf, 8.8541878128 * 16.0 * 2.7 / 17.0 + 0.3, rtol=1e-12)


def test_a_stiffer_foot_closes_less() -> None:
    """By the stiffness; in contact too, where the gaps push back on a solid that yields less."""
    plain, stiff = Specimen(RESPONSE), Specimen(RESPONSE, Deviations(stiffness_rel=0.25))
    np.testing.assert_allclose(
        stiff.cell_closures_um(NORMAL, LIGHT_N), plain.cell_closures_um(NORMAL, LIGHT_N) / 1.25
    )
    gap_um = np.full(ALL_CELLS, DESIGN.gap_um)
    for load, free_um in enumerate(RESPONSE.free_closure_um(NORMAL, HEAVY_N) / 1.25):
        # Softness scales load and compliance alike, so the closures are those of the plain foot under less load.
        expected_um = solve_contact_lcp(free_um, gap_um, RESPONSE.compliance_um_per_n).cell_closures_um
        np.testing.assert_allclose(stiff.cell_closures_um(NORMAL, HEAVY_N)[load], expected_um, atol=1e-9)


def test_a_turned_mount_feels_a_turned_load() -> None:
    """A foot that sits 10 deg about z on its leg reads what a straight one reads of the load turned by 10 deg."""
    turn = rotation(np.array([0.0, 0.0, np.radians(10.0)]))
    turned = Specimen(RESPONSE, Deviations(mount=turn)).cell_closures_um(NORMAL, LIGHT_N)
    straight = Specimen(RESPONSE).cell_closures_um(NORMAL @ turn.T, LIGHT_N @ turn.T)
    np.testing.assert_allclose(turned, straight, rtol=1e-12)
    assert np.abs(turned - Specimen(RESPONSE).cell_closures_um(NORMAL, LIGHT_N)).max() > 1e-3


@pytest.mark.parametrize(
    "own",
    [
        Deviations(gap_um=np.full(9, -20.0)),
        Deviations(film_um=np.full(9, -17.0)),
        Deviations(stiffness_rel=-1.0),
    ],
)
def test_a_foot_that_cannot_be_is_refused(own: Deviations) -> None:
    """No gap, no film, or no stiffness."""
    with pytest.raises(ValueError, match="have to be above 0"):
        Specimen(RESPONSE, own)
