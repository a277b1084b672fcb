"""The rungs against each other, against statics, and the table against a solve per load."""

import math

import numpy as np
import pytest

from footsense.foot.response_table import FootResponse
from footsense.foot.specimen import Foot
from footsense.lab.fem.forward import ForwardFoot
from footsense.lab.fem.mesh import COARSE
from footsense.lab.fidelity.half_space import HalfSpace, lattice_opening_mm
from footsense.lab.fidelity.levels import NAMES, GapContact, Linear, rung
from footsense.lab.fidelity.query import response_to
from tests.lab.released import FOOT_DESIGN, RELEASED

pytestmark = pytest.mark.lab

#: An inclined contact that the force leans away from: no symmetry left.
NORMAL = np.array([[np.sin(0.4) * np.cos(0.3), np.sin(0.4) * np.sin(0.3), np.cos(0.4)]])
FORCE = np.array([[0.3, -0.2, 0.9]])


@pytest.fixture(scope="module")
def released() -> FootResponse:
    """Return the released table."""
    return FootResponse.load(RELEASED / "response.npz")


def test_a_solve_per_load_finds_what_the_table_says(released: FootResponse) -> None:
    """Reciprocity, classes, transposed class, patch: every cell, but for what the coarse mesh of this test loses."""
    solved = ForwardFoot(FOOT_DESIGN, COARSE).cells_um(NORMAL[0], FORCE[0])
    tabled = released.free_closure_um(NORMAL, FORCE)[0]
    assert np.abs(solved - tabled).max() < 0.06 * np.abs(tabled).max()


def test_bars_along_one_axis_are_bounded_by_the_exact_value() -> None:
    """Koiter's collinear cracks: 16 b^2 / pi ln sec(pi a / 2 b) is opened in all; an even pressure opens 9 % more."""
    exact_mm = 16.0 * 2.5**2 / math.pi * math.log(1.0 / math.cos(0.4 * math.pi)) / 4.0
    assert 1.0 < lattice_opening_mm(5.0, 1.0, crossing=False) / exact_mm < 1.10


def test_the_sheet_carries_force_and_moment() -> None:
    """A force straight up through the middle: nine elements with their areas carry all of it, and no moment."""
    areas = np.outer([4.5, 5.0, 4.5], [4.5, 5.0, 4.5]).ravel()
    pressure = HalfSpace(FOOT_DESIGN).pressure_mpa(NORMAL, FORCE)[0]
    assert pressure @ areas == pytest.approx(FORCE[0, 2], rel=1e-9)
    assert HalfSpace(FOOT_DESIGN, balanced=False).pressure_mpa(NORMAL, FORCE)[0] @ areas < 0.8 * FORCE[0, 2]


def test_a_mirrored_load_is_answered_mirrored() -> None:
    """The formula has the square's symmetry."""
    flip = np.array([1.0, -1.0, 1.0])
    half_space = HalfSpace(FOOT_DESIGN)
    answered = half_space.answer(NORMAL, FORCE).closure_um.reshape(3, 3)
    mirrored = half_space.answer(NORMAL * flip, FORCE * flip).closure_um.reshape(3, 3)
    np.testing.assert_allclose(mirrored, answered[:, ::-1], rtol=1e-9)


def test_rungs_part_where_a_gap_shuts(released: FootResponse) -> None:
    """Linear and contact are one while all gaps are open; then only contact keeps its closures within the gap."""
    linear, contact = Linear(released), GapContact(released)
    light, firm = 0.05 * FORCE, 5.0 * FORCE
    np.testing.assert_allclose(
        linear.answer(NORMAL, light).capacitance_pf, contact.answer(NORMAL, light).capacitance_pf, rtol=1e-12
    )
    assert (
        linear.answer(NORMAL, firm).closure_um.max()
        > FOOT_DESIGN.gap_um
        >= contact.answer(NORMAL, firm).closure_um.max()
    )
    np.testing.assert_allclose(
        contact.answer(NORMAL, firm).capacitance_pf, Foot(released).capacitance_pf(NORMAL, firm), rtol=1e-12
    )


def test_a_question_is_answered_in_full(released: FootResponse) -> None:
    """A load straight up closes all gaps, corners most, and is reported with everything that it takes to read it."""
    said = response_to(released, FOOT_DESIGN, (0.0, 90.0), 0.5)
    assert said["rung"] == "contact"
    assert said["closure_um"][0][0] > said["closure_um"][1][1] > 0.0
    assert np.min(said["capacitance_pf"]) > said["unloaded_pf"]


def test_what_cannot_be_asked(released: FootResponse) -> None:
    """One line each."""
    with pytest.raises(ValueError, match=f"no rung 'exact'; there are {', '.join(NAMES)}"):
        rung("exact", released, FOOT_DESIGN)
    with pytest.raises(ValueError, match="more than 0 N"):
        response_to(released, FOOT_DESIGN, (0.0, 90.0), 0.0)
    with pytest.raises(ValueError, match="25 deg"):
        response_to(released, FOOT_DESIGN, (0.0, 5.0), 1.0)
    with pytest.raises(ValueError, match="between 0 and 90 deg, got -45"):
        response_to(released, FOOT_DESIGN, (0.0, -45.0), 1.0, "half-space")
