"""Adjoint fields: one solve per gap cell gives that cell's closure under any surface load.

With K u = b(t) for a surface traction t and the mean closure d_c = j_c . u of cell c, symmetry of K gives

    d_c = j_c . K^-1 b(t) = w_c . b(t) = int over the surface of w_c . t,        K w_c = j_c

so w_c(x) [mm/N], the displacement field under the "load" j_c, is the closure per unit point force at x; and
j_b . w_c is the closure of cell b under a unit pair of forces that press cell c: the compliance of the gaps.

Source:
    Betti's reciprocal theorem; checked against forward solves in tests/lab.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import ngsolve as ng
import numpy as np

from footsense.foot.directions import normalized
from footsense.frames import Vector
from footsense.lab.fem.mesh import cavity_cells
from footsense.lab.fem.quarter import NO_MIRRORS, Parity, QuarterFoot
from footsense.lab.geometry import UM_PER_MM

#: Order of the quadrature rule whose points on the ground-side surface are the samples.
SURFACE_QUADRATURE_ORDER = 5


@dataclass(frozen=True, slots=True, eq=False)
class AdjointFields:
    """The adjoint fields of one symmetry class, sampled on the ground-side surface.

    Attributes:
        parity: The class.
        normal: Inward unit normals of the samples [1], shape (n, 3); the sample is at -R normal.
        weight_mm2: Area that each sample stands for [mm2], shape (n,).
        influence_um_per_n: Mean closure of each face per unit force there [um/N], shape (n, faces, 3).
        compliance_um_per_n: Mean closure of each face under a unit force spread over another [um/N], shape (faces,
            faces).
    """

    parity: Parity
    normal: Vector
    weight_mm2: Vector
    influence_um_per_n: Vector
    compliance_um_per_n: Vector


def solve_cell_closure_fields(quarter: QuarterFoot, faces: Sequence[tuple[str, float]] = ()) -> AdjointFields:
    """Return the adjoint fields of the mean closure [um] of each gap cell, sampled on the ground-side surface.

    Args:
        quarter: The factorised class.
        faces: Faces to take in place of the cells: names of cells joined by `|`, and their area together [mm2].
    """
    design = quarter.design
    cells = cavity_cells(design, quarter=quarter.parity != NO_MIRRORS)
    faces = faces or [(cell.name, design.cavity_cell_area_mm2) for cell in cells]
    return solve_functional_fields(quarter, [quarter.closure_functional(*face) for face in faces], UM_PER_MM)


def solve_functional_fields(
    quarter: QuarterFoot, functionals: Sequence[Any], scale: float = 1.0
) -> AdjointFields:
    """Return the adjoint field of each linear functional of the displacement, sampled on the surface.

    Args:
        quarter: The factorised class.
        functionals: Assembled linear forms.
        scale: Factor on influence and compliance, for their units.
    """
    mesh, rule = quarter.mesh, ng.IntegrationRule(ng.TRIG, SURFACE_QUADRATURE_ORDER)
    points = mesh.MapToAllElements(rule, mesh.Boundaries("curved_ground"))
    radial = np.asarray((ng.CF((ng.x, ng.y, ng.z)) - ng.CF(quarter.ball_centre_mm))(points))
    # The area element of the curved map: norm of the cross product of its two columns.
    jacobian = np.asarray(ng.specialcf.JacobianMatrix(3, 2)(points)).reshape(-1, 3, 2)
    area = np.linalg.norm(np.cross(jacobian[:, :, 0], jacobian[:, :, 1]), axis=1)
    rows = np.stack([functional.vec.FV().NumPy() for functional in functionals])
    influence, compliance = [], []
    for functional in functionals:
        field = quarter.solve(functional)
        influence.append(np.asarray(field.components[0](points)))
        compliance.append(rows @ field.vec.FV().NumPy())
    return AdjointFields(
        parity=quarter.parity,
        normal=-normalized(radial),
        weight_mm2=area * np.tile(np.asarray(rule.weights), len(area) // len(rule.weights)),
        influence_um_per_n=np.stack(influence, axis=1) * scale,
        compliance_um_per_n=np.stack(compliance) * scale,
    )
