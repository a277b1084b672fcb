"""Displays of the main loop on a terminal: redrawn pictures, and the table of `footsense run`."""

import logging
import math
from collections.abc import Callable

import numpy as np
from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.logging import RichHandler
from rich.progress_bar import ProgressBar
from rich.text import Text

from footsense.cli.tables import (
    Column,
    contact_column,
    fitting,
    force_columns,
    left_out_text,
    state_column,
    table,
)
from footsense.frames import IS_USABLE_STATE, Cause, Cycle, Flag, State, Vector
from footsense.leg_words import word_of
from footsense.ports import Observer

_REDRAW_PERIOD_NS = 66_000_000
_BAR_WIDTH_CELLS = 10
_BAR_FULL_SCALE_REL = 0.6


class Picture(Live):
    """Picture that is redrawn in its place; on an empty screen after a resize, which folds or moves the last one.

    Args:
        console: Terminal to draw on.
    """

    def __init__(self, console: Console) -> None:
        super().__init__(console=console, auto_refresh=False)
        self._size = console.size

    def refresh(self) -> None:
        """Redraw the picture."""
        if self.console.size != self._size:
            self._size = self.console.size
            self.console.clear()
        super().refresh()


class LiveView(Observer):
    """Observer that redraws a display on the terminal fifteen times a second of the frames' time.

    Args:
        console: Terminal to draw on; journal lines go above the picture instead of through it.
        render: Returns the display after a cycle; its second argument is the time since the first cycle [s].
    """

    def __init__(self, console: Console, render: Callable[[Cycle, float], RenderableType]) -> None:
        self._render = render
        self._start_ns: int | None = None
        self._drawn_ns = -_REDRAW_PERIOD_NS
        self._live = Picture(console)
        self._live.start()
        self._journal = logging.getLogger().handlers
        logging.getLogger().handlers = [RichHandler(console=console, show_time=False, show_path=False)]

    def observe(self, cycle: Cycle) -> None:
        """Redraw the display if the redraw period has passed."""
        t_ns = cycle.forces.t_sent_ns
        if self._start_ns is None:
            self._start_ns = t_ns
        if t_ns - self._drawn_ns >= _REDRAW_PERIOD_NS:
            self._drawn_ns = t_ns
            self._live.update(self._render(cycle, (t_ns - self._start_ns) * 1e-9), refresh=True)

    def close(self) -> None:
        """Stop redrawing, and leave the last display on the terminal."""
        self._live.stop()
        logging.getLogger().handlers = self._journal


def legs_table(
    console: Console,
    legs: tuple[str, ...],
    title: str,
    url: str,
    true_force_n_at: Callable[[int], Vector] | None,
    max_force_n: float,
    cycle: Cycle,
    elapsed_s: float,
) -> Group:
    """Return the legs after a cycle as a table.

    Args:
        console: Terminal whose width it has at most.
        legs: Names of the legs in the order of the frames' rows.
        title: Source of the frames.
        url: Address of the page; empty without one.
        true_force_n_at: True force on every foot at a time [ns], shape (legs, 3) [N]; None on a real robot.
        max_force_n: Largest force of the feet [N], for the bars.
        cycle: The cycle.
        elapsed_s: Time since the first one [s].
    """
    forces = cycle.forces
    usable = IS_USABLE_STATE[forces.state]
    force_n = np.where(usable[:, None], forces.force_n, np.nan)
    age_ms = np.where(usable, forces.age_ns * 1e-6, np.nan).tolist()
    columns: list[Column[int]] = [
        Column("leg", lambda row: legs[row], "<3"),
        state_column(lambda row: State(int(forces.state[row]))),
        contact_column(lambda row: bool(forces.flags[row] & Flag.CONTACT) if usable[row] else None),
        Column("", lambda row: forces.contact_probability[row], ">4.0%", ("P",), worth=0),
        Column("", lambda row: forces.holds[row], ">5.0%", ("holds",), worth=0),
        *force_columns("force_n", lambda row: force_n[row].tolist()),
        Column(
            "load",
            lambda row: usable[row],
            f"<{_BAR_WIDTH_CELLS}",
            cell=lambda row: _force_bar(force_n[row, 2] / max_force_n),
            worth=3,
        ),
    ]
    if true_force_n_at is not None:
        true_n = true_force_n_at(forces.t_sent_ns)
        columns.append(Column("true_n", lambda row: true_n[row, 2], ">8.3f", style=lambda _: "dim", worth=4))
    columns.append(Column("age_ms", lambda row: age_ms[row], ">8.1f", worth=2))
    columns.append(Column("cause", lambda row: word_of(Cause(int(forces.cause[row]))), "<15", worth=1))
    head = Text.assemble(("footsense  ", "bold"), (f"{elapsed_s:.1f} s", "dim"), overflow="ellipsis")
    head.no_wrap = True
    if (forces.flags & Flag.DEGRADED_TIMING).any():
        head.append("  timing degraded", "bold red")
    head.append(f"  {title}")
    head.append(*((f"  {url}", "cyan") if url else (f"  cycle {forces.sequence}", "dim")))
    rows = table(fitting(columns, console.width), range(len(legs)))
    return Group(head, Text(left_out_text(columns, console.width), "dim", no_wrap=True), rows)


def _force_bar(force_rel: float) -> ProgressBar | str:
    if math.isnan(force_rel):
        return ""
    return ProgressBar(
        _BAR_FULL_SCALE_REL,
        max(force_rel, 0.0),
        width=_BAR_WIDTH_CELLS,
        complete_style="cyan",
        finished_style="cyan",
    )
