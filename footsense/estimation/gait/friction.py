"""Friction below the feet: tangential over normal force, slips, estimated friction coefficient.

The network gives the contact point, hence the normal of the ground, and the friction ratio. Slips show in that alone.

A foot that sticks may have any ratio of tangential to normal force up to the coefficient of friction; one that slides
has that of the ground, whatever load and direction do. So a slide begins as a kink: the ratio rises, and stays. A push
of the body that ends looks the same, but at a ratio of its own each time, and one that a later stance exceeds. Kinks at
one ratio, of several stances, which nothing exceeds, are the cone of the ground. From then on a foot slides where its
ratio comes to the cone. A slope alone has no kink: its ratio is there from the touchdown on.

The ratio cannot distinguish a foot that sticks at the cone from one that slides there: both are reported as slips.
"""

import math
from collections import deque
from typing import NamedTuple

from footsense.estimation.gait.back_dating import BackDated
from footsense.frames import Slip
from footsense.ports import LoadEstimate

#: Largest standard deviations with which a value is still given: direction [rad] and tangential over normal force [1].
_MAX_NORMAL_SIGMA_RAD, _MAX_FRICTION_SIGMA = 0.3, 0.2
#: Normal force from which the contact is learnt [N], and over its own standard deviation [1].
_MIN_PRESSING_N, _MIN_PRESSING_SIGMAS = 0.03, 4.0
#: Every second conversion is checked: the next one has mostly the same readings.
CONVERSIONS_PER_CHECK = 2
#: Checks of a plateau, and the longest mean time between two of them [ns].
_PLATEAU_CHECKS, _LONGEST_CHECK_NS = 4, 8_000_000
#: Time before a plateau in which the ratio may have risen to it [ns]: a slide that begins suddenly is not clear at
#: first.
_PLATEAU_LOOKBACK_NS = 120_000_000
#: Tolerance of a ratio in standard deviations, the smallest one [1], and the largest for detecting a slip and
#: for finding a kink [1].
_TOLERANCE_SIGMAS, _MIN_TOLERANCE, _MAX_SLIP_TOLERANCE, _MAX_KINK_TOLERANCE = 1.5, 0.02, 0.12, 0.045
#: Rise of a kink in tolerances.
_MIN_KINK_RISE_TOLERANCES = 3.0
#: Kinks that are kept, and kinks at one ratio that make a cone.
_MAX_KINKS, _MIN_CLUSTER = 30, 4
#: Static over kinetic friction at most [1].
_MAX_STATIC_OVER_KINETIC = 1.2
#: Checks at the cone until a slip is reported, and away from it until it is over.
_SLIP_STARTS_AFTER, _SLIP_ENDS_AFTER = 2, 3
#: Normal force from which friction is learnt [N].
_MIN_LEARNING_FORCE_N = 0.15
#: From the beginning or end of a slip to the first estimate that shows it [ns].
_SLIP_DETECTION_LAG_NS = 9_600_000
#: Standard deviation of the time of a slip [s].
_SLIP_TIME_SIGMA_S = 0.01


class Ground(NamedTuple):
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
NO_GROUND = Ground(_NAN, (_NAN, _NAN, _NAN), _NAN, _NAN, _NAN)


def ground_of(load: LoadEstimate, row: int) -> Ground:
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
    if not (
        pressing_n > _MIN_PRESSING_N
        and pressing_n > _MIN_PRESSING_SIGMAS * load.sigma_n.item(row, 2)
        and nz > 0.0
    ):
        return NO_GROUND
    # The third component follows: the tangential force is perpendicular to the normal.
    rz = -(nx * rx + ny * ry) / nz
    ratio = math.sqrt(rx * rx + ry * ry + rz * rz)
    normal_sigma = 2.0 * scale * math.hypot(sigma_px, sigma_py)
    ratio_sigma = math.hypot(sigma_rx, sigma_ry) / math.sqrt(2.0)
    known_normal, known_ratio = normal_sigma < _MAX_NORMAL_SIGMA_RAD, ratio_sigma < _MAX_FRICTION_SIGMA
    return Ground(
        pressing_n,
        (nx, ny, nz) if known_normal else (_NAN, _NAN, _NAN),
        normal_sigma if known_normal else _NAN,
        ratio if known_ratio else _NAN,
        ratio_sigma if known_ratio else _NAN,
    )


