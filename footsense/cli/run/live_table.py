"""The live table: every leg's force as sent on CAN, beside the true force of a simulated foot."""

from collections.abc import Callable

from rich.console import Console, Group, RenderableType
from rich.progress_bar import ProgressBar
from rich.text import Text

from footsense.cli.leg_table import EMPTY, FORCE_COLUMNS, force_cells, leg_table, state_text
from footsense.cli.live_view import LiveView
from footsense.frames import USABLE, Cycle, State, Vector

_PERIOD_NS = 66_000_000
_BAR_CELLS = 10
_BAR_FULL_N = 1.2
_STATE_WIDTH = max(len(state.name) for state in State)


class LiveTable(LiveView):
    """An observer that redraws a table some fifteen times a second.

    Args:
        console: Terminal to draw on.
        legs: Names of the legs in the order of the frames' rows.
        title: Source of the frames.
        true_force_n: True force on every foot at a time [ns], shape (legs, 3) [N]; None on a real robot.
    """

    def __init__(
        self,
        console: Console,
        legs: tuple[str, ...],
        title: str,
        true_force_n: Callable[[int], Vector] | None,
    ) -> None:
        super().__init__(console, _PERIOD_NS)
        self._legs = legs
        self._title = title
        self._true_force_n = true_force_n

    def render(self, cycle: Cycle, elapsed_s: float) -> Group:
        """Return title and table; they fit 80 columns."""
        forces = cycle.forces
        columns = {"state": f"<{_STATE_WIDTH}", **FORCE_COLUMNS, "load": f"<{_BAR_CELLS}"}
        if self._true_force_n is not None:
            columns["true [N]"] = ">8"
            true_n = self._true_force_n(forces.t_sent_ns)
        table = leg_table(columns | {"age [ms]": ">8"})
        for row, leg in enumerate(self._legs):
            state = State(int(forces.state[row]))
            force_n = forces.force_n[row].tolist() if state in USABLE else None
            cells: list[RenderableType] = [leg, state_text(state), *force_cells(force_n)]
            cells.append(_bar(force_n[2]) if force_n else "")
            if self._true_force_n is not None:
                cells.append(Text(f"{true_n[row, 2]:.3f}", "dim"))
            table.add_row(*cells, f"{forces.age_ns[row] * 1e-6:.1f}" if force_n else EMPTY)
        head = Text.assemble(
            ("footsense  ", "bold"), self._title, (f"   {elapsed_s:5.1f} s   cycle {forces.sequence}", "dim")
        )
        return Group(head, Text(), table)


def _bar(force_n: float) -> ProgressBar:
    return ProgressBar(
        _BAR_FULL_N, max(force_n, 0.0), width=_BAR_CELLS, complete_style="cyan", finished_style="cyan"
    )
