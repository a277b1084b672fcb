"""Air in the cavities: known limits, an energy balance, and the course of a leak."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from footsense.errors import ModelError
from footsense.foot.cavity import ADIABATIC, AMBIENT_MPA, Cavity, CavityPressures, Gas
from footsense.foot.gap_contact import CELLS_PER_ELEMENT, element_means
from footsense.foot.response_table import FootResponse
from footsense.foot.specimen import Foot
from footsense.frames import Vector
from tests.unit.foot.test_response_table import UP, made_up

#: Cells of the paper's foot.
ALL_CELLS = 9 * CELLS_PER_ELEMENT

GAP_UM = 20.0
#: Opening of an element under a pressure in its own cavity, of a solid whose cells each yield for themselves [um/MPa].
OWN_UM_PER_MPA = 40.0 * 16.0 / CELLS_PER_ELEMENT
SEALED = Cavity(kind="sealed")


def coupled(seed: int = 3) -> Vector:
    """Return a compliance of coupled cells [um/N]."""
    columns = np.random.default_rng(seed).normal(size=(ALL_CELLS, 40))
    return np.asarray(40.0 * np.eye(ALL_CELLS) + columns @ columns.T)


def air_of(compliance: Vector) -> CavityPressures:
    """Return the pressures of a foot with equal gaps."""
    return CavityPressures(np.full(9, GAP_UM), compliance, 16.0)


def test_one_cavity_is_boyle_s() -> None:
    """Each element yields for itself: p v = p0 by hand, for closing by 15 um of 20 and for opening."""
    for free_um in (15.0, 200.0, -30.0):
        closure_um, excess_mpa = air_of(40.0 * np.eye(ALL_CELLS)).closures_and_excess_pressures(
            np.full((1, ALL_CELLS), free_um), Gas(np.full(9, AMBIENT_MPA)), contact=True
        )
        left = 1.0 - closure_um[0, 0] / GAP_UM
        assert (AMBIENT_MPA + excess_mpa[0, 0]) * left == pytest.approx(AMBIENT_MPA, rel=1e-9)
        assert closure_um[0, 0] == pytest.approx(free_um - OWN_UM_PER_MPA * excess_mpa[0, 0], rel=1e-12)


@pytest.mark.parametrize("exponent", [1.0, ADIABATIC])
def test_small_closures_are_those_of_a_spring(exponent: float) -> None:
    """Against the linear law (1 + n p0 K / g) d = d0, on coupled cells."""
    compliance = coupled()
    free_um = 1e-4 * np.random.default_rng(1).normal(size=(3, ALL_CELLS))
    gas = Gas(np.full(9, AMBIENT_MPA), exponent=exponent)
    closure_um, _ = air_of(compliance).closures_and_excess_pressures(free_um, gas, contact=True)
    by_element = compliance.reshape(9, CELLS_PER_ELEMENT, 9, CELLS_PER_ELEMENT)
    opening = by_element.mean(axis=1).sum(axis=2) * 16.0 / CELLS_PER_ELEMENT
    stiffened = np.eye(9) + exponent * AMBIENT_MPA / GAP_UM * opening
    expected_um = np.linalg.solve(stiffened, element_means(free_um).T).T
    np.testing.assert_allclose(element_means(closure_um), expected_um, rtol=1e-4, atol=1e-9)


def test_with_gaps_in_contact_both_laws_hold() -> None:
    """Balance, gas law and Signorini's conditions together, where a third of the cells is closed."""
    compliance = coupled()
    free_um = 40.0 + 120.0 * np.random.default_rng(2).normal(size=(6, ALL_CELLS))
    closure_um, excess_mpa = air_of(compliance).closures_and_excess_pressures(
        free_um, Gas(np.full(9, AMBIENT_MPA)), contact=True
    )
    closed = closure_um >= GAP_UM
    assert 0.1 < closed.mean() < 0.9
    left = 1.0 - element_means(closure_um) / GAP_UM
    np.testing.assert_allclose((AMBIENT_MPA + excess_mpa) * left, AMBIENT_MPA, rtol=1e-6)
    carried_n = np.linalg.solve(compliance, (free_um - closure_um).T).T
    contact_n = carried_n - np.repeat(excess_mpa, CELLS_PER_ELEMENT, axis=1) * 16.0 / CELLS_PER_ELEMENT
    assert np.abs(contact_n[~closed]).max() < 1e-7
    assert contact_n[closed].min() > -1e-7
    assert (closure_um <= GAP_UM).all()


