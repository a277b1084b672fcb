"""Virtual time: it moves only when a bus transaction or a wait moves it.

Each simulated bus has a clock of its own, because buses scan side by side; the loop's clock joins them.
"""

from collections.abc import Sequence


class VirtualClock:
    """The time of one bus."""

    def __init__(self) -> None:
        self._now_ns = 0

    def now_ns(self) -> int:
        """Return the virtual time [ns]."""
        return self._now_ns

    def sleep_until_ns(self, t_ns: int) -> None:
        """Move on to `t_ns`; time never goes back."""
        self._now_ns = max(self._now_ns, t_ns)

    def advance_ns(self, duration_ns: int) -> None:
        """Move on by `duration_ns`, which is not negative."""
        self._now_ns += duration_ns


class JoinedClock:
    """The loop's time: whoever asks for it has waited for all buses, so they all stand at the latest of them."""

    def __init__(self, clocks: Sequence[VirtualClock]) -> None:
        self._clocks = tuple(clocks)

    def now_ns(self) -> int:
        """Return the time at which every bus is ready [ns]."""
        latest_ns = max(clock.now_ns() for clock in self._clocks)
        self.sleep_until_ns(latest_ns)
        return latest_ns

    def sleep_until_ns(self, t_ns: int) -> None:
        """Move every bus on to `t_ns`."""
        for clock in self._clocks:
            clock.sleep_until_ns(t_ns)
