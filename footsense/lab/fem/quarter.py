"""Finite element problem of a quarter foot, one per symmetry class of two mirror planes.

Find u in each body, u = 0 where the leg holds the leg-side hemisphere, so that for all v

    variation of the bodies' energies (`elasticity`: Hooke, mixed in the nearly incompressible rubber)
        + int over the bars of (G [u_t].[v_t] + M [u_n][v_n]) / t_spacer  =  the load

[u] = u_ground - u_leg. The spacer is a layer of 37 um that is 27 times wider than thick: it cannot spread sideways, so
its normal stiffness takes the confined modulus M = lambda + 2 G. A bar that may bulge changes a cavity's closure by
0.06 % (a solve in plane strain of commit 50099742). The 500 um plates bend into the cavities, which is
most of the closure, and are meshed as solids. The 37 um themselves are left out of the coordinates.

Any load is the sum of four parts that are even or odd under x -> -x and under y -> -y. Each part is a problem on the
quarter with other conditions on the mirror planes: an even field keeps the plane in place across it, an odd one along
it. Odd under x and even under y is the transpose of even under x and odd under y, so three factorisations do. A load on
one cell is a quarter of the sum of the loads that put the cell and its mirror images together with the signs of each
class, and so is the response to it.

Source:
    DESIGN section 6; materials as in `geometry`.
"""

from dataclasses import dataclass
from typing import Any

import ngsolve as ng
import numpy as np

from footsense.errors import ModelError
from footsense.foot.response_table import product_powers
from footsense.frames import Vector
from footsense.lab.fem.elasticity import (
    BondedLayer,
    membrane_energy_per_area,
    mixed_strain_energy_density,
    strain_energy_density,
)
from footsense.lab.fem.mesh import MeshSize, build_mesh
from footsense.lab.geometry import FootDesign

#: Residual of a solve above which the stiffness counts as singular [1]; sound ones leave 1e-12 to 1e-9.
_MAX_RESIDUAL_REL = 1e-5


@dataclass(frozen=True, slots=True)
class Parity:
    """Parity (even or odd) of a displacement field under the mirrors x -> -x and y -> -y.

    Attributes:
        x: +1 if the field is its own mirror image under x -> -x, -1 if it is the opposite, 0 if it is neither: the
            foot is solved as a whole.
        y: The same under y -> -y.
    """

    x: int
    y: int

    def fixed_mirror_faces(self, component: int) -> str:
        """Return the mirror planes on which displacement component 0..2 vanishes, joined by `|`."""
        planes = enumerate((("mirror_x", self.x), ("mirror_y", self.y)))
        fixed = (plane for axis, (plane, parity) in planes if parity and (component == axis) == (parity > 0))
        return "|".join(fixed)

    def mirror_image_signs(self, component: int) -> tuple[int, int]:
        """Return the sign of a displacement component in its images under x -> -x and under y -> -y."""
        return (-self.x if component == 0 else self.x), (-self.y if component == 1 else self.y)

    def unfold_z_component(self, quarter: Vector, axis: int = 0) -> Vector:
        """Return z components on the whole foot from the quarter (x runs along `axis`, y along the next axis)."""
        half = np.concatenate([quarter, self.x * np.flip(quarter, axis)], axis)
        return np.concatenate([half, self.y * np.flip(half, axis + 1)], axis + 1)


#: A foot that is not its own mirror image, solved as a whole.
NO_MIRRORS = Parity(0, 0)
#: The classes that are solved; (-1, 1) is the transpose of (1, -1).
SOLVED_CLASSES = (Parity(1, 1), Parity(1, -1), Parity(-1, -1))


def transposed_series(series: Vector, degree: int) -> Vector:
    """Return a response series with x and y exchanged, shape (products, 9, 9, 3)."""
    i, j = product_powers(degree)
    # The products are in the order of (i, j); by (j, i), T_j T_i comes to stand where T_i T_j stood.
    return series[np.lexsort((i, j))].transpose(0, 2, 1, 3)[..., [1, 0, 2]]


def single_cell_series(classes: dict[Parity, Vector], degree: int) -> Vector:
    """Return the closure series of single cells, superposed from the symmetry classes, shape (products, 9, 9, 3).

    A load on a single cell is a quarter of the sum of the four loads that put it and its mirror images together with
    the signs of each class.
    """
    even_odd = classes[Parity(1, -1)]
    total = sum(classes.values()) + transposed_series(even_odd, degree)
    return total / 4.0


def whole_foot_compliance(classes: dict[Parity, Vector]) -> Vector:
    """Return the compliance from cells of the quarter to all cells, summed over the classes, shape (9, 9, 18, 18).

    Args:
        classes: Closure of one cell of the quarter under a force on another, shapes (9, 9, 9, 9).
    """
    transposed = classes[Parity(1, -1)].transpose(1, 0, 3, 2)
    parts = [*classes.items(), (Parity(-1, 1), transposed)]
    whole: Vector = np.sum([parity.unfold_z_component(part, 2) for parity, part in parts], axis=0) / 4.0
    return whole


