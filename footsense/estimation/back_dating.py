"""Back-dating: times of touchdown, extrapolated from the rise of the load, and of lift-off."""

import math
from collections.abc import Sequence
from itertools import islice
from operator import attrgetter
from typing import NamedTuple

#: Share of the load at the touchdown [1] whose passing dates it, and the loads among which it is looked for.
_PASSED_LOAD_REL, _N_SEARCHED_LOADS = 0.4, 12
#: Time from the touchdown to the contact: a constant [s], and over the time since that passing [1]; and the spread of
#: both. Fitted to 1577 touches of the walkers' selection, without hops and landings.
_LAG_S, _LAG_SIGMA_S = 8.7e-3, 3.0e-3
_SINCE_REL, _SINCE_SIGMA_REL = 0.7, 0.4
#: Conversions that are kept.
N_BUFFERED_CONVERSIONS = 1 + _N_SEARCHED_LOADS
#: Time from the end of a load to the end of the contact [ns], and its spread [s]; of the same touches.
_FALL_LAG_NS, _FALL_SIGMA_S = 24_000_000, 5.5e-3


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

    Loads rise from nothing with a small slope: the time at which the load passed two fifths of what it is now tells how
    fast it rises. Where the estimate for the time does not show the load yet, the mean of the scan does.

    Args:
        loads: Last loads, oldest first.
        row: Row of the leg.

    Returns:
        A time within the searched loads and `_LAG_S` before.
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
    back_s = _LAG_S + _SINCE_REL * since_s
    return BackDated(t_ns - round(back_s * 1e9), math.hypot(_LAG_SIGMA_S, _SINCE_SIGMA_REL * since_s))


def lift_off(t_ns: int) -> BackDated:
    """Return the back-dated time of a lift-off that is told now [ns].

    The same time before, whatever the load did: a line through its fall spreads more.
    """
    return BackDated(t_ns - _FALL_LAG_NS, _FALL_SIGMA_S)
