"""The foot against statics, energy, reciprocity and symmetry, which hold on any mesh, and against harder materials."""

import dataclasses
from typing import Any

import ngsolve as ng
import numpy as np
import pytest
from msgspec.structs import replace
from numpy.typing import NDArray

from footsense.foot.directions import directions
from footsense.foot.gap_contact import CELLS_PER_ELEMENT
from footsense.foot.response_table import FootResponse
from footsense.lab.fem.adjoint import AdjointFields
from footsense.lab.fem.centred import solve_centred_closures
from footsense.lab.fem.elasticity import membrane_energy_per_area
from footsense.lab.fem.mesh import MeshSize, cavity_cells
from footsense.lab.fem.quarter import Parity, QuarterFoot
from footsense.lab.geometry import UM_PER_MM, Material, ThinFilm
from footsense.lab.response import mean_over_patch
from footsense.lab.symmetry import SYMMETRIES, element_permutation
from tests.lab.released import FOOT_DESIGN

pytestmark = [pytest.mark.lab, pytest.mark.slow]

Quarters = dict[Parity, QuarterFoot]

#: Quadratic elements without layers at the edges: a tenth of a second per class, for what holds on any mesh.
PLAIN = MeshSize(edge_layers=0, order=2, bar_mm=1.0)
UP = np.array([0.0, 0.0, 1.0])


def hertz_load(
    quarter: QuarterFoot, normal: NDArray[np.float64], radius_mm: float, force_n: NDArray[np.float64]
) -> ng.CF:
    """Return the traction [MPa] of a Hertz patch, whose part in the quarter carries the force."""
    centre = -quarter.design.ball_radius_mm * normal - [0.0, 0.0, quarter.design.plate_mm]
    away = ng.CF((ng.x - centre[0], ng.y - centre[1], ng.z - centre[2]))
    inside = 1.0 - away * away / radius_mm**2
    pressure = ng.IfPos(inside, ng.sqrt(ng.IfPos(inside, inside, 0.0)), 0.0)
    total = ng.Integrate(pressure * ng.ds("curved_ground", bonus_intorder=30), quarter.mesh)
    return ng.CF(tuple(force_n)) * pressure / total


def element_closures(quarter: QuarterFoot, moved: Any) -> NDArray[np.float64]:
    """Return the mean closure [um] over what lies in the quarter of each element, shape (9,), NaN elsewhere."""
    ground, leg, *_ = moved.components
    found: NDArray[np.float64] = np.full(9, np.nan)
    for element in {cell.element for cell in cavity_cells(quarter.design)}:
        names = "|".join(cell.name for cell in cavity_cells(quarter.design) if cell.element == element)
        area = ng.Integrate(ng.CF(1.0) * ng.ds(names), quarter.mesh)
        found[element] = UM_PER_MM * ng.Integrate((ground[2] - leg[2]) * ng.ds(names), quarter.mesh) / area
    return found


def test_the_quarter_has_the_areas_of_the_drawing(mesh: Any, fields: dict[Parity, AdjointFields]) -> None:
    """A quarter of nine cavities of 16 mm2, of 52 mm2 of bars and of a hemisphere."""
    area = {name: ng.Integrate(ng.CF(1.0) * ng.ds(name), mesh) for name in ("cell.*", "bars")}
    assert area["cell.*"] == pytest.approx(36.0, rel=1e-9)
    assert area["bars"] == pytest.approx(13.0, rel=1e-9)
    assert fields[Parity(1, 1)].weight_mm2.sum() == pytest.approx(50.0 * np.pi, rel=1e-3)


@pytest.mark.parametrize(
    ("parity", "rigid"),
    [
        (Parity(1, 1), lambda: ng.CF((0, 0, 1))),
        (Parity(1, -1), lambda: ng.CF((0, 1, 0))),
        (Parity(1, -1), lambda: ng.CF((0, -ng.z, ng.y))),
        (Parity(-1, -1), lambda: ng.CF((-ng.y, ng.x, 0))),
    ],
    ids=["lift", "push", "tilt", "twist"],
)
def test_the_bars_carry_force_and_moment(quarters: Quarters, parity: Parity, rigid: Any) -> None:
    """The work of bars and load on each rigid motion of a class is the same: forces and moments balance."""
    quarter = quarters[parity]
    traction = ng.CF((0.3 + ng.x, ng.y * ng.z, 1.0 - 0.1 * ng.x * ng.y))
    ground, leg, *_ = quarter.solve(quarter.traction_load(traction)).components
    carried = quarter.layer.traction(ground - leg) * rigid() * ng.ds("bars", bonus_intorder=4)
    applied = traction * rigid() * ng.ds("curved_ground", bonus_intorder=12)
    work = [ng.Integrate(part, quarter.mesh) for part in (carried, applied)]
    assert work[0] == pytest.approx(work[1], rel=1e-8)


