"""Normal of the ground and use of friction at a foot, from the network's contact point and friction ratio."""

import math
from typing import NamedTuple

#: Most of the standard deviations with which a value is still given: direction [rad] and friction use [1].
_NORMAL_SIGMA_RAD, _FRICTION_SIGMA = 0.3, 0.2
#: Normal force from which the contact is learnt [N], and over its own standard deviation [1].
_LEAST_N, _LEAST_SIGMAS = 0.03, 4.0


class Ground(NamedTuple):
    """The ground below one foot.

    Attributes:
        pressing_n: Normal force [N].
        normal: Unit normal into the foot, foot frame.
        normal_sigma_rad: Standard deviation of its direction [rad].
        ratio: Tangential over normal force forward and to the left, in the tangent plane turned upright [1].
        friction_use: Length of `ratio` [1].
        friction_use_sigma: Standard deviation of it [1].
    """

    pressing_n: float
    normal: tuple[float, float, float]
    normal_sigma_rad: float
    ratio: tuple[float, float]
    friction_use: float
    friction_use_sigma: float


_NAN = math.nan
NO_GROUND = Ground(_NAN, (_NAN, _NAN, _NAN), _NAN, (_NAN, _NAN), _NAN, _NAN)


def ground_of(
    force_n: list[float], sigma_n: list[float], contact: list[float], contact_sigma: list[float]
) -> Ground:
    """Return the ground of one foot from a row of `ports.Load`; NaN where the load does not tell it."""
    fx, fy, fz = force_n
    px, py, rx, ry = contact
    square = px * px + py * py
    scale = 1.0 / (1.0 + square)
    nx, ny, nz = 2.0 * px * scale, 2.0 * py * scale, (1.0 - square) * scale
    pressing_n = fx * nx + fy * ny + fz * nz
    if not (pressing_n > _LEAST_N and pressing_n > _LEAST_SIGMAS * sigma_n[2] and nz > 0.0):
        return NO_GROUND
    # The third component follows: the tangential force is perpendicular to the normal.
    rz = -(nx * rx + ny * ry) / nz
    use = math.sqrt(rx * rx + ry * ry + rz * rz)
    normal_sigma = 2.0 * scale * math.hypot(contact_sigma[0], contact_sigma[1])
    use_sigma = math.hypot(contact_sigma[2], contact_sigma[3]) / math.sqrt(2.0)
    known_normal, known_use = normal_sigma < _NORMAL_SIGMA_RAD, use_sigma < _FRICTION_SIGMA
    flat = math.hypot(rx, ry)
    upright = use / flat if flat > 0.0 else 1.0
    return Ground(
        pressing_n,
        (nx, ny, nz) if known_normal else (_NAN, _NAN, _NAN),
        normal_sigma if known_normal else _NAN,
        (rx * upright, ry * upright),
        use if known_use else _NAN,
        use_sigma if known_use else _NAN,
    )
