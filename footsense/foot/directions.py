"""Vector geometry: azimuth and elevation, angles, tangent frames, rotations, and sets of directions.

The frame is the foot's: x forward, y left, z along the leg. Azimuth t1 runs from x to y, elevation t2 from the xy plane
to z: f = |f| (cos t2 cos t1, cos t2 sin t1, sin t2).
"""

import math
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from footsense.frames import Vector

#: Step of both angles in the paper's protocols, and their lowest elevation [deg].
PAPER_ANGLE_STEP_DEG, LOWEST_PAPER_ELEVATION_DEG = 10.0, 40.0

#: Largest deviation of a unit vector from length 1, and of the products of a rotation's rows [1].
UNIT_LENGTH_TOLERANCE = 1e-6
_GOLDEN_ANGLE_RAD = math.pi * (3 - math.sqrt(5))


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


def direction_grid(azimuths_deg: ArrayLike, elevations_deg: ArrayLike) -> Vector:
    """Return all combinations of azimuths and elevations as unit vectors, shape (azimuths * elevations, 3)."""
    azimuth, elevation = np.meshgrid(azimuths_deg, elevations_deg, indexing="ij")
    return directions(azimuth.ravel(), elevation.ravel())


def paper_directions(protocol: Literal["training", "verification"]) -> Vector:
    """Return the force directions of the paper's training or verification protocol, as unit vectors.

    Args:
        protocol: `training`: 36 azimuths at 40 to 80 deg of elevation, and the pole: 181. `verification`: both angles
            5 deg farther, without the pole: 180.

    Source:
        Aoyagi et al., section III F.
    """
    step_deg = PAPER_ANGLE_STEP_DEG
    shift_deg = step_deg / 2.0 if protocol == "verification" else 0.0
    azimuths_deg, elevations_deg = (
        np.arange(0.0, 360.0, step_deg),
        np.arange(LOWEST_PAPER_ELEVATION_DEG, 90.0, step_deg),
    )
    ring = direction_grid(shift_deg + azimuths_deg, shift_deg + elevations_deg)
    return ring if protocol == "verification" else np.concatenate([ring, [[0.0, 0.0, 1.0]]])


def random_directions(rng: "np.random.Generator", n: int, lowest_elevation_deg: float) -> Vector:
    """Return n random unit vectors above an elevation [deg], uniform in area, shape (n, 3)."""
    z = rng.uniform(math.sin(math.radians(lowest_elevation_deg)), 1.0, n)
    azimuth = rng.uniform(0.0, 2.0 * math.pi, n)
    across = np.sqrt(1.0 - z**2)
    return np.column_stack([across * np.cos(azimuth), across * np.sin(azimuth), z])


def spiral_directions(n: int, lowest_elevation_deg: float) -> Vector:
    """Return n evenly distributed unit vectors above an elevation [deg], shape (n, 3), from the pole down.

    They lie on a spiral by the golden angle.
    """
    k = np.arange(n) + 0.5
    z = 1 - k / n * (1 - math.sin(math.radians(lowest_elevation_deg)))
    across, azimuth = np.sqrt(1 - z**2), _GOLDEN_ANGLE_RAD * k
    return np.column_stack([across * np.cos(azimuth), across * np.sin(azimuth), z])
