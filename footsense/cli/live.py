"""Displays of the main loop on a terminal: redrawn pictures, the table of `footsense run`, a progress bar."""

import logging
import math
from abc import ABC, abstractmethod
from collections.abc import Callable

import numpy as np
from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.logging import RichHandler
from rich.progress_bar import ProgressBar
from rich.text import Text

from footsense.cli.tables import Column, force_column, state_column, table
from footsense.frames import IS_USABLE_STATE, Cycle, State, Vector
from footsense.ports import Observer

_NS_PER_S = 1_000_000_000
_TABLE_REDRAW_PERIOD_NS = 66_000_000
_BAR_WIDTH_CELLS = 10
_BAR_FULL_SCALE_N = 1.2


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


class LiveTable(LiveView):
    """Observer that redraws the table of the legs fifteen times a second.

    Args:
        console: Terminal to draw on.
        legs: Names of the legs in the order of the frames' rows.
        title: Source of the frames.
        true_force_n_at: True force on every foot at a time [ns], shape (legs, 3) [N]; None on a real robot.
        url: Address of the page; empty without one.
    """

    def __init__(
        self,
        console: Console,
        legs: tuple[str, ...],
        title: str,
        true_force_n_at: Callable[[int], Vector] | None,
        url: str = "",
    ) -> None:
        super().__init__(console, _TABLE_REDRAW_PERIOD_NS)
        self._legs = legs
        self._title = title
        self._true_force_n_at = true_force_n_at
        self._url = url

    def render(self, cycle: Cycle, elapsed_s: float) -> Group:
        """Return the title and the table of the legs, for a terminal of 80 columns."""
        forces = cycle.forces
        usable = IS_USABLE_STATE[forces.state]
        force_n = np.where(usable[:, None], forces.force_n, np.nan)
        age_ms = np.where(usable, forces.age_ns * 1e-6, np.nan).tolist()
        columns: list[Column[int]] = [
            Column("leg", lambda row: self._legs[row], "<3"),
            state_column(lambda row: State(int(forces.state[row]))),
            force_column("force_n", lambda row: force_n[row].tolist()),
            Column(
                "load",
                lambda row: usable[row],
                f"<{_BAR_WIDTH_CELLS}",
                cell=lambda row: _force_bar(force_n[row, 2]),
            ),
        ]
        if self._true_force_n_at is not None:
            true_n = self._true_force_n_at(forces.t_sent_ns)
            columns.append(Column("true_n", lambda row: true_n[row, 2], ">8.3f", style=lambda _: "dim"))
        columns.append(Column("age_ms", lambda row: age_ms[row], ">8.1f"))
        head = Text.assemble(("footsense  ", "bold"), self._title, (f"   {elapsed_s:5.1f} s", "dim"))
        head.append(*((f"   {self._url}", "cyan") if self._url else (f"   cycle {forces.sequence}", "dim")))
        return Group(head, Text(), table(columns, range(len(self._legs))))


def _force_bar(force_n: float) -> ProgressBar | str:
    if math.isnan(force_n):
        return ""
    return ProgressBar(
        _BAR_FULL_SCALE_N,
        max(force_n, 0.0),
        width=_BAR_WIDTH_CELLS,
        complete_style="cyan",
        finished_style="cyan",
    )


class SimulationProgress(Observer):
    """Observer that tells a progress bar each new second of simulated time.

    Args:
        start_ns: Time at the start [ns].
        seconds_done: Function of the bar that takes the time done [s].
    """

    def __init__(self, start_ns: int, seconds_done: Callable[[float], None]) -> None:
        self._start_ns = start_ns
        self._shown_s = 0
        self._seconds_done = seconds_done

    def observe(self, cycle: Cycle) -> None:
        """Update the progress bar at each new second of simulated time."""
        now_s = (cycle.forces.t_sent_ns - self._start_ns) // _NS_PER_S
        if now_s != self._shown_s:
            self._shown_s = now_s
            self._seconds_done(now_s)
