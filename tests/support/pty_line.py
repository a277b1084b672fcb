"""A pseudo-terminal that can be unplugged, and a clock that does not wait for it."""

import os
import pty
import tty
from pathlib import Path

from footsense.clock import MonotonicClock

__all__ = ["HurriedClock", "Line"]


class Line:
    """A pseudo-terminal under a name that stays, as by-id names do.

    Args:
        name: The name.
    """

    def __init__(self, name: Path) -> None:
        self.name = name
        self._ends: tuple[int, ...] = ()

    def plug(self) -> int:
        """Connect a new device, and return its own end."""
        self._ends = pty.openpty()
        tty.setraw(self._ends[1])
        self.name.symlink_to(os.ttyname(self._ends[1]))
        return self._ends[0]

    def unplug(self) -> None:
        """Take the device away."""
        for end in self._ends:
            os.close(end)
        self._ends = ()
        self.name.unlink(missing_ok=True)


class HurriedClock(MonotonicClock):
    """Sleeps in no time: it is the later afterwards."""

    def __init__(self) -> None:
        super().__init__()
        self._ahead_ns = 0

    def now_ns(self) -> int:
        return super().now_ns() + self._ahead_ns

    def sleep_until_ns(self, t_ns: int) -> None:
        self._ahead_ns += max(0, t_ns - self.now_ns())
