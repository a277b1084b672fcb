"""Live display of the main loop on a terminal."""

import logging
from abc import ABC, abstractmethod

from rich.console import Console, RenderableType
from rich.live import Live
from rich.logging import RichHandler

from footsense.frames import Cycle


class LiveView(ABC):
    """Observer that redraws a display on the terminal at most every `period_ns` of the frames' time.

    Args:
        console: Terminal to draw on; journal lines go above the picture instead of through it.
        period_ns: Least time between two pictures [ns].
    """

    def __init__(self, console: Console, period_ns: int) -> None:
        self._period_ns = period_ns
        self._start_ns: int | None = None
        self._drawn_ns = -period_ns
        self._live = Live(console=console, auto_refresh=False)
        self._live.start()
        self._journal = logging.getLogger().handlers
        logging.getLogger().handlers = [RichHandler(console=console, show_time=False, show_path=False)]

    @abstractmethod
    def render(self, cycle: Cycle, elapsed_s: float) -> RenderableType:
        """Return the display after a cycle; `elapsed_s` counts from the first cycle."""

    def observe(self, cycle: Cycle) -> None:
        """Redraw the display if the redraw period has passed."""
        t_ns = cycle.forces.t_sent_ns
        if self._start_ns is None:
            self._start_ns = t_ns
        if t_ns - self._drawn_ns >= self._period_ns:
            self._drawn_ns = t_ns
            self._live.update(self.render(cycle, (t_ns - self._start_ns) * 1e-9), refresh=True)

    def close(self) -> None:
        """Stop redrawing, and leave the last display on the terminal."""
        self._live.stop()
        logging.getLogger().handlers = self._journal
