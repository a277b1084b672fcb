"""Analytic benchmarks: problems with known solutions, solved by the weak forms of the foot.

A block with any smooth displacement prescribed on its surface and the body force that belongs to it, and a half-space
under a Hertz pressure, whose stress on the axis and dent are simple formulas.

Source:
    Johnson, Contact Mechanics, 1985: (3.18) and (3.19) for the point load (Boussinesq), (3.41a) for the dent,
    (3.45) for the stress on the axis.
"""

from collections.abc import Sequence
from typing import Any

import ngsolve as ng
import numpy as np
from netgen import occ
from numpy.typing import NDArray

from footsense.lab.fem.elasticity import mixed_strain_energy_density
from footsense.lab.geometry import Material


def _spaces(mesh: Any, order: int, **clamped: str) -> Any:
    """Return displacement and, one order lower, pressure."""
    return ng.VectorH1(mesh, order=order, **clamped) * ng.H1(mesh, order=order - 1)


def _solved(material: Material, space: Any, given: Any, where: str, load: Any) -> Any:
    """Return displacement and pressure under a load, the displacement given on clamped faces, 0 on others."""
    u, p = space.TrialFunction()
    form = ng.BilinearForm(space, symmetric=True)
    form += ng.Variation(mixed_strain_energy_density(material, u, p) * ng.dx)
    form.Assemble()
    solution = ng.GridFunction(space)
    solution.components[0].Set(given, definedon=space.mesh.Boundaries(where))
    rest = (load.vec - form.mat * solution.vec).Evaluate()
    solution.vec.data += form.mat.Inverse(space.FreeDofs(), "sparsecholesky") * rest
    return solution


def _gradient(displacement: Sequence[Any]) -> Any:
    """Return the gradient of a displacement given by formulas, row = component."""
    return ng.CF(tuple(part.Diff(axis) for part in displacement for axis in (ng.x, ng.y, ng.z)), dims=(3, 3))


def block_errors(
    material: Material, displacement: Sequence[Any], edge_mm: float, order: int
) -> tuple[float, float]:
    """Solve a cube of 1 mm for a displacement that is given by formulas.

    Args:
        material: Material of the cube.
        displacement: The three components [mm] as functions of ngsolve's x, y, z [mm].
        edge_mm: Largest edge of the mesh [mm].
        order: Order of the displacement.

    Returns:
        Errors of the displacement and of its gradient, L2 norm over L2 norm [1].
    """
    mesh = ng.Mesh(occ.OCCGeometry(occ.Box((0, 0, 0), (1, 1, 1))).GenerateMesh(maxh=edge_mm))
    exact, gradient = ng.CF(tuple(displacement)), _gradient(displacement)
    strain = 0.5 * (gradient + gradient.trans)
    stress = 2.0 * material.shear_modulus_mpa * strain + material.lame_lambda_mpa * ng.Trace(
        gradient
    ) * ng.Id(3)
    rows = [[stress[i, j] for j in range(3)] for i in range(3)]
    body = ng.CF(
        tuple(-sum(row[j].Diff(axis) for j, axis in enumerate((ng.x, ng.y, ng.z))) for row in rows)
    ).Compile()
    space = _spaces(mesh, order, dirichlet=".*")
    v, _ = space.TestFunction()
    load = ng.LinearForm(body * v * ng.dx(bonus_intorder=4)).Assemble()
    found = _solved(material, space, exact, ".*", load).components[0]

    def norm(field: Any) -> float:
        return float(np.sqrt(ng.Integrate(ng.InnerProduct(field, field) * ng.dx(bonus_intorder=6), mesh)))

    return norm(found - exact) / norm(exact), norm(ng.Grad(found) - gradient) / norm(gradient)


