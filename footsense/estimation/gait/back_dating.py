"""Times of touchdown and lift-off, back-dated along the rise and the fall of the load."""

import math
from collections import deque
from typing import NamedTuple

#: Loads that are kept: the hold of a contact, and the fall before it.
_KEPT = 40
#: Earlier loads to which the slope of a rise is taken.
_SLOPES = 9
#: From a change of the load to the first reading that shows it, on average, and its spread [s].
_LAG_S, _LAG_SIGMA_S = 4.6e-3, 1.5e-3
#: Rises begin flat: time before the line's zero over the time from there on [1], and the spread of that.
_FLAT_REL, _FLAT_SIGMA_REL = 0.6, 0.5
#: Longest way back, beyond the lag [s].
_LONGEST_S = 0.03
#: Shares of the largest load through which the line of a fall goes, from high to low [1].
_HIGH_REL, _LOW_REL = 0.4, 0.1
#: From the end of a load to the zero of that line, of loads that are means of a whole scan, and its spread [ns], [s].
_FALL_LAG_NS, _FALL_SIGMA_S = 16_500_000, 5.5e-3


class BackDated(NamedTuple):
    """A time [ns] and its standard deviation [s]."""

    t_ns: int
    sigma_s: float


class BackDating:
    """The last loads of one leg, and the times at which they began and ended."""

    def __init__(self) -> None:
        self._loads: deque[tuple[int, float, float]] = deque(maxlen=_KEPT)

    def clear(self) -> None:
        """Forget the loads."""
        self._loads.clear()

    def add(self, t_ns: int, load_n: float, mean_n: float) -> None:
        """Add a time [ns] and two loads above the floor [N]: as estimated for that time, and the mean of a scan."""
        self._loads.append((t_ns, load_n, mean_n))

    def touchdown(self) -> BackDated:
        """Return when the load began that is above the threshold for the first time.

        The steepest line through the newest load and an earlier one meets zero after the touchdown: loads rise from
        nothing with a small slope.
        """
        loads = self._loads
        t_ns, load_n, _ = loads[-1]
        since_s = _LONGEST_S
        for past_ns, past_n, _ in list(loads)[-1 - _SLOPES : -1]:
            if load_n > past_n:
                since_s = min(since_s, load_n * (t_ns - past_ns) * 1e-9 / (load_n - past_n))
        back_s = _LAG_S + (1.0 + _FLAT_REL) * max(since_s, 0.0)
        return BackDated(t_ns - round(back_s * 1e9), math.hypot(_LAG_SIGMA_S, _FLAT_SIGMA_REL * since_s))

    def lift_off(self) -> BackDated:
        """Return when the load ended, which is gone now: the means of a scan fall as a line, and late.

        The estimates for single times ring after a fall, until every element has been read again.
        """
        loads = self._loads
        most_n = max(mean_n for _, _, mean_n in loads)
        high_ns = low_ns = loads[0][0]
        for t_ns, _, mean_n in loads:
            if mean_n > _LOW_REL * most_n:
                low_ns = t_ns
                if mean_n > _HIGH_REL * most_n:
                    high_ns = t_ns
        fall_ns = round((low_ns - high_ns) * _LOW_REL / (_HIGH_REL - _LOW_REL))
        return BackDated(low_ns + fall_ns - _FALL_LAG_NS, _FALL_SIGMA_S)
