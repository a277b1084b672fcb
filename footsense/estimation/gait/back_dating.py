"""Times of touchdown and lift-off, back-dated along the rise and the fall of the load."""

import math
from collections.abc import Sequence
from itertools import islice
from operator import itemgetter
from typing import NamedTuple

#: Conversions that are kept: the hold of a contact, and the fall before it.
KEPT = 40
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


class Loads(NamedTuple):
    """Loads of all legs at one conversion, each above the leg's floor, NaN where one is not known.

    Attributes:
        t_ns: Time of the estimate [ns].
        load_n: Loads as estimated for that time [N].
        mean_n: Loads that are means of a scan [N].
    """

    t_ns: int
    load_n: list[float]
    mean_n: list[float]


def touchdown(loads: Sequence[Loads], row: int) -> BackDated:
    """Return when the load of a leg began that is above the threshold for the first time.

    The steepest line through the newest load and an earlier one meets zero after the touchdown: loads rise from nothing
    with a small slope.

    Args:
        loads: Last loads, oldest first.
        row: Row of the leg.
    """
    t_ns, load_n = loads[-1].t_ns, loads[-1].load_n[row]
    since_s = _LONGEST_S
    for past in islice(reversed(loads), 1, 1 + _SLOPES):
        past_n = past.load_n[row]
        if math.isnan(past_n):
            break
        if load_n > past_n:
            since_s = min(since_s, load_n * (t_ns - past.t_ns) * 1e-9 / (load_n - past_n))
    back_s = _LAG_S + (1.0 + _FLAT_REL) * max(since_s, 0.0)
    return BackDated(t_ns - round(back_s * 1e9), math.hypot(_LAG_SIGMA_S, _FLAT_SIGMA_REL * since_s))


def lift_off(loads: Sequence[Loads], row: int) -> BackDated:
    """Return when the load of a leg ended, which is gone now: the means of a scan fall as a line, and late.

    The estimates for single times ring after a fall, until every element has been read again.

    Args:
        loads: Last loads, oldest first.
        row: Row of the leg.
    """
    known: list[tuple[int, float]] = []
    for past in reversed(loads):
        if math.isnan(past.mean_n[row]):
            break
        known.append((past.t_ns, past.mean_n[row]))
    most_n = max(known, key=itemgetter(1))[1]
    low_ns = high_ns = known[-1][0]
    for t_ns, mean_n in reversed(known):
        if mean_n > _LOW_REL * most_n:
            low_ns = t_ns
            if mean_n > _HIGH_REL * most_n:
                high_ns = t_ns
    fall_ns = round((low_ns - high_ns) * _LOW_REL / (_HIGH_REL - _LOW_REL))
    return BackDated(low_ns + fall_ns - _FALL_LAG_NS, _FALL_SIGMA_S)
