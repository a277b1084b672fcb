"""Times of touchdown and lift-off, back-dated along the rise and the fall of the load."""

import math
from collections import deque
from typing import NamedTuple

#: Loads that are kept: the hold of a contact, a scan, and the flank before it.
_KEPT = 24
#: Earlier loads to which the slope of a rise is taken.
_SLOPES = 9
#: From a change of the load to the first reading that shows it, on average, and its spread [s].
_LAG_S, _LAG_SIGMA_S = 4.6e-3, 1.5e-3
#: Rises begin flat: time before the line's zero over the time from there on [1], and the spread of that.
_FLAT_REL, _FLAT_SIGMA_REL = 0.6, 0.5
#: Longest way back, beyond the lag [s].
_LONGEST_S = 0.03


class BackDated(NamedTuple):
    """A time [ns] and its standard deviation [s]."""

    t_ns: int
    sigma_s: float


class BackDating:
    """The last loads of one leg, and the times at which they began and ended."""

    def __init__(self) -> None:
        self._loads: deque[tuple[int, float]] = deque(maxlen=_KEPT)

    def clear(self) -> None:
        """Forget the loads."""
        self._loads.clear()

    def add(self, t_ns: int, load_n: float) -> None:
        """Add the load above the floor [N] at a time [ns]."""
        self._loads.append((t_ns, load_n))

    def touchdown(self) -> BackDated:
        """Return when the load began that is above the threshold for the first time.

        The steepest line through the newest load and an earlier one meets zero after the touchdown: loads rise from
        nothing with a small slope.
        """
        loads = self._loads
        t_ns, load_n = loads[-1]
        since_s = _LONGEST_S
        for past_ns, past_n in list(loads)[-1 - _SLOPES : -1]:
            if load_n > past_n:
                since_s = min(since_s, load_n * (t_ns - past_ns) * 1e-9 / (load_n - past_n))
        back_s = _LAG_S + (1.0 + _FLAT_REL) * max(since_s, 0.0)
        return BackDated(t_ns - round(back_s * 1e9), math.hypot(_LAG_SIGMA_S, _FLAT_SIGMA_REL * since_s))

    def lift_off(self, threshold_n: float) -> BackDated:
        """Return when the load ended that has been below a threshold [N] since."""
        loads = self._loads
        end_ns, before_ns = loads[0][0], 0
        for t_ns, load_n in loads:
            if load_n > threshold_n:
                end_ns, before_ns = t_ns, end_ns
        step_s = (end_ns - before_ns) * 1e-9 if before_ns else _LONGEST_S
        return BackDated(end_ns, math.hypot(_LAG_SIGMA_S, min(step_s, _LONGEST_S)))
