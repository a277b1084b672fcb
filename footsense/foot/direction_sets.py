"""Sets of unit vectors above an elevation: grids, the paper's protocols, random and even distributions."""

import math
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from footsense.foot.directions import directions
from footsense.frames import Vector


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
    shift_deg = 5.0 if protocol == "verification" else 0.0
    ring = direction_grid(shift_deg + 10.0 * np.arange(36), shift_deg + 40.0 + 10.0 * np.arange(5))
    return ring if protocol == "verification" else np.concatenate([ring, [[0.0, 0.0, 1.0]]])


def random_directions(rng: np.random.Generator, n: int, lowest_elevation_deg: float) -> Vector:
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
    across, azimuth = np.sqrt(1 - z**2), math.pi * (3 - math.sqrt(5)) * k
    return np.column_stack([across * np.cos(azimuth), across * np.sin(azimuth), z])
