"""Map projection of the ball seen from below: contact points, and circles of elevation.

Stereographic, so that circles on the ball are circles; forward is up, and left is to the right, as whoever lies under
the foot sees it. Needs numpy alone.
"""

import numpy as np

from footsense.foot.directions import tangent_frame
from footsense.frames import Vector


def map_position(normal: Vector) -> tuple[Vector, Vector]:
    """Return the map coordinates of contact points, to the right and up, shape (...).

    Args:
        normal: Inward unit normals, shape (..., 3); of a centred load its direction.

    Example:
        >>> right, up = map_position(np.array([0.0, 0.0, 1.0]))
        >>> float(abs(right)), float(abs(up))
        (0.0, 0.0)
    """
    plane = -normal[..., :2] / (1.0 + normal[..., 2:])
    return plane[..., 1], plane[..., 0]


def elevation_circle_map_radius(elevation_deg: float) -> float:
    """Return the map radius of the circle of one elevation."""
    return float(np.tan(np.radians(90.0 - elevation_deg) / 2.0))


def map_circle(direction: Vector, radius_deg: float) -> tuple[Vector, Vector]:
    """Return map coordinates (right, up) of the circle of directions at an angle [deg] from one direction.

    Args:
        direction: Unit vector, shape (3,).
        radius_deg: The angle.
    """
    first, second = tangent_frame(direction)
    turn = np.linspace(0.0, 2.0 * np.pi, 181)[:, None]
    sideways = np.cos(turn) * first + np.sin(turn) * second
    radius = np.radians(radius_deg)
    return map_position(np.cos(radius) * direction + np.sin(radius) * sideways)
