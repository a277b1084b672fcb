"""What faults may cost in a walk: when a leg may be without a force, and by how much a frame may be late."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from footsense.sim.faults.scene_faults import ArbitrationLost, CanFault, Fault, StuckSda, StuckUpstreamBus

__all__ = ["Rules", "Spans", "excused_s", "gap_costs_s"]

#: Longest pause after which a leg is tried again [s], and one that held a line of the bus; what a try takes beyond,
#: and in how many steps it is tared after it.
_PAUSE_S, _HOLDER_PAUSE_S, _TRY_S, _STEPS = 4.0, 16.0, 1.0, 3.0
#: Time without a force that an adapter's timeouts cost, for each leg that holds the bus, and beyond a scan that is read
#: anew where that takes longer [s]; and in all where the trunk itself is held [s].
_HOLDER_COSTS_S, _TIMEOUTS_COST_S, _TRUNK_COSTS_S = 0.085, 0.06, 0.45
#: What it costs a leg that the same transaction lost twice [s], or in scans: that one, and two more until its elements
#: can be brought to one time again.
_ARBITRATION_COSTS_S, _ARBITRATION_COSTS_SCANS = 0.08, 3.3


class Rules(NamedTuple):
    """What the walk is held to.

    Attributes:
        legs: Names of the legs.
        period_s: From one frame to the next if all is well [s].
        max_age_s: Age limit of a force [s].
        gait_period_s: A leg is in the air once in this time [s].
        from_s: When every leg is tared [s].
        stands_s: Spans in which no leg is ever in the air [s].
        element: Whether a force is as of its sending.
        bitrate: Of CAN [bit/s].
    """

    legs: tuple[str, ...]
    period_s: float
    max_age_s: float
    gait_period_s: float
    from_s: float
    stands_s: tuple[tuple[float, float], ...] = ()
    element: bool = False
    bitrate: int = 500_000


class Spans:
    """Spans of time that are asked for in their order.

    Args:
        spans_s: From when until when, in their order and apart [s].
    """

    def __init__(self, spans_s: Sequence[tuple[float, float]]) -> None:
        self._spans_s = tuple(spans_s)
        self._next = 0

    def hold(self, t_s: float) -> bool:
        """Tell whether a time, not before the last one asked for, lies in one of them."""
        while self._next < len(self._spans_s) and self._spans_s[self._next][1] < t_s:
            self._next += 1
        return self._next < len(self._spans_s) and self._spans_s[self._next][0] <= t_s


def excused_s(rules: Rules, script: Sequence[Fault], leg: str) -> list[tuple[float, float]]:
    """Return when a leg may be without a force [s]: while something is broken, and until it is surely found again.

    A leg that was left out is tried again after pauses that double: it waits no longer than it was broken.
    """
    spans: list[tuple[float, float]] = []
    for fault in sorted(script, key=lambda fault: fault.at_s):
        if isinstance(fault, CanFault | ArbitrationLost) or getattr(fault, "leg", leg) != leg:
            continue
        begins_s = spans[-1][0] if spans and fault.at_s <= spans[-1][1] else fault.at_s
        until_s = max(getattr(fault, "until_s", None) or fault.at_s, fault.at_s)
        longest_s = _HOLDER_PAUSE_S if isinstance(fault, StuckSda | StuckUpstreamBus) else _PAUSE_S
        recovery_s = min(until_s - begins_s, longest_s) + _TRY_S + _STEPS * rules.gait_period_s
        later_s = _later_s(rules, until_s, recovery_s)
        if spans and fault.at_s <= spans[-1][1]:
            spans[-1] = (begins_s, max(spans[-1][1], later_s))
        else:
            spans.append((begins_s, later_s))
    return spans


def _later_s(rules: Rules, t_s: float, walking_s: float) -> float:
    """Return when a robot that walks, and does not stand, has done so for some time after `t_s` [s]."""
    later_s = t_s + walking_s
    for from_s, until_s in rules.stands_s:
        # It comes to a stand, and leaves it, with the legs in the middle of their stance.
        ends_s = until_s + 2.0 * rules.gait_period_s
        if from_s < later_s and t_s < ends_s:
            later_s += ends_s - max(from_s, t_s)
    return later_s


def gap_costs_s(script: Sequence[Fault], period_s: float) -> list[tuple[float, float, float]]:
    """Return from when until when a bus that is held may cost how much time [s], in the order of their ends.

    Args:
        script: What breaks.
        period_s: From one frame to the next if all is well [s].
    """
    holder_s = max(_HOLDER_COSTS_S, _TIMEOUTS_COST_S + period_s)
    arbitration_s = max(_ARBITRATION_COSTS_S, _ARBITRATION_COSTS_SCANS * period_s)
    costs = []
    for fault in script:
        if isinstance(fault, StuckSda | StuckUpstreamBus):
            until_s = fault.until_s if fault.until_s is not None else np.inf
            cost_s = holder_s if isinstance(fault, StuckSda) else _TRUNK_COSTS_S
            costs.append((fault.at_s, until_s + _HOLDER_PAUSE_S + _TRY_S, cost_s))
        elif isinstance(fault, ArbitrationLost):
            costs.append((fault.at_s, (fault.until_s or np.inf) + arbitration_s, arbitration_s))
    return sorted(costs, key=lambda cost: cost[1])
