"""The fidelity levels against each other and against statics, and the table against a solve per load."""

import math

import numpy as np
import pytest

from footsense.foot.response_table import FootResponse
from footsense.foot.specimen import Specimen
from footsense.lab.evaluation.fidelity_levels import HalfSpace, fidelity_levels, normalised_cavity_closure_mm
from footsense.lab.fem.forward import DirectSolveFoot
from footsense.lab.fem.mesh import COARSE_MESH
from tests.lab.released import FOOT_DESIGN, RELEASED

pytestmark = pytest.mark.lab

#: An inclined contact that the force leans away from: no symmetry left.
NORMAL = np.array([[np.sin(0.4) * np.cos(0.3), np.sin(0.4) * np.sin(0.3), np.cos(0.4)]])
FORCE = np.array([[0.3, -0.2, 0.9]])


@pytest.fixture(scope="module")
def released() -> FootResponse:
    """Return the released table."""
    return FootResponse.load(RELEASED / "response.npz")


@pytest.mark.slow
def test_one_solve_per_load_equals_the_table(released: FootResponse) -> None:
    """Reciprocity, classes, transposed class, patch: every cell, within the error of the coarse mesh."""
    solved = DirectSolveFoot(FOOT_DESIGN, COARSE_MESH).cell_closures_um(NORMAL[0], FORCE[0])
    tabled = released.free_closure_um(NORMAL, FORCE)[0]
    assert np.abs(solved - tabled).max() < 0.06 * np.abs(tabled).max()


def test_bars_along_one_axis_are_bounded_by_the_exact_value() -> None:
    """Koiter's collinear cracks: 16 b^2 / pi ln sec(pi a / 2 b) is opened in all; an even pressure opens 9 % more."""
    exact_mm = 16.0 * 2.5**2 / math.pi * math.log(1.0 / math.cos(0.4 * math.pi)) / 4.0
    assert 1.0 < normalised_cavity_closure_mm(5.0, 1.0, crossing=False) / exact_mm < 1.10


def test_the_sheet_carries_force_and_moment() -> None:
    """A force straight up through the middle: nine elements with their areas carry all of it, and no moment."""
    areas = np.outer([4.5, 5.0, 4.5], [4.5, 5.0, 4.5]).ravel()
    pressure = HalfSpace(FOOT_DESIGN).element_pressure_mpa(NORMAL, FORCE)[0]
    assert pressure @ areas == pytest.approx(FORCE[0, 2], rel=1e-9)


def test_a_mirrored_load_has_mirrored_closures() -> None:
    """The formula has the square's symmetry."""
    flip = np.array([1.0, -1.0, 1.0])
    half_space = HalfSpace(FOOT_DESIGN)
    plain = half_space.closure_um(NORMAL, FORCE).reshape(3, 3)
    mirrored = half_space.closure_um(NORMAL * flip, FORCE * flip).reshape(3, 3)
    np.testing.assert_allclose(mirrored, plain[:, ::-1], rtol=1e-9)


def test_levels_differ_once_a_gap_closes(released: FootResponse) -> None:
    """Linear and contact are one while all gaps are open; then only contact keeps its closures within the gap."""
    levels = fidelity_levels(released, FOOT_DESIGN, COARSE_MESH)
    linear, contact = (levels[name]() for name in ("linear", "contact"))
    light, firm = 0.05 * FORCE, 5.0 * FORCE
    np.testing.assert_allclose(
        linear(NORMAL, light).capacitance_pf, contact(NORMAL, light).capacitance_pf, rtol=1e-12
    )
    assert (
        linear(NORMAL, firm).closure_um.max() > FOOT_DESIGN.gap_um >= contact(NORMAL, firm).closure_um.max()
    )
    np.testing.assert_allclose(
        contact(NORMAL, firm).capacitance_pf, Specimen(released).capacitance_pf(NORMAL, firm), rtol=1e-12
    )
