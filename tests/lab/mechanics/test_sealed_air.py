"""Sealed cavities: known limits, gas law and contact at once, and that a calibration refuses such a foot."""

from dataclasses import replace

import numpy as np
import pytest

from footsense.calibration.calibrate import calibrate
from footsense.errors import CalibrationError
from footsense.foot.gap_contact import CELLS_PER_ELEMENT, N_CELLS, element_means
from footsense.foot.specimen import ContactLoads, Deviations
from footsense.frames import ELEMENTS, Vector
from footsense.lab.fem.sealed_air import SealedFoot
from footsense.sim.loads.press_sequence import paper_presses
from tests.support.test_stand_loads import design, load_set

AMBIENT_MPA = 0.101325


class _PushedFoot(SealedFoot):
    """A sealed foot of any compliance, asked by its closures without air."""

    def __init__(self, compliance: Vector) -> None:
        response = design().response
        object.__setattr__(table := replace(response), "compliance_um_per_n", compliance)
        super().__init__(table)
        self.designed_gap_um = response.design.gap_um
        self.opening = self._opening

    def closures_um(self, free_um: Vector) -> Vector:
        return self._limited_closures_um(free_um)


def coupled(seed: int = 3) -> Vector:
    columns = np.random.default_rng(seed).normal(size=(N_CELLS, 40))
    return np.asarray(40.0 * np.eye(N_CELLS) + columns @ columns.T)


def test_one_cavity_is_boyle_s() -> None:
    """Each element yields for itself: p v = p0 by hand, for closing by 15 um of 20 and for opening."""
    foot = _PushedFoot(40.0 * np.eye(N_CELLS))
    for free_um in (15.0, 200.0, -30.0):
        closure_um = foot.closures_um(np.full((1, N_CELLS), free_um))[0, 0]
        excess_mpa = (free_um - closure_um) / (40.0 * 16.0 / CELLS_PER_ELEMENT)
        assert (AMBIENT_MPA + excess_mpa) * (1.0 - closure_um / foot.designed_gap_um) == pytest.approx(
            AMBIENT_MPA
        )


def test_small_closures_are_those_of_a_spring() -> None:
    """Against the linear law (1 + p0 K / g) d = d0, on coupled cells."""
    foot = _PushedFoot(coupled())
    free_um = 1e-4 * np.random.default_rng(1).normal(size=(3, N_CELLS))
    stiffened = np.eye(ELEMENTS) + AMBIENT_MPA / foot.designed_gap_um * element_means(foot.opening.T).T
    expected_um = np.linalg.solve(stiffened, element_means(free_um).T).T
    found_um = element_means(foot.closures_um(free_um))
    np.testing.assert_allclose(found_um, expected_um, rtol=1e-4, atol=1e-9)


def test_with_gaps_in_contact_both_laws_hold() -> None:
    """Gas law and Signorini's conditions together, where a good part of the cells is closed."""
    compliance = coupled()
    foot = _PushedFoot(compliance)
    free_um = 40.0 + 120.0 * np.random.default_rng(2).normal(size=(6, N_CELLS))
    closure_um = foot.closures_um(free_um)
    closed = closure_um >= foot.designed_gap_um
    assert 0.1 < closed.mean() < 0.9
    excess_mpa = AMBIENT_MPA / (1.0 - element_means(closure_um) / foot.designed_gap_um) - AMBIENT_MPA
    contact_n = np.linalg.solve(compliance, (free_um - excess_mpa @ foot.opening.T - closure_um).T).T
    assert np.abs(contact_n[~closed]).max() < 1e-6 < contact_n[closed].min() + 2e-6


def test_a_calibration_refuses_a_sealed_foot() -> None:
    force_n = paper_presses("training")[::6]
    foot = SealedFoot(design().response, Deviations())
    loads = replace(
        load_set(Deviations(), force_n),
        capacitance_pf=foot.capacitance_pf(*ContactLoads.centred(force_n)),
        baseline_pf=np.tile(foot.unloaded_pf, (len(force_n), 1)),
    )
    with pytest.raises(CalibrationError):
        calibrate(design(), loads)
