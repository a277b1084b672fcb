"""A plain block of PDMS between the hemispheres, without cavities: the paper's first model (section III A, Fig. 4).

The quarter x > 0, y > 0 is solved in its symmetry classes, as in `quarter`: displacement in all of it, and in the
rubber a pressure of its own. What an element of a sensor is said to feel is the mean of sigma_z over a column, a
rectangle times the thickness (Fig. 5). With m_c . u that mean over column c,

    sigma_c = m_c . K^-1 b(t) = w_c . b(t),        K w_c = m_c

so the adjoint field w_c(x) is the mean stress per unit point force at x [MPa/N]. The mesh knows nothing of columns:
elements on the border of one are integrated with many points, of which those inside count.

Any horizontal cut through the block carries the whole load, so that the mean over all of the block times its area is
-f_z: the test of all of this.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import ngsolve as ng
import numpy as np
from netgen import occ
from netgen.meshing import NgException

from footsense.errors import ModelError
from footsense.lab.fem.adjoint import ClassField, surface_samples
from footsense.lab.fem.elasticity import energy, mixed_energy
from footsense.lab.fem.mesh import MeshSize
from footsense.lab.fem.quarter import SOLVED, Parity
from footsense.lab.geometry import FootDesign

#: Fineness of the study, the block being what `plate_mm` sizes.
BLOCK_SIZE = MeshSize(ball_mm=4.0, plate_mm=0.7, surface_mm=2.5, grading=0.7, layers=0, order=3)
#: What the test and `--quick` use.
COARSE_BLOCK = MeshSize(ball_mm=5.0, plate_mm=1.4, surface_mm=3.0, grading=0.8, layers=0, order=2)
#: Order by which the quadrature in the block exceeds that of a whole element, for the borders of columns.
_BORDER_ORDER = 8
_NEAR_MM = 1e-3


@dataclass(frozen=True, slots=True)
class Column:
    """A rectangle of the quarter x >= 0, y >= 0, through the thickness of the block.

    Attributes:
        x_mm: Borders of the column along x, the lower first [mm].
        y_mm: Borders of the column along y, the lower first [mm].
    """

    x_mm: tuple[float, float]
    y_mm: tuple[float, float]

    @property
    def area_mm2(self) -> float:
        """Area of the rectangle [mm2]."""
        return (self.x_mm[1] - self.x_mm[0]) * (self.y_mm[1] - self.y_mm[0])

    def inside(self) -> Any:
        """Return 1 inside and 0 outside, as a function of the place."""
        distances = (ng.x - self.x_mm[0], self.x_mm[1] - ng.x, ng.y - self.y_mm[0], self.y_mm[1] - ng.y)
        indicator = ng.CF(1.0)
        for distance in distances:
            indicator = ng.IfPos(distance, indicator, 0.0)
        return indicator


def half_thickness_mm(design: FootDesign) -> float:
    """Return half the thickness of the block, equal to the thickness of the sheet [mm]."""
    return design.plate_mm + design.spacer_mm / 2.0


def _solids(design: FootDesign, size: MeshSize) -> list[Any]:
    """Return the quarters of hemispheres and block, named for the weak form."""
    level, wide, half = (
        half_thickness_mm(design),
        3.0 * design.ball_radius_mm,
        design.sheet_mm / 2.0,
    )
    quarter = occ.Box(occ.Pnt(0, 0, -wide), occ.Pnt(wide, wide, wide))
    solids = []
    for side, up in (("ground", -1.0), ("leg", 1.0)):
        centre = occ.Pnt(0, 0, up * level)
        ball = occ.Sphere(centre, design.ball_radius_mm) * occ.HalfSpace(centre, occ.Vec(0, 0, -up))
        for face in ball.faces:
            face.name = f"curved_{side}" if abs(face.center.z - up * level) > _NEAR_MM else "flat"
        ball *= quarter
        ball.mat(f"rubber_{side}")
        solids.append(ball)
    block = occ.Box(occ.Pnt(0, 0, -level), occ.Pnt(half, half, level))
    block.mat("pdms")
    block.maxh = size.plate_mm
    solids.append(block)
    return solids


def build_block_mesh(design: FootDesign, size: MeshSize = BLOCK_SIZE) -> Any:
    """Return the curved mesh of the quarter, in mm, origin in the middle of the block.

    Args:
        design: The foot; of the sheet only its outside is used.
        size: How fine; bars have no part in it.

    Raises:
        ModelError: The mesher gives up.
    """
    shape = occ.Glue(_solids(design, size))
    for face in shape.faces:
        low, high = face.bounding_box
        for axis in ("x", "y"):
            if max(abs(getattr(low, axis)), abs(getattr(high, axis))) < _NEAR_MM:
                face.name = f"mirror_{axis}"
        if face.name == "curved_ground":
            face.maxh = size.surface_mm
    try:
        mesh = ng.Mesh(occ.OCCGeometry(shape).GenerateMesh(maxh=size.ball_mm, grading=size.grading))
        mesh.Curve(size.order)
    except (NgException, RuntimeError) as error:
        raise ModelError(f"the block cannot be meshed with {size}: {error}") from error
    return mesh


class Block:
    """One symmetry class of the foot with the plain block, factorised.

    Attributes:
        design: The foot.
        mesh: Mesh of the quarter.
        parity: The class.
        space: Displacement, and the pressure in both rubbers.
    """

    def __init__(self, design: FootDesign, size: MeshSize, parity: Parity, mesh: Any) -> None:
        """Assemble and factorise; the stiffness is symmetric and, with the leg's surface held, regular."""
        self.design, self.mesh, self.parity = design, mesh, parity
        clamped = {
            f"dirichlet{axis}": "|".join(filter(None, ("curved_leg", parity.clamped(component))))
            for component, axis in enumerate("xyz")
        }
        sides = [f"rubber_{side}" for side in ("ground", "leg")]
        displacement = ng.VectorH1(mesh, order=size.order, **clamped)
        pressures = [ng.H1(mesh, order=size.order - 1, definedon=side) for side in sides]
        self.space = displacement * pressures[0] * pressures[1]
        u, *pressures_of = self.space.TrialFunction()
        form = ng.BilinearForm(self.space, symmetric=True)
        for side, p in zip(sides, pressures_of, strict=True):
            form += ng.Variation(mixed_energy(design.rubber, u, p) * ng.dx(side))
        form += ng.Variation(energy(design.pdms, u) * ng.dx("pdms"))
        with ng.TaskManager():
            form.Assemble()
            self._inverse = form.mat.Inverse(self.space.FreeDofs(), "sparsecholesky")

    def stress_functional(self, column: Column) -> Any:
        """Return the mean of sigma_z [MPa] over a column as a linear form of the displacement."""
        v, pdms = self.space.TestFunction()[0], self.design.pdms
        stress_mpa = pdms.lame_mpa * ng.div(v) + 2.0 * pdms.shear_mpa * ng.Grad(v)[2, 2]
        volume_mm3 = column.area_mm2 * 2.0 * half_thickness_mm(self.design)
        form = ng.LinearForm(self.space)
        form += column.inside() * stress_mpa / volume_mm3 * ng.dx("pdms", bonus_intorder=_BORDER_ORDER)
        with ng.TaskManager():
            return form.Assemble()

    def field(self, columns: Sequence[Column]) -> ClassField:
        """Return the adjoint fields of columns, sampled on the ground-side surface.

        Returns:
            Influence in MPa/N, and no compliance.
        """
        points, normal, weight_mm2 = surface_samples(self.mesh, half_thickness_mm(self.design))
        influence = []
        solution = ng.GridFunction(self.space)
        with ng.TaskManager():
            for column in columns:
                solution.vec.data = self._inverse * self.stress_functional(column).vec
                influence.append(np.asarray(solution.components[0](points)))
        return ClassField(
            parity=self.parity,
            normal=normal,
            weight_mm2=weight_mm2,
            influence=np.stack(influence, axis=1),
            compliance=np.zeros((0, 0)),
        )


def block_fields(
    design: FootDesign, columns: Sequence[Column], size: MeshSize = BLOCK_SIZE
) -> dict[Parity, ClassField]:
    """Return the sampled fields of columns in the solved symmetry classes."""
    mesh = build_block_mesh(design, size)
    return {parity: Block(design, size, parity, mesh).field(columns) for parity in SOLVED}
