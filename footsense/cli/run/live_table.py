"""Live table of a run: every leg's force as sent on CAN, with the true force of a simulated foot."""

from collections.abc import Callable

import numpy as np
from rich.console import Console, Group, RenderableType
from rich.progress_bar import ProgressBar
from rich.text import Text

from footsense.cli.leg_table import EMPTY_CELL, force_columns, leg_table, state_text
from footsense.cli.live_view import LiveView
from footsense.frames import IS_USABLE_STATE, Cycle, State, Vector

_REDRAW_PERIOD_NS = 66_000_000
_BAR_WIDTH_CELLS = 10
_BAR_FULL_SCALE_N = 1.2
_STATE_WIDTH = max(len(state.name) for state in State)


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
        super().__init__(console, _REDRAW_PERIOD_NS)
        self._legs = legs
        self._title = title
        self._true_force_n_at = true_force_n_at
        self._url = url

    def render(self, cycle: Cycle, elapsed_s: float) -> Group:
        """Return the title and the table of the legs, for a terminal of 80 columns."""
        forces = cycle.forces
        usable = IS_USABLE_STATE[forces.state]
        force_n = np.where(usable[:, None], forces.force_n, np.nan)
        columns: dict[str, tuple[str, Callable[[int], RenderableType]]] = {
            "state": (f"<{_STATE_WIDTH}", lambda row: state_text(State(int(forces.state[row])))),
            **force_columns(lambda row: force_n[row].tolist()),
            "load": (f"<{_BAR_WIDTH_CELLS}", lambda row: _force_bar(force_n[row, 2]) if usable[row] else ""),
        }
        if self._true_force_n_at is not None:
            true_n = self._true_force_n_at(forces.t_sent_ns)
            columns["true [N]"] = (">8", lambda row: Text(f"{true_n[row, 2]:.3f}", "dim"))
        columns["age [ms]"] = (
            ">8",
            lambda row: f"{forces.age_ns[row] * 1e-6:.1f}" if usable[row] else EMPTY_CELL,
        )
        table = leg_table({leg: row for row, leg in enumerate(self._legs)}, columns)
        head = Text.assemble(("footsense  ", "bold"), self._title, (f"   {elapsed_s:5.1f} s", "dim"))
        head.append(*((f"   {self._url}", "cyan") if self._url else (f"   cycle {forces.sequence}", "dim")))
        return Group(head, Text(), table)


def _force_bar(force_n: float) -> ProgressBar:
    """Return a bar for a force."""
    return ProgressBar(
        _BAR_FULL_SCALE_N,
        max(force_n, 0.0),
        width=_BAR_WIDTH_CELLS,
        complete_style="cyan",
        finished_style="cyan",
    )