def test_the_work_of_the_load_is_stored_in_solid_and_air() -> None:
    """Raised in small steps, a load does the work that stretches the solid and compresses the air: p0 V0 ln(V0/V)."""
    columns = np.repeat(np.random.default_rng(4).normal(size=(9, 9)), CELLS_PER_ELEMENT, axis=0)
    compliance, free_um = 40.0 * np.eye(ALL_CELLS) + columns @ columns.T, np.full((1, ALL_CELLS), 60.0)
    air, gas = air_of(compliance), Gas(np.full(9, AMBIENT_MPA))
    # Closing pressures that would close the empty foot by free_um do their work on the closures themselves.
    pressing_n = np.linalg.solve(compliance, free_um[0])
    shares = np.linspace(0.0, 1.0, 401)[:, None]
    closure_um, _ = air.closures_and_excess_pressures(shares * free_um, gas, contact=False)
    assert 0.5 * GAP_UM < closure_um.max() < GAP_UM
    work_num = np.trapezoid(closure_um @ pressing_n, shares[:, 0])
    work_num = closure_um[-1] @ pressing_n - work_num
    elastic_num = 0.5 * closure_um[-1] @ np.linalg.solve(compliance, closure_um[-1])
    left = 1.0 - element_means(closure_um[-1]) / GAP_UM
    air_num = 16.0 * GAP_UM * (-AMBIENT_MPA * np.log(left) - AMBIENT_MPA * (1.0 - left)).sum()
    assert work_num == pytest.approx(elastic_num + air_num, rel=1e-4)


def foot(cavity: Cavity) -> Foot:
    """Return a foot that an upright newton closes by 10 um evenly."""
    response = replace(made_up(), cavity=cavity)
    response.closure_coefficients[...] = 0.0
    response.closure_coefficients[0, 0, 2 * ALL_CELLS :] = 10.0
    return Foot(response)


def test_a_leak_goes_from_sealed_to_vented() -> None:
    """At once as a sealed foot, later as a vented one, between them with the time constant tau (1 + p0 K / g)."""
    leaking, up, force_n = foot(Cavity(kind="leaking", leak_time_s=2.0)), UP[None], 0.02 * UP[None]
    vented_um, sealed_um = (foot(kind).cell_closures_um(up, force_n).mean() for kind in (Cavity(), SEALED))
    gas = leaking.cavity.gas
    assert gas is not None
    assert leaking.cell_closures_um(up, force_n, gas).mean() == pytest.approx(sealed_um, rel=1e-12)
    step_s = 0.005
    tau_s = 2.0 * (1.0 + AMBIENT_MPA * OWN_UM_PER_MPA / GAP_UM)
    for number in range(1, 601):
        _, gas = leaking.capacitance_and_gas_after_step(
            up, force_n, gas._replace(step_over_leak_time=step_s / 2.0)
        )
        if number in (100, 600):
            left = (vented_um - leaking.cell_closures_um(up, force_n, gas).mean()) / (vented_um - sealed_um)
            assert left == pytest.approx(np.exp(-number * step_s / tau_s), rel=0.02)
    _, gas = leaking.capacitance_and_gas_after_step(up, force_n, gas._replace(step_over_leak_time=1e9))
    assert leaking.cell_closures_um(up, force_n, gas).mean() == pytest.approx(vented_um, rel=1e-6)


def test_a_softer_solid_is_a_smaller_load_under_smaller_pressures() -> None:
    """The scaling that a warming foot is computed by is exact."""
    compliance, free_um = coupled(), 30.0 * np.ones((1, ALL_CELLS))
    gas = Gas(np.full(9, AMBIENT_MPA))
    soft_um, _ = air_of(1.3 * compliance).closures_and_excess_pressures(1.3 * free_um, gas, contact=True)
    scaled_um, _ = air_of(compliance).closures_and_excess_pressures(
        1.3 * free_um, gas.scaled_for_relative_compliance(1.3), contact=True
    )
    np.testing.assert_allclose(soft_um, scaled_um, rtol=1e-9)


def test_thin_air_inside_draws_the_plates_together() -> None:
    """A foot sealed hot rests with closed gaps, and reads more when unloaded."""
    assert (foot(Cavity(kind="sealed", gas_kpa=80.0)).unloaded_pf > foot(SEALED).unloaded_pf + 0.05).all()


def test_a_table_keeps_its_cavities(tmp_path: Path) -> None:
    """They come back from the file; a file that names an impossible one is refused."""
    for cavity in (
        Cavity(),
        SEALED,
        Cavity(kind="leaking", leak_time_s=3.0),
        Cavity(kind="sealed", gas_kpa=80.0),
    ):
        replace(made_up(), cavity=cavity).save(tmp_path / "response.npz")
        assert FootResponse.load(tmp_path / "response.npz").cavity == cavity
    wrong = Cavity(kind="leaking", leak_time_s=3.0)
    object.__setattr__(wrong, "leak_time_s", -3.0)
    replace(made_up(), cavity=wrong).save(tmp_path / "response.npz")
    with pytest.raises(ModelError, match="leak_time_s: a leaking cavity has one above 0 s"):
        FootResponse.load(tmp_path / "response.npz")
