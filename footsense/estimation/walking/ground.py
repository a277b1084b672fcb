"""The ground below one foot, as its load tells it: normal, friction ratio, and whether the foot comes to slide.

The network gives the contact point, hence the normal of the ground, and the friction ratio: tangential over normal
force. A foot that sticks may have any ratio up to the ground's coefficient of friction; one that slides has that of
the ground, whatever load and direction do. The force alone does not tell the coefficient: a periodic gait repeats its
largest ratio in every stance, whether the foot slides there or not. So the coefficient is one that the configuration
knows, and a foot slips where its ratio comes to it. Without one, nothing is said of slips.

The ratio cannot distinguish a foot that sticks at the cone from one that slides there: both are reported as slips.
"""

import math
from typing import NamedTuple

from footsense.frames import Slip
from footsense.ports import LoadEstimate

#: Largest standard deviation with which a direction [rad] and tangential over normal force [1] are still given.
_MAX_SIGMA = 0.2
#: Normal force from which the contact is learnt, over its own standard deviation [1].
_MIN_PRESSING_SIGMAS = 4.0
#: Ratio below the coefficient from which a foot slips, and largest standard deviation of a ratio that tells [1]: in
#: walks over four grounds, of robots of the training, one slip of 388 is then of a foot that is not at its cone.
_CONE_MARGIN = 0.04
_MAX_SLIP_RATIO_SIGMA = 3.0 * _CONE_MARGIN
#: Checks at the cone until a slip is reported, and away from it until it is over.
_SLIP_STARTS_AFTER, _SLIP_ENDS_AFTER = 2, 3
#: From the beginning or end of a slip to the first estimate that shows it, and its standard deviation [ns].
SLIP_LAG_NS = 10_000_000


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


def ground_of(load: LoadEstimate, row: int) -> GroundEstimate:
    """Return ground normal and tangential over normal force below one foot; NaN where the load does not determine them.

    In Python numbers: for six legs, numpy's calls take longer.

    Args:
        load: Loads of all legs.
        row: Row of the foot's leg.
    """
    fx, fy, fz = load.force_n[row].tolist()
    px, py, rx, ry = load.contact_point_and_friction[row].tolist()
    sigma_px, sigma_py, sigma_rx, sigma_ry = load.contact_sigma[row].tolist()
    square = px * px + py * py
    scale = 1.0 / (1.0 + square)
    nx, ny, nz = 2.0 * px * scale, 2.0 * py * scale, (1.0 - square) * scale
    pressing_n = fx * nx + fy * ny + fz * nz
    if not (pressing_n > _MIN_PRESSING_SIGMAS * load.sigma_n.item(row, 2) and nz > 0.0):
        return NO_GROUND
    # The third component follows: the tangential force is perpendicular to the normal.
    rz = -(nx * rx + ny * ry) / nz
    ratio = math.sqrt(rx * rx + ry * ry + rz * rz)
    normal_sigma = 2.0 * scale * math.hypot(sigma_px, sigma_py)
    ratio_sigma = math.hypot(sigma_rx, sigma_ry) / math.sqrt(2.0)
    known_normal, known_ratio = normal_sigma < _MAX_SIGMA, ratio_sigma < _MAX_SIGMA
    return GroundEstimate(
        pressing_n,
        (nx, ny, nz) if known_normal else (_NAN, _NAN, _NAN),
        normal_sigma if known_normal else _NAN,
        ratio if known_ratio else _NAN,
        ratio_sigma if known_ratio else _NAN,
    )


class SlipDetector:
    """Slip detector of one leg: whether the friction ratio comes to the ground's coefficient.

    Args:
        friction: Coefficient of friction of the ground [1]; NaN where it is not known.

    Attributes:
        state: Whether the foot slides; unknown without a coefficient.
    """

    def __init__(self, friction: float) -> None:
        self._cone = friction - _CONE_MARGIN
        self.reset_stance()

    def reset_stance(self) -> None:
        """Reset the state of the stance, after the foot has lifted off."""
        self.state = Slip.UNKNOWN
        # Checks in a row at the cone or away from it, and the time of the first of them [ns].
        self._at_cone, self._run, self._since_ns = False, 0, 0

    def observe(self, ground: GroundEstimate, now_ns: int) -> int | None:
        """Process the newest friction ratio; return the time at which a slip started or ended [ns], else None.

        Args:
            ground: The ground below the foot.
            now_ns: Current time [ns].
        """
        ratio, slips = ground.tangential_over_normal, self.state is Slip.SLIPPING
        if math.isnan(ratio - self._cone):
            self.state, self._run = Slip.UNKNOWN, 0
            return now_ns - SLIP_LAG_NS if slips else None
        if ground.tangential_over_normal_sigma > _MAX_SLIP_RATIO_SIGMA:
            # As in the first scan of a stance; a reported slip continues.
            self._run = 0
            if not slips:
                self.state = Slip.UNKNOWN
            return None
        at_cone = ratio > self._cone
        if at_cone is not self._at_cone or not self._run:
            self._at_cone, self._run, self._since_ns = at_cone, 0, now_ns
        self._run += 1
        if not slips:
            self.state = Slip.NONE
        if at_cone is slips or self._run < (_SLIP_STARTS_AFTER if at_cone else _SLIP_ENDS_AFTER):
            return None
        self.state = Slip.SLIPPING if at_cone else Slip.NONE
        return self._since_ns - SLIP_LAG_NS
