"""Direct solution, one solve per load, to check the adjoint table.

A Hertz patch of traction t is the sum of its parts in the four symmetry classes,

    t_c(x) = 1/4 sum over the images g of c(g) g t(g^-1 x),        g in {1, mirror x, mirror y, both},

c(g) being +1 or -1 as the class is even or odd under g. Each part is one solve on the quarter. The class that is not
factorised, odd under x and even under y, is solved as its transpose: x and y of the load and of the answer swapped.

The patch is round on the sphere, p ~ sqrt(1 - |x - x_c|^2 / a^2), and its integral is made exact by scaling.
"""

from typing import NamedTuple

import ngsolve as ng
import numpy as np

from footsense.foot.response_table import FLAT_OF_GRID
from footsense.frames import Vector
from footsense.lab.fem.elasticity import hertz_pressure_shape
from footsense.lab.fem.mesh import MeshSize, build_quarter_mesh, quarter_cells, quarter_grid
from footsense.lab.fem.quarter import SOLVED_CLASSES, Parity, QuarterFoot
from footsense.lab.geometry import UM_PER_MM, FootDesign

#: Order that the quadrature of a patch has above that of the elements, which are three times as large and more: with 24
#: the closures of some loads were wrong by 4 %, with 60 by 0.3 % at most, and it takes no longer.
EXTRA_PATCH_QUADRATURE_ORDER = 60


class _HertzLoad(NamedTuple):
    """A pressure patch on the ground-side ball: centre [mm], resultant force [N], radius [mm]."""

    centre_mm: Vector
    force_n: Vector
    patch_radius_mm: float

    def transformed(self, matrix: Vector) -> "_HertzLoad":
        """Return the load under a mirror or axis swap, given as a matrix of shape (3, 3)."""
        return _HertzLoad(matrix @ self.centre_mm, matrix @ self.force_n, self.patch_radius_mm)


class _QuarterClosureSolver:
    """Solver of one symmetry class that returns the closures of the quarter's cells under a Hertz load.

    Attributes:
        quarter: The class.
    """

    def __init__(self, quarter: QuarterFoot) -> None:
        self.quarter = quarter
        cells, area_mm2 = quarter_cells(quarter.design), quarter.design.cavity_cell_area_mm2
        rows = np.stack([quarter.closure_functional(cell.name, area_mm2).vec.FV().NumPy() for cell in cells])
        self._used = np.flatnonzero(rows.any(axis=0))
        self._rows = rows[:, self._used]

    def class_cell_closures_um(self, load: _HertzLoad) -> Vector:
        """Return the quarter's cell closures [um] under the load's part in this symmetry class, shape (9, 9)."""
        quarter, parity = self.quarter, self.quarter.parity
        parts = []
        for sign_x, sign_y in ((1, 1), (-1, 1), (1, -1), (-1, -1)):
            image = load.transformed(np.diag([sign_x, sign_y, 1.0]))
            character = (1 if sign_x > 0 else parity.x) * (1 if sign_y > 0 else parity.y)
            parts.append(
                (hertz_pressure_shape(image.centre_mm, image.patch_radius_mm), character * image.force_n)
            )
        surface = ng.ds("curved_ground", bonus_intorder=EXTRA_PATCH_QUADRATURE_ORDER)
        # The images in the quarter make up the whole patch, wherever the mirror planes cut it.
        total_mm2 = ng.Integrate(sum(shape for shape, _ in parts) * surface, quarter.mesh)
        traction = [
            sum(shape * float(force[k]) for shape, force in parts) / (4.0 * total_mm2) for k in range(3)
        ]
        solution = quarter.solve(quarter.traction_load(ng.CF(tuple(traction)), EXTRA_PATCH_QUADRATURE_ORDER))
        closure_um = self._rows @ solution.vec.FV().NumPy()[self._used] * UM_PER_MM
        return quarter_grid(closure_um, quarter.design, 0)


class DirectSolveFoot:
    """Finite element model of the foot that is solved once per load, without a response table.

    Args:
        design: The foot.
        size: Resolution of the mesh.

    Raises:
        ModelError: The foot cannot be meshed, or its stiffness is singular.
    """

    def __init__(self, design: FootDesign, size: MeshSize) -> None:
        self._design = design
        mesh = build_quarter_mesh(design, size)
        self._classes = {
            parity: _QuarterClosureSolver(QuarterFoot(design, size, parity, mesh))
            for parity in SOLVED_CLASSES
        }

    def cell_closures_um(self, normal: Vector, force_n: Vector) -> Vector:
        """Return the linear closure of every cell [um], gap contact ignored, shape (324,), by four solves.

        Args:
            normal: Inward unit normal of the ball at the contact, shape (3,).
            force_n: Ground reaction on the foot [N], shape (3,).
        """
        design = self._design
        pressing_n = abs(float(normal @ force_n))
        load = _HertzLoad(
            centre_mm=design.touch_point_mm(normal),
            force_n=force_n,
            patch_radius_mm=design.hertz_patch_radius_mm(pressing_n),
        )
        parts = {parity: solved.class_cell_closures_um(load) for parity, solved in self._classes.items()}
        swapped = load.transformed(np.eye(3)[[1, 0, 2]])
        parts[Parity(-1, 1)] = self._classes[Parity(1, -1)].class_cell_closures_um(swapped).T
        whole = np.sum([parity.unfold_z_component(part) for parity, part in parts.items()], axis=0)
        flat = np.empty(whole.size)
        flat[FLAT_OF_GRID] = whole
        return flat
