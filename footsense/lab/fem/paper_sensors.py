"""Finite element model of a plain PDMS block between the hemispheres: the paper's first model (section III A, Fig. 4).

The quarter x > 0, y > 0 is solved in its symmetry classes, as in `quarter`: displacement in all of it, and in the
rubber a pressure of its own. An element of a sensor measures the mean of sigma_z over a column, a rectangle times
the thickness (Fig. 5). With m_c . u that mean over column c,

    sigma_c = m_c . K^-1 b(t) = w_c . b(t),        K w_c = m_c

so the adjoint field w_c(x) is the mean stress per unit point force at x [MPa/N]. The mesh knows nothing of columns:
elements on the border of one are integrated with many points, of which those inside count.

Any horizontal cut through the block carries the whole load, so that the mean over all of the block times its area is
-f_z: the test of all of this.

Source:
    Aoyagi et al., sections III B to III E, Figs. 5, 6 and 8: sensors A to H.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import ngsolve as ng
import numpy as np
from netgen import occ

from footsense.foot.force_errors import GRAM_FORCE_N
from footsense.foot.response_table import mirrored_series
from footsense.frames import Vector
from footsense.lab.fem.adjoint import solve_functional_fields
from footsense.lab.fem.elasticity import mixed_strain_energy_density, strain_energy_density
from footsense.lab.fem.mesh import (
    BODY_SIDES,
    MeshSize,
    curved_mesh,
    hemisphere,
    name_mirrors_and_size_ground,
    plate,
)
from footsense.lab.fem.quarter import SOLVED_CLASSES, QuarterFoot, single_cell_series, transposed_series
from footsense.lab.geometry import FootDesign
from footsense.lab.response import SERIES_DEGREE, fit_series, mean_over_patch

#: Mesh of the study; `plate_mm` is that of the block.
BLOCK_MESH = MeshSize(ball_mm=4.0, plate_mm=0.7, surface_mm=2.5, grading=0.7, edge_layers=0)
#: Mesh of the tests and of `--quick`.
COARSE_BLOCK_MESH = MeshSize(plate_mm=1.4, grading=0.8, edge_layers=0, order=2)
#: Order by which the quadrature in the block exceeds that of a whole element, for the borders of columns.
_EXTRA_QUADRATURE_ORDER = 8


#: Borders of a rectangular column of the block along x and along y, the lower first, in the quarter x, y >= 0 [mm].
BlockColumn = tuple[tuple[float, float], tuple[float, float]]


def half_thickness_mm(design: FootDesign) -> float:
    """Return half the block's thickness [mm]; the block is as thick as the sheet."""
    return design.plate_mm + design.spacer_mm / 2.0


def build_block_mesh(design: FootDesign, size: MeshSize) -> Any:
    """Return the curved mesh of the quarter [mm], origin in the middle of the block.

    Args:
        design: The foot; of the sheet only its outside is used.
        size: Largest edges; bars have no part in it.

    Raises:
        ModelError: The mesher fails.
    """
    level = half_thickness_mm(design)
    solids = [hemisphere(design, side, up * level, quarter=True) for side, up in BODY_SIDES]
    block = plate("pdms", (0, 0), design.sheet_mm / 2.0, (-level, level), size.plate_mm)
    shape = occ.Glue([*solids, block])
    name_mirrors_and_size_ground(shape, size)
    return curved_mesh(shape, size)


class QuarterBlock(QuarterFoot):
    """Factorised finite element problem of the foot with the plain block, in one symmetry class.

    Attributes:
        space: Displacement, and the pressure in both rubbers.
    """

    @property
    def ball_centre_mm(self) -> tuple[float, float, float]:
        """Centre of the ground-side ball: half the block's thickness below its middle [mm]."""
        return 0.0, 0.0, -half_thickness_mm(self.design)

    def _finite_element_space(self, order: int) -> Any:
        displacement = ng.VectorH1(self.mesh, order=order, **self._dirichlet_arguments("curved_leg"))
        p_ground, p_leg = (
            ng.H1(self.mesh, order=order - 1, definedon=f"rubber_{side}") for side, _ in BODY_SIDES
        )
        return displacement * p_ground * p_leg

    def _bilinear_form(self) -> Any:
        u, *pressures = self.space.TrialFunction()
        form = ng.BilinearForm(self.space, symmetric=True)
        for (side, _), p in zip(BODY_SIDES, pressures, strict=True):
            form += ng.Variation(
                mixed_strain_energy_density(self.design.rubber, u, p) * ng.dx(f"rubber_{side}")
            )
        form += ng.Variation(strain_energy_density(self.design.pdms, u) * ng.dx("pdms"))
        return form

    def stress_functional(self, column: BlockColumn) -> Any:
        """Return the mean normal stress sigma_z [MPa] over a column as a linear functional of the displacement."""
        v, pdms = self.space.TestFunction()[0], self.design.pdms
        stress_mpa = pdms.lame_lambda_mpa * ng.div(v) + 2.0 * pdms.shear_modulus_mpa * ng.Grad(v)[2, 2]
        volume_mm3 = math.prod(high_mm - low_mm for low_mm, high_mm in column)
        volume_mm3 *= 2.0 * half_thickness_mm(self.design)
        inside = ng.CF(1.0)
        for place, (low_mm, high_mm) in zip((ng.x, ng.y), column, strict=True):
            inside = ng.IfPos(place - low_mm, ng.IfPos(high_mm - place, inside, 0.0), 0.0)
        form = ng.LinearForm(self.space)
        form += inside * stress_mpa / volume_mm3 * ng.dx("pdms", bonus_intorder=_EXTRA_QUADRATURE_ORDER)
        with ng.TaskManager():
            return form.Assemble()


