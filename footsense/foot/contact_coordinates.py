"""Contact coordinates of a load: normal force, friction ratio and contact point, five numbers without a constraint.

With the inward unit normal n of the ball at the contact, the force is f = s (n + r), where r is perpendicular to n. The
coordinates are s [N], both horizontal components of r [1], and the stereographic contact point
(n_x, n_y) / (1 + n_z) [1], as in `LoadEstimate.contact_point_and_friction`.
"""

import numpy as np

from footsense.foot.specimen import ContactLoads
from footsense.frames import Vector

#: Number of the coordinates, and where each kind is.
COORDINATES = 5
NORMAL_FORCE, FRICTION, POINT = slice(0, 1), slice(1, 3), slice(3, 5)
#: Bounds: least normal force [N], longest friction ratio and contact point [1], which is a normal at 26 deg of
#: elevation.
_MIN_NORMAL_FORCE_N, _MAX_FRICTION, _MAX_POINT = 2e-3, 0.9, 0.62


def normals_of_stereographic_points(point: Vector) -> Vector:
    """Return the unit contact normals, shape (n, 3), of stereographic contact points, shape (n, 2)."""
    square = (point**2).sum(axis=1, keepdims=True)
    normal: Vector = np.hstack([2.0 * point, 1.0 - square]) / (1.0 + square)
    return normal


def contact_loads(coordinates: Vector) -> ContactLoads:
    """Return normals and forces [N] of contact coordinates, shape (n, 5)."""
    friction = coordinates[:, FRICTION]
    normal = normals_of_stereographic_points(coordinates[:, POINT])
    along = -(normal[:, :2] * friction).sum(axis=1, keepdims=True) / normal[:, 2:]
    return ContactLoads(normal, coordinates[:, NORMAL_FORCE] * (normal + np.hstack([friction, along])))


def contact_coordinates(force_n: Vector, contact_point_and_friction: Vector) -> Vector:
    """Return the contact coordinates, shape (n, 5), within their bounds, of an estimated load.

    Args:
        force_n: Forces [N], shape (n, 3).
        contact_point_and_friction: As in `LoadEstimate`, shape (n, 4).
    """
    point, friction = contact_point_and_friction[:, :2], contact_point_and_friction[:, 2:]
    pressing_n = (force_n * normals_of_stereographic_points(point)).sum(axis=1)
    return within_bounds(np.column_stack([pressing_n, friction, point]))


def within_bounds(coordinates: Vector) -> Vector:
    """Return contact coordinates, shape (n, 5), moved to the nearest that a load can have."""
    bounded = coordinates.copy()
    bounded[:, 0] = np.maximum(coordinates[:, 0], _MIN_NORMAL_FORCE_N)
    for part, longest in ((FRICTION, _MAX_FRICTION), (POINT, _MAX_POINT)):
        length = np.linalg.norm(coordinates[:, part], axis=1, keepdims=True)
        bounded[:, part] *= longest / np.maximum(length, longest)
    return bounded
