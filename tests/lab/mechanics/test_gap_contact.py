"""Unilateral contact of the gaps: one solution, whichever way it is sought, and no jump on the way to it."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.optimize import nnls

from footsense.foot.directions import directions
from footsense.foot.force_errors import GRAM_FORCE_N
from footsense.foot.gap_contact import ContactSolution, closures_for_closed_cells_um, solve_contact_lcp
from footsense.foot.response_table import FootResponse
from footsense.foot.specimen import Specimen

pytestmark = pytest.mark.lab

Vector = NDArray[np.float64]

RELEASED = Path(__file__).parents[3] / "models" / "aoyagi-3x3" / "response.npz"
UP = np.array([[0.0, 0.0, 1.0]])

seeds = st.integers(0, 2**32 - 1)
sizes = st.integers(1, 24)


def problem(seed: int, n: int) -> tuple[Vector, Vector, Vector]:
    """Return free closures, gaps and a compliance of condition up to 1e6, on any scale."""
    rng = np.random.default_rng(seed)
    turned, _ = np.linalg.qr(rng.normal(size=(n, n)))
    stiff = 10.0 ** rng.uniform(-3.0, 3.0, n)
    compliance = (turned * stiff) @ turned.T
    gap_um = rng.uniform(5.0, 25.0, n)
    return rng.normal(scale=30.0, size=n), gap_um, (compliance + compliance.T) / 2.0


def kkt_residual(
    solution: ContactSolution, free_um: Vector, gap_um: Vector, compliance_um_per_n: Vector
) -> dict[str, float]:
    """Return how far a solution violates each optimality (KKT) condition, by name; zero for an exact one.

    Args:
        solution: The solution.
        free_um: Closure of each cell without contact [um], shape (324,).
        gap_um: Gap of each cell at rest [um], shape (324,).
        compliance_um_per_n: B, shape (324, 324).

    Returns:
        The largest of each: `balance_um` |d - (d0 - B l)|, `penetration_um` d - g, `pull_n` -l, `slack_nm_n`
        |l (g - d)|.
    """
    balance_um = solution.cell_closures_um - (free_um - compliance_um_per_n @ solution.cell_forces_n)
    slack_um = gap_um - solution.cell_closures_um
    return {
        "balance_um": float(np.abs(balance_um).max()),
        "penetration_um": float(max(0.0, -slack_um.min())),
        "pull_n": float(max(0.0, -solution.cell_forces_n.min())),
        "slack_nm_n": float(1e3 * np.abs(slack_um * solution.cell_forces_n).max()),
    }


def by_least_squares(free_um: Vector, gap_um: Vector, compliance: Vector) -> Vector:
    """Return the contact forces as the minimum of l B l / 2 - l (d0 - g) over l >= 0, by another algorithm."""
    root = np.linalg.cholesky(compliance)
    force, _ = nnls(root.T, np.linalg.solve(root, free_um - gap_um))
    return np.asarray(force)


@given(seeds, sizes)
def test_all_four_conditions_hold_to_rounding(seed: int, n: int) -> None:
    """Balance within 1e-9 of the closures; no penetration, no pull and no force across a gap at all."""
    free_um, gap_um, compliance = problem(seed, n)
    rest = kkt_residual(solve_contact_lcp(free_um, gap_um, compliance), free_um, gap_um, compliance)
    assert rest["balance_um"] <= 1e-8 * max(1.0, np.abs(free_um).max())
    assert rest["penetration_um"] <= 1e-9 * gap_um.max()
    assert rest["pull_n"] == 0.0
    assert rest["slack_nm_n"] <= 1e-6


@given(seeds, sizes)
def test_the_closures_of_the_cells_that_are_closed_are_the_solution(seed: int, n: int) -> None:
    """And they change with the load as the solution does, while no other cell closes."""
    free_um, gap_um, compliance = problem(seed, n)
    solution = solve_contact_lcp(free_um, gap_um, compliance)
    closed = (solution.cell_forces_n > 0.0)[None]
    variants_um = np.stack([free_um, 1.001 * free_um])
    found_um = closures_for_closed_cells_um(
        variants_um[:, None], np.stack([gap_um] * 2), 3.0 * compliance, closed
    )
    scale_um = np.abs(free_um).max()
    np.testing.assert_allclose(found_um[0, 0], solution.cell_closures_um, atol=1e-8 * scale_um)
    moved = solve_contact_lcp(variants_um[1], gap_um, compliance)
    if ((moved.cell_forces_n > 0.0) == closed[0]).all():
        np.testing.assert_allclose(found_um[1, 0], moved.cell_closures_um, atol=1e-8 * scale_um)


@given(seeds, sizes)
def test_least_squares_finds_the_same(seed: int, n: int) -> None:
    """The contact forces minimise the energy: non-negative least squares agrees in what energy weighs."""
    free_um, gap_um, compliance = problem(seed, n)
    found, other = (
        solve_contact_lcp(free_um, gap_um, compliance).cell_forces_n,
        by_least_squares(free_um, gap_um, compliance),
    )
    apart = found - other
    assert apart @ compliance @ apart <= 1e-12 * max(
        1.0, float(free_um @ np.linalg.solve(compliance, free_um))
    )


@given(seeds, sizes)
def test_closures_follow_the_load_without_a_jump(seed: int, n: int) -> None:
    """A projection in the energy norm: two solutions are never further apart than their loads."""
    free_um, gap_um, compliance = problem(seed, n)
    moved_um = free_um + np.random.default_rng(seed + 1).normal(scale=3.0, size=n)
    apart = (
        solve_contact_lcp(moved_um, gap_um, compliance).cell_closures_um
        - solve_contact_lcp(free_um, gap_um, compliance).cell_closures_um
    )
    stiffness = np.linalg.inv(compliance)
    before = (moved_um - free_um) @ stiffness @ (moved_um - free_um)
    assert apart @ stiffness @ apart <= before * (1.0 + 1e-6)


@pytest.fixture(scope="module")
def released() -> FootResponse:
    """Return the shipped table."""
    return FootResponse.load(RELEASED)


@settings(max_examples=20, deadline=None)
@given(st.floats(0.0, 360.0), st.floats(40.0, 90.0), st.floats(0.5, 20.0))
def test_a_foot_under_load_keeps_all_conditions(azimuth: float, elevation: float, force_n: float) -> None:
    """324 cells of the released foot, from all open to most closed: residuals at rounding."""
    released = FootResponse.load(RELEASED)
    normal = directions(np.array(azimuth), np.array(elevation))
    free_um = released.free_closure_um(normal, force_n * normal)
    gap_um = np.full(324, released.design.gap_um)
    compliance = released.compliance_um_per_n
    rest = kkt_residual(solve_contact_lcp(free_um, gap_um, compliance), free_um, gap_um, compliance)
    assert rest["balance_um"] < 1e-9 * np.abs(free_um).max()
    assert (rest["penetration_um"], rest["pull_n"]) == (0.0, 0.0)


def test_from_no_load_to_everything_shut_without_a_jump(released: FootResponse) -> None:
    """Closures never fall, never leap by more than the load's step could move them, and end at the gap."""
    foot, gap_um = Specimen(released), released.design.gap_um
    steps_n = np.concatenate([np.linspace(0.0, 5.0, 101), np.geomspace(5.0, 200.0, 60)[1:]])
    closure_um = foot.cell_closures_um(np.repeat(UP, len(steps_n), 0), UP * steps_n[:, None])
    rise_um = np.diff(closure_um, axis=0)
    assert (closure_um[0] == 0.0).all()
    assert rise_um.min() > -1e-9
    per_newton = released.free_closure_um(UP, 20.0 * UP).max() / 20.0
    assert (rise_um.max(axis=1) < 2.0 * per_newton * np.diff(steps_n)).all()
    assert (closure_um[-1] == gap_um).all()


