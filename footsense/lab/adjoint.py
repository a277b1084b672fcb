"""Nine solves instead of one per load: the adjoint field of an element is its response to every surface load.

With K u = b(t) for a surface traction t and the mean closure d_e = j_e . u of element e, symmetry of K gives

    d_e = j_e . K^-1 b(t) = w_e . b(t) = int over the surface of w_e . t,        K w_e = j_e

so w_e(x) [mm/N], the displacement field under the "load" j_e, is the closure per unit point force at x, and a
patch of pressure p along f answers with f . int p w_e / int p.

Source:
    Betti's reciprocal theorem; checked against forward solves in tests/lab.
"""

from dataclasses import dataclass

import ngsolve as ng
import numpy as np
from numpy.typing import NDArray

from footsense.lab.solid import Solid

#: 1000 um in a mm: closures leave the solid here.
UM_PER_MM = 1000.0


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceField:
    """The adjoint fields, sampled on the ground-side surface.

    Attributes:
        normal: Inward unit normals of the samples [1], shape (n, 3); the sample is at -R normal.
        weight_mm2: Area that each sample stands for [mm2], shape (n,).
        influence: Closure of each element per unit force there [um/N], shape (n, 9, 3).
    """

    normal: NDArray[np.float64]
    weight_mm2: NDArray[np.float64]
    influence: NDArray[np.float64]


def influence_field(solid: Solid, sample_order: int = 4) -> SurfaceField:
    """Solve the nine adjoint problems and sample them at the quadrature points of the ground-side surface.

    Args:
        solid: The factorised foot.
        sample_order: Order of the quadrature rule whose points are the samples.

    Returns:
        The sampled fields.
    """
    rule = ng.IntegrationRule(ng.TRIG, sample_order)
    points = solid.mesh.MapToAllElements(rule, solid.mesh.Boundaries("curved_ground"))
    centre = ng.CF((0.0, 0.0, -solid.sole.plate_mm))
    radial = np.asarray((ng.CF((ng.x, ng.y, ng.z)) - centre)(points))
    # The area element of the curved map: norm of the cross product of its two columns.
    jacobian = np.asarray(ng.specialcf.JacobianMatrix(3, 2)(points)).reshape(-1, 3, 2)
    area = np.linalg.norm(np.cross(jacobian[:, :, 0], jacobian[:, :, 1]), axis=1)
    weight = area * np.tile(np.asarray(rule.weights), len(area) // len(rule.weights))
    fields = [solid.solve(solid.closure_functional(element)) for element in range(9)]
    influence = np.stack([np.asarray(field.components[0](points)) for field in fields], axis=1)
    return SurfaceField(
        normal=-radial / np.linalg.norm(radial, axis=1, keepdims=True),
        weight_mm2=weight,
        influence=influence * UM_PER_MM,
    )
