"""Back-dating: times of touchdown and lift-off, extrapolated from the rise or fall of the load."""

import math
from collections.abc import Sequence
from itertools import islice
from operator import attrgetter, itemgetter
from typing import NamedTuple

#: Conversions that are kept: the hold of a contact, and the fall before it.
N_BUFFERED_CONVERSIONS = 40
#: Share of the load at the touchdown [1] whose passing dates it, and the loads among which it is looked for.
_PASSED_LOAD_REL, _N_SEARCHED_LOADS = 0.18, 12
#: Time from the touchdown to that passing: what the readings lag [s], and over the time since then [1]; and the spread
#: of both. Fitted to stances on rough ground, of other seeds than judge.
_LAG_S, _LAG_SIGMA_S = 4.5e-3, 2.3e-3
_FLAT_REL, _FLAT_SIGMA_REL = 0.5, 0.25
#: Shares of the largest load through which the line of a fall goes, from high to low [1].
_FIT_UPPER_LOAD_REL, _FIT_LOWER_LOAD_REL = 0.4, 0.1
#: From the end of a load to the zero of that line, of loads that are means of a whole scan, and its spread [ns], [s].
_FALL_LAG_NS, _FALL_SIGMA_S = 16_500_000, 5.5e-3


class BackDated(NamedTuple):
    """Back-dated time of an event [ns], and its standard deviation [s]."""

    t_ns: int
    sigma_s: float


class LegLoads(NamedTuple):
    """Estimated loads of all legs after one conversion, each relative to the leg's load in swing; NaN if unknown.

    Attributes:
        t_ns: Time of the estimate [ns].
        load_n: Loads as estimated for that time [N].
        scan_mean_n: Loads that are means of a scan [N].
    """

    t_ns: int
    load_n: list[float]
    scan_mean_n: list[float]


_load_of, _scan_mean_of = attrgetter("load_n"), attrgetter("scan_mean_n")


def touchdown(loads: Sequence[LegLoads], row: int) -> BackDated:
    """Return the back-dated time of a touchdown, for a leg whose load has just exceeded the threshold.

    Loads rise from nothing with a small slope: the time at which the load passed a fifth of what it is now tells how
    fast it rises, and the touchdown is half as long before. Where the estimate for the time does not show the load
    yet, the mean of the scan does.

    Args:
        loads: Last loads, oldest first.
        row: Row of the leg.

    Returns:
        A time from half as long before the searched loads as they last, to the newest of them.
    """
    newest = loads[-1]
    t_ns = newest.t_ns
    of_leg = _load_of if newest.load_n[row] > 0.0 else _scan_mean_of
    later_ns, later_n = t_ns, of_leg(newest)[row]
    passed_n = _PASSED_LOAD_REL * later_n if later_n > 0.0 else -math.inf
    for past in islice(reversed(loads), 1, 1 + _N_SEARCHED_LOADS):
        past_n = of_leg(past)[row]
        if math.isnan(past_n):
            break
        if past_n < passed_n:
            later_ns -= round((later_ns - past.t_ns) * (later_n - passed_n) / (later_n - past_n))
            break
        later_ns, later_n = past.t_ns, past_n
    since_s = (t_ns - later_ns) * 1e-9
    back_s = _LAG_S + (1.0 + _FLAT_REL) * since_s
    return BackDated(t_ns - round(back_s * 1e9), math.hypot(_LAG_SIGMA_S, _FLAT_SIGMA_REL * since_s))


def lift_off(loads: Sequence[LegLoads], row: int) -> BackDated:
    """Return the back-dated time of a lift-off, for a leg whose load has just vanished.

    The estimates for single times ring after a fall, until every element has been read again.

    Args:
        loads: Last loads, oldest first.
        row: Row of the leg.

    Returns:
        A time that is not after the newest load.
    """
    known_loads: list[tuple[int, float]] = []
    for past in reversed(loads):
        if math.isnan(past.scan_mean_n[row]):
            break
        known_loads.append((past.t_ns, past.scan_mean_n[row]))
    most_n = max(known_loads, key=itemgetter(1))[1]
    low_ns = high_ns = known_loads[-1][0]
    for t_ns, mean_n in reversed(known_loads):
        if mean_n > _FIT_LOWER_LOAD_REL * most_n:
            low_ns = t_ns
            if mean_n > _FIT_UPPER_LOAD_REL * most_n:
                high_ns = t_ns
    fall_ns = round((low_ns - high_ns) * _FIT_LOWER_LOAD_REL / (_FIT_UPPER_LOAD_REL - _FIT_LOWER_LOAD_REL))
    return BackDated(min(low_ns + fall_ns - _FALL_LAG_NS, loads[-1].t_ns), _FALL_SIGMA_S)
