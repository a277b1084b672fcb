"""Virtual time: it advances only by simulated bus transactions and by waits.

Each simulated bus has its own clock, because buses scan in parallel; the clock of the loop joins them.
"""

import math
from collections.abc import Sequence


class VirtualClock:
    """Virtual clock of one simulated bus; it starts at 0 ns."""

    def __init__(self) -> None:
        self._now_ns = 0

    def now_ns(self) -> int:
        """Return the virtual time [ns]."""
        return self._now_ns

    def sleep_until_ns(self, t_ns: int) -> None:
        """Advance the virtual time to `t_ns` [ns]; no effect if that is in the past."""
        self._now_ns = max(self._now_ns, t_ns)

    def advance_ns(self, duration_ns: int) -> None:
        """Advance the virtual time by a non-negative duration [ns]."""
        self._now_ns += duration_ns


class JoinedClock:
    """Clock of the main loop over several simulated buses: it shows the latest time of the buses.

    Args:
        clocks: Clocks of the buses.
        grace_ns: A bus that is ahead of the first one by more was not waited for [ns].
    """

    def __init__(self, clocks: Sequence[VirtualClock], grace_ns: float = math.inf) -> None:
        self._clocks = tuple(clocks)
        self._grace_ns = grace_ns

    def now_ns(self) -> int:
        """Return the latest time of the buses within the grace period [ns], and advance every bus to it."""
        times_ns = [clock.now_ns() for clock in self._clocks]
        limit_ns = min(times_ns) + self._grace_ns
        latest_ns = max(t_ns for t_ns in times_ns if t_ns <= limit_ns)
        self.sleep_until_ns(latest_ns)
        return latest_ns

    def sleep_until_ns(self, t_ns: int) -> None:
        """Advance every bus to `t_ns` [ns]."""
        for clock in self._clocks:
            clock.sleep_until_ns(t_ns)