def test_the_work_of_the_load_is_twice_the_energy(quarters: Quarters) -> None:
    """Clapeyron: b u = 2 (rubber + PDMS + bars), to 1e-3: the form is integrated less exactly on curved elements."""
    quarter = quarters[Parity(1, 1)]
    load = quarter.traction_load(ng.CF((0.1 * ng.x, 0.0, 1.0)))
    moved = quarter.solve(load)
    rubber, pdms, twice = quarter.design.rubber, quarter.design.pdms, 0.0
    ground, leg, p_ground, p_leg = moved.components
    for side, u, p in (("ground", ground, p_ground), ("leg", leg, p_leg)):
        strain = 0.5 * (ng.Grad(u) + ng.Grad(u).trans)
        shear = 2.0 * ng.InnerProduct(strain, strain)
        in_rubber = rubber.shear_modulus_mpa * shear + p**2 / rubber.lame_lambda_mpa
        in_pdms = pdms.shear_modulus_mpa * shear + pdms.lame_lambda_mpa * ng.Trace(strain) ** 2
        twice += ng.Integrate(in_rubber * ng.dx(f"rubber_{side}", bonus_intorder=4), quarter.mesh)
        twice += ng.Integrate(in_pdms * ng.dx(f"pdms_{side}", bonus_intorder=4), quarter.mesh)
    jump = ground - leg
    twice += ng.Integrate(quarter.layer.traction(jump) * jump * ng.ds("bars", bonus_intorder=4), quarter.mesh)
    assert ng.InnerProduct(load.vec, moved.vec) == pytest.approx(twice, rel=1e-3)


@pytest.mark.parametrize("parity", [Parity(1, 1), Parity(1, -1), Parity(-1, -1)])
def test_load_and_closure_change_places(quarters: Quarters, parity: Parity) -> None:
    """Betti: the work of a load on an adjoint field is the closure under that load, to the solver's rounding."""
    quarter = quarters[parity]
    load = quarter.traction_load(ng.CF((0.3, -0.2 * ng.x, 0.9)))
    closing = quarter.closure_functional("cell7", 1.0)
    moved, adjoint = quarter.solve(load), quarter.solve(closing)
    assert ng.InnerProduct(load.vec, adjoint.vec) == pytest.approx(
        ng.InnerProduct(closing.vec, moved.vec), rel=1e-9
    )
    assert quarter.residual_rel(load, moved) < 1e-9


def test_a_forward_solve_near_the_rim_finds_the_table(quarters: Quarters, response: FootResponse) -> None:
    """A contact at 40 deg elevation, over the diagonal, one solve per class: every element within 1 % of the largest.

    The patch lies in the quarter, so each class carries a quarter of the load; (-1, 1) is (1, -1) with x and y
    exchanged, which on the diagonal is the same load.
    """
    force = directions(np.array(225.0), np.array(40.0))
    radius_mm = float(response.patch_radius_mm(force, force))
    total = np.zeros((3, 3))
    for parity, quarter in quarters.items():
        traction = hertz_load(quarter, force, radius_mm, force / 4.0)
        part = element_closures(quarter, quarter.solve(quarter.traction_load(traction, extra_order=30)))
        grid = part.reshape(3, 3)[:2, :2]
        for p, g in {(parity.x, parity.y): grid, (parity.y, parity.x): grid.T}.items():
            own = np.where(np.outer([1, p[0] > 0], [1, p[1] > 0]), g, 0.0)
            half = np.vstack([own, p[0] * own[:1]])
            total += np.hstack([half, p[1] * half[:, :1]])
    tabled = response.free_element_closures_um(force, force)
    assert np.abs(tabled - total.ravel()).max() < 0.01 * np.abs(tabled).max()


@pytest.mark.parametrize("axis", [0, 1])
def test_a_contact_behind_presses_the_rear_row(response: FootResponse, axis: int) -> None:
    """An upright force on a contact at -x (normal tilted to +x) presses row 2; at -y it presses column 2."""
    normal = np.array([0.0, 0.0, np.cos(0.15)])
    normal[axis] = np.sin(0.15)
    grid = response.free_element_closures_um(normal, UP).reshape(3, 3)
    rows = grid if axis == 0 else grid.T
    assert rows[2].min() > 2.0 * rows[0].max()


@pytest.mark.parametrize("number", range(8))
def test_the_table_has_the_square_s_symmetries(response: FootResponse, number: int) -> None:
    """The closures of a mapped load are the mapped closures, for a leaning contact without symmetry of its own."""
    symmetry = SYMMETRIES[number]
    normal, force = directions(np.array(17.0), np.array(62.0)), np.array([0.3, -0.2, 0.9])
    closure_um = response.free_element_closures_um(normal, force)
    mapped_um = response.free_element_closures_um(symmetry @ normal, symmetry @ force)
    np.testing.assert_allclose(mapped_um[element_permutation(symmetry)], closure_um, rtol=0.0, atol=1e-6)


def test_the_compliance_is_symmetric_and_positive(response: FootResponse) -> None:
    """What the contact of the gaps rests on, with the square's symmetry."""
    compliance = response.compliance_um_per_n
    np.testing.assert_allclose(compliance, compliance.T, rtol=0.0, atol=1e-5 * np.abs(compliance).max())
    assert np.linalg.eigvalsh(compliance).min() > 1e-3 * np.diag(compliance).min()
    middle = (
        compliance[4 * CELLS_PER_ELEMENT : 5 * CELLS_PER_ELEMENT]
        .reshape(CELLS_PER_ELEMENT, 9, CELLS_PER_ELEMENT)
        .mean(axis=(0, 2))
    )
    np.testing.assert_allclose(middle[[1, 3, 5, 7]], middle[1], rtol=1e-5)
    np.testing.assert_allclose(middle[[0, 2, 6, 8]], middle[0], rtol=1e-5)


