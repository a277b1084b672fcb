"""The solid against what statics and elasticity know without it."""

from dataclasses import replace

import ngsolve as ng
import numpy as np
import pytest
from numpy.typing import NDArray

from footsense.lab.adjoint import SurfaceField
from footsense.lab.geometry import Material, SoleDesign
from footsense.lab.response import fit_series, make_response, patch_mean, symmetrise
from footsense.lab.solid import COARSE, Solid
from footsense.sim.foot import FootResponse

pytestmark = pytest.mark.lab

#: An inclined contact that leans away from the force: normal and force [N], no symmetry left.
NORMAL = np.array([np.sin(0.4) * np.cos(0.3), np.sin(0.4) * np.sin(0.3), np.cos(0.4)])
FORCE = np.array([0.3, -0.2, 0.9])


def hertz_load(
    solid: Solid, normal: NDArray[np.float64], force: NDArray[np.float64], radius_mm: float
) -> ng.CF:
    """Return the traction [MPa] of a Hertz patch on the ground-side surface."""
    centre = -solid.sole.ball_radius_mm * normal + [0.0, 0.0, -solid.sole.plate_mm]
    away = ng.CF((ng.x - centre[0], ng.y - centre[1], ng.z - centre[2]))
    inside = 1.0 - away * away / radius_mm**2
    pressure = ng.IfPos(inside, ng.sqrt(ng.IfPos(inside, inside, 0.0)), 0.0)
    total = ng.Integrate(pressure * ng.ds("curved_ground", bonus_intorder=20), solid.mesh)
    return ng.CF(tuple(force)) * pressure / total


def forward(solid: Solid, radius_mm: float) -> tuple[ng.GridFunction, NDArray[np.float64]]:
    """Return the displacement and the nine closures [um] of one forward solve."""
    moved = solid.solve(solid.traction_load(hertz_load(solid, NORMAL, FORCE, radius_mm)))
    ground, leg = moved.components
    area = solid.sole.electrode_mm**2
    closures = [
        1000.0 * ng.Integrate((ground[2] - leg[2]) / area * ng.ds(f"cavity{e}"), solid.mesh) for e in range(9)
    ]
    return moved, np.array(closures)


def total(solid: Solid, density: ng.CF, face: str) -> NDArray[np.float64]:
    """Return the integral of a vector over a face."""
    parts = [density[k] * ng.ds(face, bonus_intorder=20) for k in range(3)]
    return np.array([ng.Integrate(part, solid.mesh) for part in parts])


def test_the_mesh_has_the_areas_of_the_drawing(solid: Solid, field: SurfaceField) -> None:
    """Nine cavities of 16 mm2, 52 mm2 of bars, a hemisphere of 2 pi R^2."""
    areas = [ng.Integrate(ng.CF(1.0) * ng.ds(f"cavity{e}"), solid.mesh) for e in range(9)]
    np.testing.assert_allclose(areas, 16.0, rtol=1e-9)
    assert ng.Integrate(ng.CF(1.0) * ng.ds("bars"), solid.mesh) == pytest.approx(52.0, rel=1e-9)
    assert field.weight_mm2.sum() == pytest.approx(200.0 * np.pi, rel=1e-3)


def test_the_bars_carry_force_and_moment(solid: Solid) -> None:
    """Equilibrium of the ground-side body: bar tractions balance the load and its moment about the origin."""
    moved, _ = forward(solid, 1.0)
    ground, leg = moved.components
    traction = solid.bar_traction(ground - leg)
    place = ng.CF((ng.x, ng.y, ng.z))
    load = hertz_load(solid, NORMAL, FORCE, 1.0)
    np.testing.assert_allclose(total(solid, traction, "bars"), FORCE, rtol=1e-6)
    np.testing.assert_allclose(
        total(solid, ng.Cross(place, traction), "bars"),
        total(solid, ng.Cross(place, load), "curved_ground"),
        atol=1e-6,
    )


def test_forward_and_adjoint_agree(solid: Solid, response: FootResponse) -> None:
    """Reciprocity: one forward solve under the patch against the table, every element within 1 %."""
    radius_mm = float(response.patch_radius_mm(NORMAL, FORCE))
    _, solved = forward(solid, radius_mm)
    tabled = response.closure_um(NORMAL, FORCE)
    assert np.abs(tabled - solved).max() < 0.01 * np.abs(solved).max()