class QuarterFoot:
    """Factorised finite element problem of one symmetry class; each further load costs one back-substitution.

    Attributes:
        design: The foot.
        mesh: The mesh of the quarter.
        parity: The class.
        layer: Joins both bodies.
        space: Displacement on the ground side, on the leg side, and the two pressures in the rubber.
    """

    def __init__(
        self,
        design: FootDesign,
        size: MeshSize,
        parity: Parity,
        mesh: Any = None,
        layer: BondedLayer | None = None,
    ) -> None:
        """Assemble and factorise the stiffness matrix.

        Args:
            design: The foot.
            size: Resolution of the mesh.
            parity: The symmetry class.
            mesh: A mesh of `build_mesh` to share between classes; made if None.
            layer: Joins both bodies; the spacer's bars if None.

        Raises:
            ModelError: The foot cannot be meshed, or its stiffness is singular.
        """
        self.design, self.parity = design, parity
        self.mesh = build_mesh(design, size) if mesh is None else mesh
        self.layer = layer or BondedLayer(design.pdms, design.spacer_mm)
        self.space = self._finite_element_space(size.order)
        form = self._bilinear_form()
        with ng.TaskManager():
            form.Assemble()
            try:
                self._inverse = form.mat.Inverse(self.space.FreeDofs(), "sparsecholesky")
            except Exception as error:  # the library raises its own, undocumented types
                raise ModelError(f"the stiffness of the foot is singular ({error})") from error
        self._matrix = form.mat
        # A pivot that is zero but for rounding raises nothing above; what it solves does not fit.
        lifted = self.traction_load(ng.CF((0.0, 0.0, 1.0)), extra_order=0)
        if not self.residual_rel(lifted, self.solve(lifted)) < _MAX_RESIDUAL_REL:  # NaN fails too
            raise ModelError(f"the stiffness of the foot is singular: nothing holds a part of {design}")

    @property
    def ball_centre_mm(self) -> tuple[float, float, float]:
        """Centre of the ground-side ball from the middle of the sheet [mm]."""
        return 0.0, 0.0, -self.design.plate_mm

    def _dirichlet_arguments(self, held: str) -> dict[str, str]:
        """Return per component the faces with zero displacement: clamped ones, and mirror planes by parity."""
        return {
            f"dirichlet{axis}": "|".join(filter(None, (held, self.parity.fixed_mirror_faces(component))))
            for component, axis in enumerate("xyz")
        }

    def _finite_element_space(self, order: int) -> Any:
        ground, leg = (
            ng.VectorH1(
                self.mesh,
                order=order,
                definedon=f"rubber_{side}|pdms_{side}",
                **self._dirichlet_arguments(held),
            )
            for side, held in (("ground", ""), ("leg", "curved_leg"))
        )
        p_ground, p_leg = (
            ng.H1(self.mesh, order=order - 1, definedon=f"rubber_{side}") for side in ("ground", "leg")
        )
        return ground * leg * p_ground * p_leg

    def _bilinear_form(self) -> Any:
        """Return the unassembled bilinear form of the quarter foot."""
        (u_ground, u_leg, p_ground, p_leg), (v_ground, v_leg, *_) = self.space.TnT()
        form = ng.BilinearForm(self.space, symmetric=True)
        for side, u, p in (("ground", u_ground, p_ground), ("leg", u_leg, p_leg)):
            form += ng.Variation(
                mixed_strain_energy_density(self.design.rubber, u, p) * ng.dx(f"rubber_{side}")
            )
            form += ng.Variation(strain_energy_density(self.design.pdms, u) * ng.dx(f"pdms_{side}"))
        films = ((self.design.gold, (u_ground, u_leg)), (self.design.parylene, (u_ground,)))
        for film, covered in films:
            if film is not None:
                for u in covered:
                    form += ng.Variation(membrane_energy_per_area(film, u) * ng.ds("cell.*"))
        form += self.layer.traction(u_ground - u_leg) * (v_ground - v_leg) * ng.ds(self.layer.face_pattern)
        return form

    @property
    def n_unknowns(self) -> int:
        """Number of free displacement and pressure unknowns."""
        return int(sum(self.space.FreeDofs()))

    def closure_functional(self, face: str, area_mm2: float) -> Any:
        """Return the mean closure of a face of given area as a linear functional of the displacement."""
        v_ground, v_leg, *_ = self.space.TestFunction()
        form = ng.LinearForm(self.space)
        form += (v_ground[2] - v_leg[2]) / area_mm2 * ng.ds(face)
        return form.Assemble()

    def traction_load(self, traction_mpa: Any, extra_order: int = 12) -> Any:
        """Return the linear form of a traction [MPa] on the quarter's ground-side surface."""
        v_ground, *_ = self.space.TestFunction()
        form = ng.LinearForm(self.space)
        form += traction_mpa * v_ground * ng.ds("curved_ground", bonus_intorder=extra_order)
        return form.Assemble()

    def solve(self, load: Any) -> Any:
        """Return displacement [mm] and pressure [MPa] under an assembled load as a grid function of `space`."""
        solution = ng.GridFunction(self.space)
        with ng.TaskManager():
            solution.vec.data = self._inverse * load.vec
        return solution

    def residual_rel(self, load: Any, solution: Any) -> float:
        """Return the relative residual [1]: norm of load minus stiffness times solution, over the norm of the load."""
        rest = (load.vec - self._matrix * solution.vec).Evaluate()
        ng.Projector(self.space.FreeDofs(), range=True).Project(rest)
        return float(rest.Norm() / load.vec.Norm())
