"""The elements against elasticity that is known: exact where they can be, of full order where they cannot."""

from typing import Any

import ngsolve as ng
import numpy as np
import pytest
from msgspec.structs import replace

from footsense.errors import ModelError
from footsense.lab.fem.mesh import COARSE_MESH, build_quarter_mesh
from footsense.lab.fem.quarter import Parity, QuarterFoot
from footsense.lab.geometry import FootDesign, Material
from tests.lab.mechanics.analytic_benchmarks import HalfSpace, block_errors
from tests.lab.released import FOOT_DESIGN

pytestmark = pytest.mark.lab


@pytest.mark.parametrize("poisson", [0.3, 0.49, 0.4999])
@pytest.mark.parametrize("order", [2, 3])
def test_constant_strain_is_exact(poisson: float, order: int) -> None:
    """The patch test, with the pressure one order lower: any linear displacement to rounding."""
    x, y, z = ng.x, ng.y, ng.z
    linear = [
        0.01 * x + 0.02 * y - 0.03 * z,
        0.015 * x - 0.02 * y + 0.01 * z,
        0.005 * y + 0.012 * z - 0.02 * x,
    ]
    assert max(block_errors(Material(5.2, poisson), linear, 0.5, order)) < 1e-11


@pytest.mark.parametrize("poisson", [0.3, 0.4999])
def test_errors_fall_with_the_order_of_the_elements(poisson: float) -> None:
    """Halving the edges of quadratic elements divides the error by 2^3, that of the gradient by 2^2.

    A smooth field that keeps the volume, with 0.4 of a power for a mesh that is not halved exactly.
    """
    x, y, z = ng.x, ng.y, ng.z
    smooth = [ng.sin(2 * y) * ng.cos(z), ng.sin(2 * z) * ng.cos(x), ng.sin(2 * x) * ng.cos(y)]
    coarse, fine = (np.array(block_errors(Material(5.2, poisson), smooth, edge, 2)) for edge in (0.5, 0.25))
    assert (np.log2(coarse / fine) > [2.6, 1.6]).all()
    assert fine[0] < 1e-3


@pytest.fixture(scope="module", params=[0.49, 0.4999])
def half_space(request: pytest.FixtureRequest) -> HalfSpace:
    """Return the half-space of rubber under a Hertz pressure."""
    return HalfSpace(Material(5.2, request.param), edge_mm=0.5)


def test_the_dent_is_hertz_s_parabola(half_space: HalfSpace) -> None:
    """(2 a^2 - r^2) within the patch to 0.2 %: what ties force, radius and approach of a contact."""
    radius = np.array([0.05, 0.3, 0.6, 0.9])
    np.testing.assert_allclose(half_space.dent_mm(radius), half_space.hertz_dent_mm(radius), rtol=2e-3)


def test_stress_below_the_patch_is_hertz_s(half_space: HalfSpace) -> None:
    """-p0 / (1 + z^2/a^2) on the axis, to 2 % from a quarter of the radius down to where the space is cut."""
    depth = np.array([0.25, 0.5, 1.0, 2.0, 3.0, 5.0, 8.0])
    np.testing.assert_allclose(
        half_space.stress_zz_mpa(depth), half_space.hertz_stress_zz_mpa(depth), rtol=0.02
    )


def test_far_below_the_patch_is_a_point(half_space: HalfSpace) -> None:
    """Boussinesq's -3 P / (2 pi z^2), of which a patch leaves out a^2/z^2: 4 % at 5 radii, with 1 % of the mesh's."""
    depth = np.array([5.0, 6.0, 8.0])
    rel = half_space.stress_zz_mpa(depth) / half_space.point_stress_zz_mpa(depth) - 1.0
    np.testing.assert_allclose(rel, -1.0 / (1.0 + depth**2), atol=0.015)


@pytest.mark.parametrize(
    "foot_design",
    [
        replace(FOOT_DESIGN, plate_mm=1e-5),
        replace(FOOT_DESIGN, plate_mm=-0.5),
        replace(FOOT_DESIGN, electrode_mm=0.0),
        replace(FOOT_DESIGN, spacer_mm=0.0),
    ],
    ids=["thin", "inside-out", "no-electrode", "no-spacer"],
)
def test_a_foot_that_cannot_be_meshed_says_so(foot_design: FootDesign) -> None:
    """Too thin, inside out or nothing: a ModelError that names the sizes."""
    with pytest.raises(ModelError, match="FootDesign"):
        build_quarter_mesh(foot_design, COARSE_MESH)


@pytest.mark.parametrize(
    "rubber",
    [
        Material(0.0, 0.49),
        Material(-1.0, 0.49),
        Material(5.2, 0.5),
        Material(5.2, 0.0),
        Material(float("nan"), 0.4),
    ],
)
def test_a_material_that_is_none_is_refused(rubber: Material) -> None:
    """No stiffness, a negative one, none at all, or a volume that cannot change: a ModelError before any work."""
    with pytest.raises(ModelError, match="rubber needs"):
        QuarterFoot(replace(FOOT_DESIGN, rubber=rubber), COARSE_MESH, Parity(1, 1))


def test_a_foot_that_nothing_holds_is_singular(mesh: Any) -> None:
    """A spacer without stiffness leaves the lower half afloat: a ModelError, not a displacement of 1e15 mm."""
    with pytest.raises(ModelError, match="singular"):
        QuarterFoot(replace(FOOT_DESIGN, spacer_mm=1e30), COARSE_MESH, Parity(1, 1), mesh)


@pytest.mark.slow
def test_bars_lie_between_the_electrodes() -> None:
    """Bars of 1 mm on the sheet of 14 mm: the rest of a quarter is cells, and no cell is a bar."""
    design = FOOT_DESIGN
    mesh = build_quarter_mesh(design, COARSE_MESH)
    assert design.array_side_mm == pytest.approx(design.sheet_mm)
    bars_mm2 = ng.Integrate(ng.CF(1.0) * ng.ds("bars"), mesh)
    cells_mm2 = ng.Integrate(ng.CF(1.0) * ng.ds("cell.*"), mesh)
    assert cells_mm2 == pytest.approx(9 * design.electrode_mm**2 / 4.0, rel=1e-6)
    assert bars_mm2 + cells_mm2 == pytest.approx(design.sheet_mm**2 / 4.0, rel=1e-6)
    assert sum(end - start for start, end in design.half_axis_bar_spans_mm) == pytest.approx(1.0)
