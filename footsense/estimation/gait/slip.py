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

from footsense.estimation.gait.frame import Slip
from footsense.estimation.gait.ground import Ground

#: Conversions of a plateau, and of the rise before it.
_PLATEAU, _RISE = 7, 8
#: Tolerance of a ratio in standard deviations, its least [1], and those up to which it tells of a slip, and teaches.
_SIGMAS, _LEAST, _TELLING, _TEACHING = 1.5, 0.02, 0.06, 0.045
#: Rise of a kink in tolerances.
_RISE_TOLERANCES = 2.0
#: Kinks that are remembered, and those at one ratio that make a cone.
_REMEMBERED, _ENOUGH = 30, 5
#: Static over kinetic friction at most [1].
_STATIC_REL = 1.2
#: Conversions at the cone until a slip is said, and away from it until it is over.
_SAID, _OVER = 3, 5
#: Normal force from which friction is learnt [N].
_FIRM_N = 0.15


class Friction:
    """The friction of the ground, as the slips of all legs teach it.

    Attributes:
        coefficient: Coefficient of kinetic friction [1]; NaN as long as it is not known.
    """

    def __init__(self) -> None:
        self.coefficient = math.nan
        self._kinks: deque[float] = deque(maxlen=_REMEMBERED)

    def kink(self, ratio: float, tolerance: float) -> None:
        """Add the ratio at which a rise ended; one for each stance."""
        self._kinks.append(ratio)
        self._learn(tolerance)

    def exceed(self, ratio: float, tolerance: float) -> None:
        """Drop the kinks that a foot has exceeded without sliding: it sustains this ratio."""
        held = (ratio - tolerance) / _STATIC_REL
        if any(kink < held for kink in self._kinks):
            self._kinks = deque((kink for kink in self._kinks if kink >= held), _REMEMBERED)
            self._learn(tolerance)

    def _learn(self, tolerance: float) -> None:
        ordered = sorted(self._kinks, reverse=True)
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
        self._ratios: deque[float] = deque(maxlen=_PLATEAU + _RISE)
        self._at_cone = self._off_cone = 0
        self._kinked = False

    def observe(self, ground: Ground) -> bool:
        """Follow the friction by one conversion, and return whether a slip begins."""
        use = ground.friction_use
        if not ground.pressing_n > _FIRM_N or math.isnan(use):
            if self._ratios:
                self.lift()
            return False
        tolerance = max(_SIGMAS * ground.friction_use_sigma, _LEAST)
        if tolerance > _TELLING:
            # As in the first scan of a stance; a slide that was said goes on.
            self._ratios.clear()
            self._at_cone = 0
            if self.state is Slip.NONE:
                self.state = Slip.UNKNOWN
            return False
        self._ratios.append(use)
        if tolerance <= _TEACHING and len(self._ratios) == _PLATEAU + _RISE:
            self._look(tolerance)
        cone = self._friction.coefficient
        if use > cone - tolerance:
            self._at_cone += 1
            self._off_cone = 0
        else:
            self._off_cone += 1
            self._at_cone = 0
        if self.state is Slip.SLIPPING:
            if self._off_cone >= _OVER:
                self.state = Slip.NONE
            return False
        self.state = Slip.UNKNOWN if math.isnan(cone) else Slip.NONE
        if self._at_cone < _SAID:
            return False
        self.state = Slip.SLIPPING
        return True

    def _look(self, tolerance: float) -> None:
        """Look for a kink, and for a ratio above the cone."""
        ratios = list(self._ratios)
        plateau = ratios[_RISE:]
        least, most = min(plateau), max(plateau)
        if self._kinked or most - least > tolerance:
            return
        level = sum(plateau) / _PLATEAU
        self._friction.exceed(level, tolerance)
        if level - min(ratios[:_RISE]) > _RISE_TOLERANCES * tolerance:
            self._kinked = True
            self._friction.kink(level, tolerance)