#: Force of the contacts [gf]: patterns are divided by their maximum, so that it sets the size of the patch alone.
CONTACT_PATCH_FORCE_GF = 100.0


@dataclass(frozen=True, slots=True)
class SensorArray:
    """Sensor array on the block, as in the paper's Fig. 6: number, side and pitch of the elements.

    Attributes:
        name: The paper's letter.
        elements_per_side: Elements along a side.
        element_side_mm: Side of an element [mm].
        pitch_mm: Distance of neighbouring elements [mm].
    """

    name: str
    elements_per_side: int
    element_side_mm: float
    pitch_mm: float

    def half_axis_element_borders_mm(self) -> list[tuple[float, float]]:
        """Return inner and outer border of each element on the positive half axis [mm], outermost first, at least 0."""
        centres = [
            self.pitch_mm * ((self.elements_per_side - 1) / 2.0 - k)
            for k in range((self.elements_per_side + 1) // 2)
        ]
        return [(max(0.0, c - self.element_side_mm / 2.0), c + self.element_side_mm / 2.0) for c in centres]

    def quarter_element_columns(self) -> list[BlockColumn]:
        """Return the block columns under the quarter's elements, grouped by x."""
        halves = self.half_axis_element_borders_mm()
        return [(x, y) for x in halves for y in halves]


#: A to C have their elements at the centres of F to H, which have the largest that leave bars of 1 mm between them, as
#: G has; D and E reach to the edge of the block.
PAPER_SENSOR_ARRAYS = (
    SensorArray("A", 2, 1.0, 7.5),
    SensorArray("B", 3, 1.0, 5.0),
    SensorArray("C", 5, 1.0, 3.0),
    SensorArray("D", 7, 1.0, 13.0 / 6.0),
    SensorArray("E", 9, 1.0, 13.0 / 8.0),
    SensorArray("F", 2, 6.5, 7.5),
    SensorArray("G", 3, 4.0, 5.0),
    SensorArray("H", 5, 2.0, 3.0),
)


def _series_of_all_elements(quarter: Vector, elements_per_side: int) -> Vector:
    """Return the response series of all elements, (products, n, n, 3), mirrored from the quarter's.

    The two or four parts of an element that a mirror plane cuts are as large, so that it feels their mean.
    """
    half = np.concatenate([quarter, mirrored_series(quarter, SERIES_DEGREE, 0)[:, ::-1]], axis=1)
    parts = np.concatenate([half, mirrored_series(half, SERIES_DEGREE, 1)[:, :, ::-1]], axis=2)
    for axis in (1, 2) if elements_per_side % 2 else ():
        middle = elements_per_side // 2
        mean = parts.take([middle, middle + 1], axis).mean(axis=axis, keepdims=True)
        outer = (parts.take(range(middle), axis), parts.take(range(middle + 2, elements_per_side + 1), axis))
        parts = np.concatenate([outer[0], mean, outer[1]], axis=axis)
    return parts


def stress_series(
    foot_design: FootDesign, sensors: Sequence[SensorArray], size: MeshSize
) -> dict[str, Vector]:
    """Return each sensor's mean element stress as response series [MPa/N], shapes (products, n, n, 3)."""
    mesh = build_block_mesh(foot_design, size)
    columns = [column for sensor in sensors for column in sensor.quarter_element_columns()]
    fitted = {}
    for parity in SOLVED_CLASSES:
        block = QuarterBlock(foot_design, size, parity, mesh)
        functionals = [block.stress_functional(column) for column in columns]
        fitted[parity] = fit_series(solve_functional_fields(block, functionals))
    series, first = {}, 0
    for sensor in sensors:
        m = len(sensor.half_axis_element_borders_mm())
        own = {parity: part[:, first : first + m * m].reshape(-1, m, m, 3) for parity, part in fitted.items()}
        first += m * m
        raw = single_cell_series(own, SERIES_DEGREE)
        series[sensor.name] = _series_of_all_elements(
            (raw + transposed_series(raw, SERIES_DEGREE)) / 2.0, sensor.elements_per_side
        )
    return series


def pressure_patterns(foot_design: FootDesign, series: Vector, direction: Vector) -> Vector:
    """Return the element pressures [MPa], (n, elements), under centred Hertz contacts."""
    force_n = CONTACT_PATCH_FORCE_GF * GRAM_FORCE_N
    patch_mm = foot_design.hertz_patch_radius_mm(force_n)
    unit = mean_over_patch(series.reshape(len(series), -1), direction, patch_mm, foot_design)
    stress_mpa = (unit.reshape(len(direction), -1, 3) * direction[:, None, :]).sum(axis=2)
    pressure_mpa: Vector = -force_n * stress_mpa
    return pressure_mpa