class HalfSpace:
    """A half-space z > 0 under a Hertz pressure of radius 1 mm and 1 N, cut off where a point load is good enough.

    Solved on a quarter of a half ball whose outer surface moves as Boussinesq's solution says.

    Attributes:
        material: Material of the half-space.
        found: The displacement [mm] as a function on `mesh`.
        mesh: The mesh.
    """

    #: Where the half-space is cut off [mm].
    CUT_MM = 12.0
    #: Peak pressure, 3 P / (2 pi a^2) [MPa].
    PEAK_MPA = 1.5 / np.pi

    def __init__(self, material: Material, edge_mm: float = 0.35, order: int = 3) -> None:
        self.material = material
        wide = 3.0 * self.CUT_MM
        ball = occ.Sphere((0, 0, 0), self.CUT_MM) * occ.Box((0, 0, 0), (wide, wide, wide))
        inner = occ.Sphere((0, 0, 0), 1.0) * occ.Box((0, 0, 0), (wide, wide, wide))
        inner.maxh = edge_mm
        shape = occ.Glue([ball - inner, inner])
        for face in shape.faces:
            low, high = face.bounding_box
            flat = [axis for axis in "xyz" if max(abs(getattr(low, axis)), abs(getattr(high, axis))) < 1e-6]
            face.name = flat[0] if flat else ("cut" if max(high.x, high.z) > 2.0 else "inside")
            if flat == ["z"] and high.x < 2.0:
                face.name = "pressed"
        self.mesh = ng.Mesh(occ.OCCGeometry(shape).GenerateMesh(maxh=self.CUT_MM / 3.0, grading=0.4)).Curve(
            order
        )
        space = _spaces(self.mesh, order, dirichletx="cut|x", dirichlety="cut|y", dirichletz="cut")
        v, _ = space.TestFunction()
        inside = 1.0 - ng.x**2 - ng.y**2
        pressure = ng.IfPos(inside, self.PEAK_MPA * ng.sqrt(ng.IfPos(inside, inside, 0.0)), 0.0)
        load = ng.LinearForm(pressure * v[2] * ng.ds("pressed", bonus_intorder=16)).Assemble()
        solution = _solved(material, space, self._boussinesq(), "cut", load)
        self.found, self._pressure = solution.components

    def _boussinesq(self) -> Any:
        """Return the displacement under a point load of 1 N at the origin [mm]."""
        nu, rho = self.material.poisson, ng.sqrt(ng.x**2 + ng.y**2 + ng.z**2)
        outward = ng.z / rho**3 - (1.0 - 2.0 * nu) / (rho * (rho + ng.z))
        down = ng.z**2 / rho**3 + 2.0 * (1.0 - nu) / rho
        return ng.CF((ng.x * outward, ng.y * outward, down)) / (4.0 * np.pi * self.material.shear_modulus_mpa)

    def stress_zz_mpa(self, depth_mm: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return sigma_zz on the axis, as found."""
        stress = 2.0 * self.material.shear_modulus_mpa * ng.Grad(self.found)[2, 2] + self._pressure
        near = 1e-3
        return np.array([stress(self.mesh(near, near, depth)) for depth in depth_mm])

    def dent_mm(self, radius_mm: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return how far the surface moves in at distances from the axis, as found."""
        return np.array([self.found(self.mesh(r * 0.6, r * 0.8, 1e-9))[2] for r in radius_mm])

    def hertz_stress_zz_mpa(self, depth_mm: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return sigma_zz on the axis by the formula, -p0 / (1 + z^2/a^2)."""
        stress: NDArray[np.float64] = -self.PEAK_MPA / (1.0 + depth_mm**2)
        return stress

    def point_stress_zz_mpa(self, depth_mm: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return sigma_zz on the axis under a point load, -3 P / (2 pi z^2)."""
        stress: NDArray[np.float64] = -1.5 / (np.pi * depth_mm**2)
        return stress

    def hertz_dent_mm(self, radius_mm: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the dent by the formula, (pi p0 / (4 E* a)) (2 a^2 - r^2), valid within the patch."""
        dent: NDArray[np.float64] = (
            np.pi * self.PEAK_MPA / (4.0 * self.material.plane_strain_modulus_mpa) * (2.0 - radius_mm**2)
        )
        return dent
