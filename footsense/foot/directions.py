"""Vector geometry: azimuth and elevation, angles between vectors, tangent frames, rotations.

The frame is the foot's: x forward, y left, z along the leg. Azimuth t1 runs from x to y, elevation t2 from the xy plane
to z: f = |f| (cos t2 cos t1, cos t2 sin t1, sin t2).
"""

import numpy as np
from numpy.typing import ArrayLike

from footsense.frames import Vector


def normalized(vectors: Vector) -> Vector:
    """Return vectors scaled to unit length, shape (..., 3); none may be zero."""
    unit: Vector = vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
    return unit


def directions(azimuth_deg: ArrayLike, elevation_deg: ArrayLike) -> Vector:
    """Return the unit vectors of azimuths and elevations [deg] (which broadcast), shape (..., 3).

    Example:
        >>> directions(90.0, 0.0).round(12).tolist()
        [0.0, 1.0, 0.0]
    """
    t1, t2 = np.broadcast_arrays(np.radians(azimuth_deg), np.radians(elevation_deg))
    return np.stack([np.cos(t2) * np.cos(t1), np.cos(t2) * np.sin(t1), np.sin(t2)], axis=-1)


def azimuth_elevation_deg(vectors: Vector) -> tuple[Vector, Vector]:
    """Return azimuth, -180 to 180, and elevation [deg], shape (...), of vectors, shape (..., 3).

    Example:
        >>> [float(angle) for angle in azimuth_elevation_deg(np.array([0.0, 1.0, 1.0]))]
        [90.0, 45.0]
    """
    x, y, z = np.moveaxis(np.asarray(vectors, np.float64), -1, 0)
    return np.degrees(np.arctan2(y, x)), np.degrees(np.arctan2(z, np.hypot(x, y)))


def angles_between_deg(vectors: Vector, others: Vector) -> Vector:
    """Return the angles between two arrays of vectors [deg], 0 to 180; shapes (..., 3) that broadcast.

    By the arc tangent: the arc cosine loses angles below 1e-6 deg.

    Example:
        >>> float(angles_between_deg(np.array([0.0, 0.0, 2.0]), np.array([3.0, 0.0, 0.0])))
        90.0
    """
    sine = np.linalg.norm(np.cross(vectors, others), axis=-1)
    angle_deg: Vector = np.degrees(np.arctan2(sine, (vectors * others).sum(axis=-1)))
    return angle_deg


def tangent_frame(normals: Vector) -> tuple[Vector, Vector]:
    """Return two orthogonal unit vectors perpendicular to each normal, shape (..., 3) each.

    Args:
        normals: Unit vectors, shape (..., 3). (first, second, normal) is a right-handed frame.
    """
    along_x = np.abs(normals[..., :1]) >= 0.5
    first = normalized(np.cross(normals, np.where(along_x, [0.0, 1.0, 0.0], [1.0, 0.0, 0.0])))
    return first, np.cross(normals, first)


def rotation(turn_rad: Vector) -> Vector:
    """Return the rotation matrix, shape (3, 3), of a rotation vector [rad], shape (3,) (Rodrigues).

    Example:
        >>> rotation(np.array([0.0, 0.0, np.pi / 2])).round(12).tolist()
        [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    """
    angle = float(np.linalg.norm(turn_rad))
    if angle == 0.0:
        return np.eye(3)
    x, y, z = turn_rad / angle
    across = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    rotation_matrix: Vector = np.eye(3) + np.sin(angle) * across + (1.0 - np.cos(angle)) * across @ across
    return rotation_matrix