def test_turning_a_free_body_costs_nothing(solid: Solid) -> None:
    """A rigid motion of the ground side against nothing has no strain energy: the weak form is objective."""
    ground, _ = solid.space.components
    rigid = ng.GridFunction(ground)
    with ng.TaskManager():
        rigid.Set(ng.CF((1.0 - 0.3 * ng.y, 0.3 * ng.x + 0.2 * ng.z, -0.2 * ng.y)))
    strain = 0.5 * (ng.Grad(rigid) + ng.Grad(rigid).trans)
    energy = ng.Integrate(ng.InnerProduct(strain, strain) * ng.dx("rubber_ground|pdms_ground"), solid.mesh)
    assert energy < 1e-18


def test_closures_are_those_of_the_drawing(response: FootResponse) -> None:
    """Each element closes 2 to 10 um under a centred newton, corners most; the square's symmetry holds to 0.1 nm."""
    up = np.array([0.0, 0.0, 1.0])
    grid = response.closure_um(up, up).reshape(3, 3)
    assert 2.0 < grid.min() < grid.max() < 10.0
    assert grid[0, 0] > grid[0, 1] > grid[1, 1]
    for copy in (grid.T, grid[::-1], grid[:, ::-1]):
        np.testing.assert_allclose(copy, grid, atol=1e-4)


@pytest.mark.parametrize("axis", [0, 1])
def test_a_contact_behind_presses_the_rear_row(response: FootResponse, axis: int) -> None:
    """An upright force on a contact at -x (normal tilted to +x) presses row 2; at -y it presses column 2."""
    normal = np.array([0.0, 0.0, np.cos(0.15)])
    normal[axis] = np.sin(0.15)
    grid = response.closure_um(normal, np.array([0.0, 0.0, 1.0])).reshape(3, 3)
    rows = grid if axis == 0 else grid.T
    assert rows[2].min() > 2.0 * rows[0].max()


def test_the_mesh_nearly_keeps_the_symmetry(response: FootResponse) -> None:
    """Symmetrising hides no more than half a percent, and the series' cut-off is far below that."""
    assert response.provenance["mesh_asymmetry_rel"] < 0.005
    assert response.provenance["interpolation_rel"] < 0.001


def test_symmetrising_twice_changes_nothing(field: SurfaceField) -> None:
    """The average over a group is a projection."""
    once = symmetrise(fit_series(field))
    np.testing.assert_allclose(symmetrise(once), once, atol=1e-9 * np.abs(once).max())


def test_one_patch_gives_all_patches(solid: Solid, response: FootResponse) -> None:
    """G0 + a^2 G2, with G2 from a patch of 1 mm, against quadrature at the 1.3 mm of 2 N: within 1e-4."""
    normal = NORMAL[None]
    whole = patch_mean(response.coefficients[0], normal, 1.3, solid.sole)[0] @ FORCE
    scaled = FORCE * (1.3**3 * response.hertz_modulus_mpa / 7.5) / (NORMAL @ FORCE)
    tabled = response.closure_um(NORMAL, scaled) * np.linalg.norm(FORCE) / np.linalg.norm(scaled)
    np.testing.assert_allclose(tabled, whole, atol=1e-4 * np.abs(whole).max())


def test_rubber_near_incompressible_does_not_lock() -> None:
    """From nu = 0.45 to 0.499 the sum of closures changes by what elasticity says, not by what locking does.

    A locked mesh of quadratic tetrahedra would show as a sudden stiffening between 0.49 and 0.499.
    """
    sums = []
    for poisson in (0.45, 0.49, 0.499):
        sole = replace(SoleDesign(), rubber=Material(5.2, poisson))
        solid = Solid(sole, COARSE)
        moved, closures = forward(solid, 1.0)
        del moved
        sums.append(closures.sum())
    assert abs(sums[1] / sums[0] - 1.0) < 0.10
    assert abs(sums[2] / sums[1] - 1.0) < 0.05


def test_refining_changes_closures_as_stated(solid: Solid) -> None:
    """Closures grow towards the finer mesh: the shipped table's docstring says from below, first order."""
    finer = Solid(SoleDesign(), replace(COARSE, bar_mm=0.5))
    coarse_um, finer_um = forward(solid, 1.0)[1], forward(finer, 1.0)[1]
    growth = finer_um.sum() / coarse_um.sum() - 1.0
    assert 0.0 < growth < 0.15


def test_a_sheet_that_does_not_fit_is_refused() -> None:
    """Geometry that cannot be meshed says so before the mesher does."""
    with pytest.raises(ValueError, match="does not fit"):
        SoleDesign(sheet_mm=13.0)
    with pytest.raises(ValueError, match="overhangs"):
        SoleDesign(sheet_mm=15.0)


def test_table_is_made_of_finite_numbers(solid: Solid, field: SurfaceField) -> None:
    """Making the table twice from one field gives equal coefficients."""
    first, second = make_response(solid, field), make_response(solid, field)
    assert (first.coefficients == second.coefficients).all()