class FrictionEstimator:
    """Estimator of the ground's friction coefficient from the slips of all legs.

    Attributes:
        coefficient: Coefficient of kinetic friction [1]; NaN as long as it is not known.
        exceeding_ratio: Least ratio that exceeds a kink [1]; infinite without one.
    """

    def __init__(self) -> None:
        self.coefficient = math.nan
        self.exceeding_ratio = math.inf
        self._kinks: deque[float] = deque(maxlen=_MAX_KINKS)

    def add_kink(self, ratio: float, tolerance: float) -> None:
        """Add the friction ratio at which a rise ended (a possible slip); once per stance."""
        self._kinks.append(ratio)
        self._update_coefficient(tolerance)

    def drop_exceeded_kinks(self, ratio: float, tolerance: float) -> None:
        """Remove ratios that a foot has exceeded without sliding, as they were no slips."""
        held = (ratio - tolerance) / _MAX_STATIC_OVER_KINETIC
        if min(self._kinks, default=math.inf) < held:
            self._kinks = deque((kink for kink in self._kinks if kink >= held), _MAX_KINKS)
            self._update_coefficient(tolerance)

    def _update_coefficient(self, ratio_tolerance: float) -> None:
        """Estimate the coefficient as the median of the highest cluster of ratios; NaN without one."""
        ordered = sorted(self._kinks, reverse=True)
        self.exceeding_ratio = _MAX_STATIC_OVER_KINETIC * min(ordered, default=math.inf)
        self.coefficient = math.nan
        for first in range(len(ordered) - _MIN_CLUSTER + 1):
            cluster = [kink for kink in ordered[first:] if kink > ordered[first] - 2.0 * ratio_tolerance]
            if len(cluster) >= _MIN_CLUSTER:
                self.coefficient = cluster[len(cluster) // 2]
                return


class SlipDetector:
    """Slip detector of one leg, from the plateaus of its friction ratio.

    Args:
        friction: Estimate of the coefficient of friction, shared by all legs.

    Attributes:
        state: Whether the foot slides.
    """

    def __init__(self, friction: FrictionEstimator) -> None:
        self._friction = friction
        self.reset_stance()

    def reset_stance(self) -> None:
        """Reset the state of the stance, after the foot has lifted off."""
        self.state = Slip.UNKNOWN
        # Time [ns] and ratio of the latest checks with a small tolerance.
        self._ratios: deque[tuple[int, float]] = deque()
        # Checks in a row at the cone or away from it, and the time of the first of them [ns].
        self._at_cone, self._run, self._since_ns = False, 0, 0
        self._kinked = False

    def observe(self, ground: Ground, now_ns: int) -> BackDated | None:
        """Process the newest friction ratio; return the time at which a slip started or ended, else None.

        Args:
            ground: The ground below the foot.
            now_ns: Current time [ns].
        """
        ratio = ground.tangential_over_normal
        if not ground.pressing_n > _MIN_LEARNING_FORCE_N or math.isnan(ratio):
            was_slipping = self.state is Slip.SLIPPING
            self.state, self._run = Slip.UNKNOWN, 0
            return BackDated(now_ns - _SLIP_DETECTION_LAG_NS, _SLIP_TIME_SIGMA_S) if was_slipping else None
        tolerance = max(_TOLERANCE_SIGMAS * ground.tangential_over_normal_sigma, _MIN_TOLERANCE)
        if tolerance > _MAX_SLIP_TOLERANCE:
            # As in the first scan of a stance; a reported slip continues.
            self._run = 0
            if self.state is Slip.NONE:
                self.state = Slip.UNKNOWN
            return None
        ratios = self._ratios
        ratios.append((now_ns, ratio))
        while ratios[0][0] < now_ns - _PLATEAU_LOOKBACK_NS:
            ratios.popleft()
        exceeds = ratio > self._friction.exceeding_ratio
        if tolerance <= _MAX_KINK_TOLERANCE and (exceeds or not self._kinked):
            self._find_kink(tolerance, exceeds=exceeds)
        cone = self._friction.coefficient
        at_cone = ratio > cone - _MIN_TOLERANCE
        if at_cone is not self._at_cone or not self._run:
            self._at_cone, self._run, self._since_ns = at_cone, 0, now_ns
        self._run += 1
        if self.state is not Slip.SLIPPING:
            self.state = Slip.UNKNOWN if math.isnan(cone) else Slip.NONE
        if at_cone is (self.state is Slip.SLIPPING) or self._run < (
            _SLIP_STARTS_AFTER if at_cone else _SLIP_ENDS_AFTER
        ):
            return None
        self.state = Slip.SLIPPING if at_cone else Slip.NONE
        return BackDated(self._since_ns - _SLIP_DETECTION_LAG_NS, _SLIP_TIME_SIGMA_S)

    def _find_kink(self, tolerance: float, *, exceeds: bool) -> None:
        """Search the latest ratios for a rise that ends in a plateau, and report it to the friction estimator.

        Args:
            tolerance: Tolerance of a ratio [1].
            exceeds: Whether the newest ratio is above the friction cone.
        """
        ratios = self._ratios
        if len(ratios) <= _PLATEAU_CHECKS:
            return
        plateau = [ratios[place][1] for place in range(-_PLATEAU_CHECKS, 0)]
        if (
            max(plateau) - min(plateau) > tolerance
            or ratios[-1][0] - ratios[-_PLATEAU_CHECKS][0] > _PLATEAU_CHECKS * _LONGEST_CHECK_NS
        ):
            return
        level = sum(plateau) / _PLATEAU_CHECKS
        if exceeds:
            self._friction.drop_exceeded_kinks(level, tolerance)
        if (
            not self._kinked
            and level - min(ratio for _, ratio in ratios) > _MIN_KINK_RISE_TOLERANCES * tolerance
        ):
            self._kinked = True
            self._friction.add_kink(level, tolerance)
