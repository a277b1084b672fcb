"""Virtual time, moved by bus transactions and waits alone.

Each simulated bus has its own clock, because buses scan in parallel; the clock of the loop joins them.
"""

import math
from collections.abc import Sequence


class VirtualClock:
    """The clock of one bus; begins at 0."""

    def __init__(self) -> None:
        self._now_ns = 0

    def now_ns(self) -> int:
        """Return the virtual time [ns]."""
        return self._now_ns

    def sleep_until_ns(self, t_ns: int) -> None:
        """Advance to `t_ns` [ns]; an earlier time changes nothing."""
        self._now_ns = max(self._now_ns, t_ns)

    def advance_ns(self, duration_ns: int) -> None:
        """Advance the virtual time by a duration [ns], not negative."""
        self._now_ns += duration_ns


class JoinedClock:
    """Clock of the loop over several simulated buses: it shows the latest of the buses' times.

    Args:
        clocks: Clocks of the buses.
        grace_ns: A bus that is ahead of the first one by more was not waited for [ns].
    """

    def __init__(self, clocks: Sequence[VirtualClock], grace_ns: float = math.inf) -> None:
        self._clocks = tuple(clocks)
        self._grace_ns = grace_ns

    def now_ns(self) -> int:
        """Return the latest time of the buses that were waited for [ns], and advance the others to this time."""
        times_ns = [clock.now_ns() for clock in self._clocks]
        limit_ns = min(times_ns) + self._grace_ns
        latest_ns = max(t_ns for t_ns in times_ns if t_ns <= limit_ns)
        self.sleep_until_ns(latest_ns)
        return latest_ns

    def sleep_until_ns(self, t_ns: int) -> None:
        """Move every bus to `t_ns` [ns]."""
        for clock in self._clocks:
            clock.sleep_until_ns(t_ns)
