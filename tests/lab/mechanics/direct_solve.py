"""Direct solution, one solve per load, to check the adjoint table.

A Hertz patch of traction t is the sum of its parts in the four symmetry classes,

    t_c(x) = 1/4 sum over the images g of c(g) g t(g^-1 x),        g in {1, mirror x, mirror y, both},

c(g) being +1 or -1 as the class is even or odd under g. Each part is one solve on the quarter. The class that is not
factorised, odd under x and even under y, is solved as its transpose: x and y of the load and of the answer swapped.

The patch is round on the sphere, p ~ sqrt(1 - |x - x_c|^2 / a^2), and its integral is made exact by scaling.
"""

import itertools
from typing import Any

import ngsolve as ng
import numpy as np

from footsense.foot.response_table import FLAT_OF_GRID
from footsense.frames import Vector
from footsense.lab.fem.mesh import MeshSize, build_mesh, cavity_cells, quarter_grid
from footsense.lab.fem.quarter import SOLVED_CLASSES, Parity, QuarterFoot
from footsense.lab.geometry import UM_PER_MM, FootDesign

#: Order that the quadrature of a patch has above that of the elements, which are three times as large and more: with 24
#: the closures of some loads were wrong by 4 %, with 60 by 0.3 % at most, and it takes no longer.
EXTRA_PATCH_QUADRATURE_ORDER = 60


def hertz_pressure_shape(centre_mm: Vector, radius_mm: float) -> Any:
    """Return the pressure of a Hertz patch over its peak [1], sqrt(1 - |x - x_c|^2 / a^2)."""
    away = ng.CF((ng.x, ng.y, ng.z)) - ng.CF(tuple(centre_mm))
    inside = 1.0 - ng.InnerProduct(away, away) / radius_mm**2
    return ng.sqrt(ng.IfPos(inside, inside, 0.0))


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
        mesh, names = build_mesh(design, size), [cell.name for cell in cavity_cells(design)]
        self._classes = {parity: QuarterFoot(design, size, parity, mesh) for parity in SOLVED_CLASSES}
        self._closure_of_unknowns: dict[Parity, tuple[Any, Vector]] = {}
        for parity, quarter in self._classes.items():
            functionals = [quarter.closure_functional(name, design.cavity_cell_area_mm2) for name in names]
            rows = np.stack([functional.vec.FV().NumPy() for functional in functionals])
            used = np.flatnonzero(rows.any(axis=0))
            self._closure_of_unknowns[parity] = used, rows[:, used]

    def cell_closures_um(self, normal: Vector, force_n: Vector) -> Vector:
        """Return the linear closure of every cell [um], gap contact ignored, shape (324,), by four solves.

        Args:
            normal: Inward unit normal of the ball at the contact, shape (3,).
            force_n: Ground reaction on the foot [N], shape (3,).
        """
        design, swap = self._design, [1, 0, 2]
        centre_mm = -design.ball_radius_mm * normal - np.array([0.0, 0.0, design.plate_mm])
        radius_mm = design.hertz_patch_radius_mm(abs(float(normal @ force_n)))
        whole: Any = 0.0
        for parity in SOLVED_CLASSES:
            whole += parity.unfold_z_component(self._class_closures_um(parity, centre_mm, force_n, radius_mm))
        swapped = self._class_closures_um(Parity(1, -1), centre_mm[swap], force_n[swap], radius_mm)
        whole += Parity(-1, 1).unfold_z_component(swapped.T)
        flat = np.empty(whole.size)
        flat[FLAT_OF_GRID] = whole
        return flat

    def _class_closures_um(
        self, parity: Parity, centre_mm: Vector, force_n: Vector, radius_mm: float
    ) -> Vector:
        """Return the quarter's cell closures [um] under the load's part in a symmetry class, shape (9, 9)."""
        quarter, parts = self._classes[parity], []
        for sign_x, sign_y in itertools.product((1, -1), (1, -1)):
            mirror = np.array([sign_x, sign_y, 1.0])
            character = (1 if sign_x > 0 else parity.x) * (1 if sign_y > 0 else parity.y)
            shape = hertz_pressure_shape(mirror * centre_mm, radius_mm)
            parts.append((shape, character * (mirror * force_n)))
        surface = ng.ds("curved_ground", bonus_intorder=EXTRA_PATCH_QUADRATURE_ORDER)
        # The images in the quarter make up the whole patch, wherever the mirror planes cut it.
        total_mm2 = ng.Integrate(sum(shape for shape, _ in parts) * surface, quarter.mesh)
        traction = [
            sum(shape * float(force[k]) for shape, force in parts) / (4.0 * total_mm2) for k in range(3)
        ]
        solution = quarter.solve(quarter.traction_load(ng.CF(tuple(traction)), EXTRA_PATCH_QUADRATURE_ORDER))
        used, rows = self._closure_of_unknowns[parity]
        return quarter_grid(rows @ solution.vec.FV().NumPy()[used] * UM_PER_MM, quarter.design, 0)
