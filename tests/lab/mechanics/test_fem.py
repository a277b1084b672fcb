"""The elements against elasticity that is known: exact where they can be, of full order where they cannot."""

from typing import Any

import ngsolve as ng
import numpy as np
import pytest
from msgspec.structs import replace

from footsense.errors import ModelError
from footsense.lab.fem.mesh import COARSE_MESH, build_mesh
from footsense.lab.fem.quarter import Parity, QuarterFoot
from footsense.lab.geometry import Material
from tests.lab.mechanics.known_solutions import block_errors, half_space_errors
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


@pytest.mark.slow
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


@pytest.mark.slow
@pytest.mark.parametrize("poisson", [0.49, 0.4999])
def test_a_half_space_under_a_patch_is_hertz_s(poisson: float) -> None:
    """The dent within the patch to 0.2 %, the stress on the axis to 2 %."""
    dent_rel, stress_rel = half_space_errors(Material(5.2, poisson))
    assert dent_rel < 2e-3
    assert stress_rel < 0.02


def test_a_foot_that_nothing_holds_is_singular(mesh: Any) -> None:
    """A spacer without stiffness leaves the lower half afloat: a ModelError, not a displacement of 1e15 mm."""
    with pytest.raises(ModelError, match="singular"):
        QuarterFoot(replace(FOOT_DESIGN, spacer_mm=1e30), COARSE_MESH, Parity(1, 1), mesh)


@pytest.mark.slow
def test_bars_lie_between_the_electrodes() -> None:
    """Bars of 1 mm on the sheet of 14 mm: the rest of a quarter is cells, and no cell is a bar."""
    design = FOOT_DESIGN
    mesh = build_mesh(design, COARSE_MESH)
    assert design.array_side_mm == pytest.approx(design.sheet_mm)
    bars_mm2 = ng.Integrate(ng.CF(1.0) * ng.ds("bars"), mesh)
    cells_mm2 = ng.Integrate(ng.CF(1.0) * ng.ds("cell.*"), mesh)
    assert cells_mm2 == pytest.approx(9 * design.electrode_mm**2 / 4.0, rel=1e-6)
    assert bars_mm2 + cells_mm2 == pytest.approx(design.sheet_mm**2 / 4.0, rel=1e-6)
    start, end = design.bar_span_mm
    assert end - start == pytest.approx(1.0)