def test_a_tenth_of_a_gram_keeps_its_relative_accuracy(released: FootResponse) -> None:
    """0.1 gf and a millionth of it: closures per newton differ by the patch alone, which is below 1e-3."""
    foot = Specimen(released)
    small_n = 0.1 * GRAM_FORCE_N
    forces_n = np.array([small_n, 1e-6 * small_n])
    per_newton = foot.cell_closures_um(np.repeat(UP, 2, 0), UP * forces_n[:, None]) / forces_n[:, None]
    np.testing.assert_allclose(per_newton[0], per_newton[1], rtol=0.0, atol=1e-3 * per_newton[1].max())
    sensed_um = released.design.closure_um(foot.capacitance_pf(UP, small_n * UP), foot.unloaded_pf)
    np.testing.assert_allclose(
        sensed_um[0], released.free_element_closures_um(UP[0], small_n * UP[0]), rtol=2e-3
    )


@pytest.mark.parametrize("field", [0, 1])
def test_no_number_is_refused(field: int) -> None:
    """NaN in the closures or the gaps is a ValueError, not an endless search."""
    inputs = [np.full(3, 30.0), np.full(3, 20.0)]
    inputs[field][1] = np.nan
    with pytest.raises(ValueError, match="finite"):
        solve_contact_lcp(inputs[0], inputs[1], np.eye(3))


@pytest.mark.parametrize(
    "compliance", [-np.eye(3), np.array([[1.0, -3, 0], [-3, 1, 0], [0, 0, 1]]), np.zeros((3, 3))]
)
def test_a_compliance_that_is_none_is_an_error(compliance: Vector) -> None:
    """Negative, indefinite or zero: an ArithmeticError that says so."""
    with pytest.raises(ArithmeticError, match="positive definite"):
        solve_contact_lcp(np.full(3, 30.0), np.full(3, 20.0), compliance)
