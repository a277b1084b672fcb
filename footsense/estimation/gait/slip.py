"""Slip of the feet, told by the friction ratio alone, and the coefficient of friction that slips teach.

A foot that sticks may have any ratio of tangential to normal force up to the coefficient of friction; one that slides
has that of the ground, whatever load and direction do. So a slide begins as a kink: the ratio rises, and stays. A push
of the body that ends looks the same, but at a ratio of its own each time, and one that a later stance exceeds. Kinks at
one ratio, of several stances, which nothing exceeds, are the cone of the ground. From then on a foot slides where its
ratio comes to the cone. A slope alone has no kink: its ratio is there from the touchdown on.

What the ratio cannot tell is a foot that sticks at the cone from one that slides there: both are said to slip.
"""

import math
from collections import deque

from footsense.estimation.gait.back_dating import BackDated
from footsense.estimation.gait.ground import Ground
from footsense.frames import Slip

#: Every second conversion is looked at: the next one sees mostly the same readings.
TURNS = 2
#: Looks of a plateau, and the longest time between the first of two looks of it [ns].
_PLATEAU, _LOOK_NS = 4, 8_000_000
#: Time before a plateau in which the ratio may have risen to it [ns]: a slide that begins suddenly is not clear at
#: first.
_RISE_NS = 120_000_000
#: Tolerance of a ratio in standard deviations, its least [1], and those up to which it tells of a slip, and teaches.
_SIGMAS, _LEAST, _TELLING, _TEACHING = 1.5, 0.02, 0.12, 0.045
#: Rise of a kink in tolerances.
_RISE_TOLERANCES = 3.0
#: Kinks that are remembered, and those at one ratio that make a cone.
_REMEMBERED, _ENOUGH = 30, 4
#: Static over kinetic friction at most [1].
_STATIC_REL = 1.2
#: Looks at the cone until a slip is said, and away from it until it is over.
_SAID, _OVER = 2, 3
#: Normal force from which friction is learnt [N].
_FIRM_N = 0.15
#: From the beginning or end of a slip to the first estimate that shows it [ns].
_LAG_NS = 9_600_000
#: Standard deviation of the time of a slip [s].
_SIGMA_S = 0.01


class Friction:
    """The friction of the ground, as the slips of all legs teach it.

    Attributes:
        coefficient: Coefficient of kinetic friction [1]; NaN as long as it is not known.
        exceeding: Least ratio that exceeds a kink [1]; infinite without one.
    """

    def __init__(self) -> None:
        self.coefficient = math.nan
        self.exceeding = math.inf
        self._kinks: deque[float] = deque(maxlen=_REMEMBERED)

    def kink(self, ratio: float, tolerance: float) -> None:
        """Add the ratio at which a rise ended; one for each stance."""
        self._kinks.append(ratio)
        self._learn(tolerance)

    def exceed(self, ratio: float, tolerance: float) -> None:
        """Drop the kinks that a foot has exceeded without sliding: it sustains this ratio."""
        held = (ratio - tolerance) / _STATIC_REL
        if min(self._kinks, default=math.inf) < held:
            self._kinks = deque((kink for kink in self._kinks if kink >= held), _REMEMBERED)
            self._learn(tolerance)

    def _learn(self, tolerance: float) -> None:
        ordered = sorted(self._kinks, reverse=True)
        self.exceeding = _STATIC_REL * min(ordered, default=math.inf)
        self.coefficient = math.nan
        for first in range(len(ordered) - _ENOUGH + 1):
            cluster = [kink for kink in ordered[first:] if kink > ordered[first] - 2.0 * tolerance]
            if len(cluster) >= _ENOUGH:
                self.coefficient = cluster[len(cluster) // 2]
                return


class SlipDetector:
    """Slip of one leg.

    Args:
        friction: What all legs learn.

    Attributes:
        state: Whether the foot slides.
    """

    def __init__(self, friction: Friction) -> None:
        self._friction = friction
        self.lift()

    def lift(self) -> None:
        """Forget the stance: the foot is in the air."""
        self.state = Slip.UNKNOWN
        # Time [ns] and ratio of the clear looks of late.
        self._ratios: deque[tuple[int, float]] = deque()
        # Looks at the cone or away from it, and the time of the first of them [ns].
        self._at_cone, self._run, self._since_ns = False, 0, 0
        self._kinked = False

    def observe(self, ground: Ground, now_ns: int) -> BackDated | None:
        """Look at the friction, and return when the slip began or ended that begins or ends with this look.

        Args:
            ground: The ground below the foot.
            now_ns: Current time [ns].
        """
        use = ground.friction_use
        if not ground.pressing_n > _FIRM_N or math.isnan(use):
            was_slipping = self.state is Slip.SLIPPING
            self.state, self._run = Slip.UNKNOWN, 0
            return BackDated(now_ns - _LAG_NS, _SIGMA_S) if was_slipping else None
        tolerance = max(_SIGMAS * ground.friction_use_sigma, _LEAST)
        if tolerance > _TELLING:
            # As in the first scan of a stance; a slide that was said goes on.
            self._run = 0
            if self.state is Slip.NONE:
                self.state = Slip.UNKNOWN
            return None
        ratios = self._ratios
        ratios.append((now_ns, use))
        while ratios[0][0] < now_ns - _RISE_NS:
            ratios.popleft()
        if tolerance <= _TEACHING:
            self._learn(tolerance)
        cone = self._friction.coefficient
        at_cone = use > cone - _LEAST
        if at_cone is not self._at_cone or not self._run:
            self._at_cone, self._run, self._since_ns = at_cone, 0, now_ns
        self._run += 1
        if self.state is not Slip.SLIPPING:
            self.state = Slip.UNKNOWN if math.isnan(cone) else Slip.NONE
        if at_cone is (self.state is Slip.SLIPPING) or self._run < (_SAID if at_cone else _OVER):
            return None
        self.state = Slip.SLIPPING if at_cone else Slip.NONE
        return BackDated(self._since_ns - _LAG_NS, _SIGMA_S)

    def _learn(self, tolerance: float) -> None:
        """Look for a kink, and for a ratio above the cone."""
        ratios = self._ratios
        exceeds = ratios[-1][1] > self._friction.exceeding
        if len(ratios) <= _PLATEAU or (self._kinked and not exceeds):
            return
        plateau = [ratios[place][1] for place in range(-_PLATEAU, 0)]
        if (
            max(plateau) - min(plateau) > tolerance
            or ratios[-1][0] - ratios[-_PLATEAU][0] > _PLATEAU * _LOOK_NS
        ):
            return
        level = sum(plateau) / _PLATEAU
        if exceeds:
            self._friction.exceed(level, tolerance)
        if not self._kinked and level - min(ratio for _, ratio in ratios) > _RISE_TOLERANCES * tolerance:
            self._kinked = True
            self._friction.kink(level, tolerance)
