"""The ground below one foot, from its load: normal, and ratio of tangential to normal force.

The network gives the contact point, hence the normal of the ground, and the friction ratio: tangential over normal
force. What the ratio says of a slide is in `holds.py`.
"""

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from footsense.estimation.settings import SMALL_SHARE
from footsense.ports import LoadEstimate

#: Largest standard deviation with which a direction [rad] and tangential over normal force [1] are still given: both
#: are of the size of one.
_MAX_SIGMA = SMALL_SHARE


class GroundEstimate(NamedTuple):
    """Estimated ground normal and tangential over normal force below one foot, with standard deviations.

    Attributes:
        pressing_n: Normal force [N].
        normal: Unit normal into the foot, foot frame.
        normal_sigma_rad: Standard deviation of its direction [rad].
        tangential_over_normal: Tangential over normal force [1].
        tangential_over_normal_sigma: Standard deviation of it [1].
    """

    pressing_n: float
    normal: tuple[float, float, float]
    normal_sigma_rad: float
    tangential_over_normal: float
    tangential_over_normal_sigma: float


_NAN = math.nan
NO_GROUND = GroundEstimate(_NAN, (_NAN, _NAN, _NAN), _NAN, _NAN, _NAN)


class FootLoad(NamedTuple):
    """A row of `LoadEstimate` in Python numbers: for six legs, numpy's calls take longer.

    Attributes:
        force_n: Force [N].
        sigma_z_n: Standard deviation of the force along the leg [N].
        contact: Contact point and friction ratio.
        contact_sigma: Standard deviation of each.
    """

    force_n: Sequence[float]
    sigma_z_n: float
    contact: Sequence[float]
    contact_sigma: Sequence[float]


def foot_loads(load: LoadEstimate, rows: slice = slice(None)) -> Iterator[FootLoad]:
    """Return some of the loads, all of them by default."""
    return map(
        FootLoad,
        load.force_n[rows].tolist(),
        load.sigma_n[rows, 2].tolist(),
        load.contact_point_and_friction[rows].tolist(),
        load.contact_sigma[rows].tolist(),
    )


def friction_ratio(load: FootLoad) -> tuple[float, float]:
    """Return tangential over normal force below a foot and its standard deviation [1], NaN where they are not known."""
    force_n, sigma_z_n, (px, py, rx, ry), (_, _, sigma_rx, sigma_ry) = load
    down = 1.0 - px * px - py * py
    variance = 0.5 * (sigma_rx * sigma_rx + sigma_ry * sigma_ry)
    if down > 0.0 and variance < _MAX_SIGMA * _MAX_SIGMA:
        fx, fy, fz = force_n
        if 2.0 * (fx * px + fy * py) + fz * down > sigma_z_n * (2.0 - down):
            # The third component follows: the tangential force is perpendicular to the normal.
            rz = 2.0 * (px * rx + py * ry) / down
            return math.sqrt(rx * rx + ry * ry + rz * rz), math.sqrt(variance)
    return _NAN, _NAN


def ground_of(load: FootLoad) -> GroundEstimate:
    """Return normal, and tangential over normal force, below a foot; NaN where the load does not determine them."""
    (fx, fy, fz), sigma_z_n, (px, py, _, _), (sigma_px, sigma_py, _, _) = load
    square = px * px + py * py
    scale = 1.0 / (1.0 + square)
    nx, ny, nz = 2.0 * px * scale, 2.0 * py * scale, (1.0 - square) * scale
    pressing_n = fx * nx + fy * ny + fz * nz
    if not (pressing_n > sigma_z_n and nz > 0.0):
        return NO_GROUND
    normal_sigma = 2.0 * scale * math.hypot(sigma_px, sigma_py)
    known_normal = normal_sigma < _MAX_SIGMA
    return GroundEstimate(
        pressing_n,
        (nx, ny, nz) if known_normal else (_NAN, _NAN, _NAN),
        normal_sigma if known_normal else _NAN,
        *friction_ratio(load),
    )