def test_the_table_knows_its_own_errors(response: FootResponse) -> None:
    """Even on the coarse mesh: 1 % between the foot and its transpose, 1 % between samples and series."""
    assert response.provenance["mesh_asymmetry_rel"] < 0.01
    assert response.provenance["fit_residual_rel"] < 0.01
    assert response.provenance["interpolation_rel"] < 0.01


def test_one_patch_gives_all_patches(response: FootResponse) -> None:
    """G0 + a^2 G2, with G2 from a patch of 1 mm, against quadrature at the 1.3 mm of 2 N: within 2e-4."""
    normal = directions(np.array([20.0]), np.array([60.0]))
    force = 2.0 * normal[0]
    radius_mm = float(response.patch_radius_mm(normal[0], force))
    flat = response.closure_coefficients[0].reshape(len(response.closure_coefficients[0]), -1)
    whole = force @ mean_over_patch(flat, normal, radius_mm, FOOT_DESIGN)[0].reshape(3, -1)
    tabled = response.free_closure_um(normal[0], force)
    np.testing.assert_allclose(tabled, whole, rtol=0.0, atol=2e-4 * np.abs(whole).max())


def test_rubber_near_incompressible_does_not_lock() -> None:
    """What a mesh loses does not depend on nu: quadratic against cubic elements at 0.45 and at 0.4999."""
    lost = []
    for poisson in (0.45, 0.4999):
        foot_design = replace(FOOT_DESIGN, rubber=replace(FOOT_DESIGN.rubber, poisson=poisson))
        low, high = (
            solve_centred_closures(foot_design, dataclasses.replace(PLAIN, order=order), (90.0,))[0].sum()
            for order in (2, 3)
        )
        lost.append(1.0 - low / high)
    assert 0.0 < min(lost) < max(lost) < 0.15
    assert max(lost) - min(lost) < 0.02


@pytest.mark.parametrize("softer", [150.0, 1.0 / 150.0], ids=["soft", "stiff"])
def test_a_sheet_of_another_stiffness_is_solved_as_exactly(softer: float) -> None:
    """PDMS 1/150 and 150 times as stiff as it is, around 37 um in 20 mm: rounding stays at 1e-8."""
    sheet = Material(FOOT_DESIGN.pdms.youngs_mpa / softer, FOOT_DESIGN.pdms.poisson)
    quarter = QuarterFoot(replace(FOOT_DESIGN, pdms=sheet), PLAIN, Parity(1, 1))
    load = quarter.traction_load(ng.CF((0.0, 0.0, 1.0 / 50.0 / np.pi)))
    moved = quarter.solve(load)
    assert quarter.residual_rel(load, moved) < 1e-8
    usual = QuarterFoot(FOOT_DESIGN, PLAIN, Parity(1, 1), quarter.mesh)
    closures = [
        element_closures(q, q.solve(q.traction_load(ng.CF((0, 0, 0.0064)))))[0] for q in (quarter, usual)
    ]
    assert (closures[0] > closures[1]) == (softer > 1.0)


GOLD = ThinFilm(thickness_um=0.1, youngs_mpa=79e3, poisson=0.42)


def test_gold_stores_the_energy_of_plane_stress_and_takes_little_off_the_closures() -> None:
    """Constant strain by hand: E t / (2 (1 - nu^2)) (a^2 + b^2 + 2 nu a b + 2 (1 - nu) c^2) on the cells' 36 mm2.

    The plates lie on rubber and bend little on the whole: gold, five times as stiff as a plate, takes some per cent.
    """
    plain = QuarterFoot(FOOT_DESIGN, PLAIN, Parity(1, 1))
    gilded = QuarterFoot(replace(FOOT_DESIGN, gold=GOLD), PLAIN, Parity(1, 1), plain.mesh)
    moved = ng.GridFunction(plain.space).components[0]
    a, b, c = 0.010, -0.004, 0.003
    moved.Set(ng.CF((a * ng.x + c * ng.y, c * ng.x + b * ng.y, 0.5 * ng.x)))
    stored = ng.Integrate(membrane_energy_per_area(GOLD, moved) * ng.ds("cell.*"), plain.mesh)
    by_hand = 0.5 * 7.9 / (1.0 - 0.42**2) * (a * a + b * b + 2 * 0.42 * a * b + 2 * (1 - 0.42) * c * c)
    assert stored == pytest.approx(36.0 * by_hand, rel=1e-6)
    without_um, with_um = (
        np.nanmean(element_closures(quarter, quarter.solve(quarter.traction_load(ng.CF((0.0, 0.0, 1e-3))))))
        for quarter in (plain, gilded)
    )
    assert 0.97 * without_um < with_um < without_um
