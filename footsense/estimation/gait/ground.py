"""Normal of the ground and use of friction at a foot, from the network's contact point and friction ratio."""

import math
from typing import NamedTuple

from footsense.ports import Load

#: Most of the standard deviations with which a value is still given: direction [rad] and friction use [1].
_MAX_NORMAL_SIGMA_RAD, _MAX_FRICTION_SIGMA = 0.3, 0.2
#: Normal force from which the contact is learnt [N], and over its own standard deviation [1].
_MIN_PRESSING_N, _MIN_PRESSING_SIGMAS = 0.03, 4.0


class Ground(NamedTuple):
    """The ground below one foot.

    Attributes:
        pressing_n: Normal force [N].
        normal: Unit normal into the foot, foot frame.
        normal_sigma_rad: Standard deviation of its direction [rad].
        friction_use: Tangential over normal force [1].
        friction_use_sigma: Standard deviation of it [1].
    """

    pressing_n: float
    normal: tuple[float, float, float]
    normal_sigma_rad: float
    friction_use: float
    friction_use_sigma: float


_NAN = math.nan
NO_GROUND = Ground(_NAN, (_NAN, _NAN, _NAN), _NAN, _NAN, _NAN)


def ground_of(load: Load, row: int) -> Ground:
    """Return normal and friction use of the ground under one foot; NaN where the load does not determine them.

    In Python numbers: for six legs, numpy's calls take longer.

    Args:
        load: Loads of all legs.
        row: Row of the foot's leg.
    """
    fx, fy, fz = load.force_n[row].tolist()
    px, py, rx, ry = load.contact[row].tolist()
    sigma_px, sigma_py, sigma_rx, sigma_ry = load.contact_sigma[row].tolist()
    square = px * px + py * py
    scale = 1.0 / (1.0 + square)
    nx, ny, nz = 2.0 * px * scale, 2.0 * py * scale, (1.0 - square) * scale
    pressing_n = fx * nx + fy * ny + fz * nz
    if not (
        pressing_n > _MIN_PRESSING_N
        and pressing_n > _MIN_PRESSING_SIGMAS * load.sigma_n.item(row, 2)
        and nz > 0.0
    ):
        return NO_GROUND
    # The third component follows: the tangential force is perpendicular to the normal.
    rz = -(nx * rx + ny * ry) / nz
    use = math.sqrt(rx * rx + ry * ry + rz * rz)
    normal_sigma = 2.0 * scale * math.hypot(sigma_px, sigma_py)
    use_sigma = math.hypot(sigma_rx, sigma_ry) / math.sqrt(2.0)
    known_normal, known_use = normal_sigma < _MAX_NORMAL_SIGMA_RAD, use_sigma < _MAX_FRICTION_SIGMA
    return Ground(
        pressing_n,
        (nx, ny, nz) if known_normal else (_NAN, _NAN, _NAN),
        normal_sigma if known_normal else _NAN,
        use if known_use else _NAN,
        use_sigma if known_use else _NAN,
    )
