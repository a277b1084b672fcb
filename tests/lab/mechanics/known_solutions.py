"""Elasticity with known solutions, solved by the weak forms of the foot.

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

from footsense.lab.fem.elasticity import mixed_strain_energy_density
from footsense.lab.geometry import Material

#: Where the half-space is cut off [mm]: a point load is good enough there.
_CUT_MM = 12.0
#: Peak pressure of the patch of 1 mm under 1 N, 3 P / (2 pi a^2) [MPa].
_PEAK_MPA = 1.5 / np.pi
#: Radii of the dent and depths on the axis that are compared [mm]; nearer to the surface the stress is the mesh's.
_RADII_MM, _DEPTHS_MM = np.array([0.05, 0.3, 0.6, 0.9]), np.array([0.25, 0.5, 1.0, 2.0, 3.0, 5.0, 8.0])


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
    axes = (ng.x, ng.y, ng.z)
    gradient = ng.CF(tuple(part.Diff(axis) for part in displacement for axis in axes), dims=(3, 3))
    shear = material.shear_modulus_mpa * (gradient + gradient.trans)
    stress = shear + material.lame_lambda_mpa * ng.Trace(gradient) * ng.Id(3)
    body = ng.CF(tuple(-sum(stress[i, j].Diff(axes[j]) for j in range(3)) for i in range(3))).Compile()
    space = _spaces(mesh, order, dirichlet=".*")
    v, _ = space.TestFunction()
    load = ng.LinearForm(body * v * ng.dx(bonus_intorder=4)).Assemble()
    exact = ng.CF(tuple(displacement))
    found = _solved(material, space, exact, ".*", load).components[0]

    def norm(field: Any) -> float:
        return float(np.sqrt(ng.Integrate(ng.InnerProduct(field, field) * ng.dx(bonus_intorder=6), mesh)))

    return norm(found - exact) / norm(exact), norm(ng.Grad(found) - gradient) / norm(gradient)


def half_space_errors(material: Material, edge_mm: float = 0.5, order: int = 3) -> tuple[float, float]:
    """Solve a half-space z > 0 under a Hertz pressure of radius 1 mm and 1 N.

    It is a quarter of a half ball whose outer surface moves as Boussinesq's solution says.

    Args:
        material: Material of the half-space.
        edge_mm: Largest edge of the mesh around the patch [mm].
        order: Order of the displacement.

    Returns:
        Largest relative errors [1] of the dent, (pi p0 / (4 E* a)) (2 a^2 - r^2) within the patch, and of the stress
        on the axis, -p0 / (1 + z^2/a^2), from a quarter of the radius down.
    """
    mesh = _half_space_mesh(edge_mm, order)
    space = _spaces(mesh, order, dirichletx="cut|x", dirichlety="cut|y", dirichletz="cut")
    v, _ = space.TestFunction()
    inside = 1.0 - ng.x**2 - ng.y**2
    pressure = ng.IfPos(inside, _PEAK_MPA * ng.sqrt(ng.IfPos(inside, inside, 0.0)), 0.0)
    load = ng.LinearForm(pressure * v[2] * ng.ds("pressed", bonus_intorder=16)).Assemble()
    solution = _solved(material, space, _point_load_displacement(material), "cut", load)
    moved, raised = solution.components
    dent_mm = np.array([moved(mesh(0.6 * r, 0.8 * r, 1e-9))[2] for r in _RADII_MM])
    hertz_mm = np.pi * _PEAK_MPA / (4.0 * material.plane_strain_modulus_mpa) * (2.0 - _RADII_MM**2)
    stress = 2.0 * material.shear_modulus_mpa * ng.Grad(moved)[2, 2] + raised
    stress_mpa = np.array([stress(mesh(1e-3, 1e-3, depth)) for depth in _DEPTHS_MM])
    hertz_mpa = -_PEAK_MPA / (1.0 + _DEPTHS_MM**2)
    return float(np.abs(dent_mm / hertz_mm - 1.0).max()), float(np.abs(stress_mpa / hertz_mpa - 1.0).max())


def _half_space_mesh(edge_mm: float, order: int) -> Any:
    """Return the mesh of the quarter of a half ball, with the faces `pressed`, `cut`, and those of the mirrors."""
    quarter = occ.Box((0, 0, 0), (3.0 * _CUT_MM,) * 3)
    ball, inner = (occ.Sphere((0, 0, 0), radius_mm) * quarter for radius_mm in (_CUT_MM, 1.0))
    inner.maxh = edge_mm
    shape = occ.Glue([ball - inner, inner])
    for face in shape.faces:
        low, high = face.bounding_box
        flat = [axis for axis in "xyz" if max(abs(getattr(low, axis)), abs(getattr(high, axis))) < 1e-6]
        face.name = flat[0] if flat else ("cut" if max(high.x, high.z) > 2.0 else "inside")
        if flat == ["z"] and high.x < 2.0:
            face.name = "pressed"
    return ng.Mesh(occ.OCCGeometry(shape).GenerateMesh(maxh=_CUT_MM / 3.0, grading=0.4)).Curve(order)


def _point_load_displacement(material: Material) -> Any:
    """Return the displacement under a point load of 1 N at the origin [mm], by Boussinesq."""
    nu, rho = material.poisson, ng.sqrt(ng.x**2 + ng.y**2 + ng.z**2)
    outward = ng.z / rho**3 - (1.0 - 2.0 * nu) / (rho * (rho + ng.z))
    down = ng.z**2 / rho**3 + 2.0 * (1.0 - nu) / rho
    return ng.CF((ng.x * outward, ng.y * outward, down)) / (4.0 * np.pi * material.shear_modulus_mpa)
