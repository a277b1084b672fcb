"""Virtual time, moved by bus transactions and waits alone.

Each simulated bus has its own clock, because buses scan in parallel; the clock of the loop joins them.
"""

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
        """Move by a duration [ns], not negative."""
        self._now_ns += duration_ns


class JoinedClock:
    """The clock of the loop: a reader has waited for all buses, so that all move to the latest of them.

    Args:
        clocks: Clocks of the buses.
    """

    def __init__(self, clocks: Sequence[VirtualClock]) -> None:
        self._clocks = tuple(clocks)

    def now_ns(self) -> int:
        """Return the latest time of all bus clocks [ns], and advance every bus clock to this time."""
        latest_ns = max(clock.now_ns() for clock in self._clocks)
        self.sleep_until_ns(latest_ns)
        return latest_ns

    def sleep_until_ns(self, t_ns: int) -> None:
        """Move every bus to `t_ns` [ns]."""
        for clock in self._clocks:
            clock.sleep_until_ns(t_ns)
