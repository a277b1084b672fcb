"""The live table: every leg's force as it goes out on CAN, beside what the foot really feels where that is known."""

import logging
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from rich.console import Console, Group
from rich.live import Live
from rich.logging import RichHandler
from rich.table import Table
from rich.text import Text

from footsense.frames import USABLE, Cycle, State

_PERIOD_NS = 66_000_000
_BAR_CELLS = 10
_BAR_FULL_N = 1.2

_BLOCKS = ("", "▏", "▎", "▍", "▌", "▋", "▊", "▉", "█")
#: Where the terminal knows no blocks; a whole cell is then the smallest step.
_PLAIN = ("", "", "", "", "#", "#", "#", "#", "#")

_STATE_NAMES = {state: state.name.lower().replace("_", " ") for state in State}

_STYLES = {
    State.VALID: "green",
    State.DEGRADED: "yellow",
    State.STARTING: "yellow",
    State.TARING: "yellow",
    State.NO_BASELINE: "yellow",
    State.STOPPED: "dim",
}


class LiveTable:
    """An observer that redraws a table some fifteen times a second of the frames' own time.

    Args:
        console: Where to draw.
        legs: Names of the legs in the order of the frames' rows.
        title: What runs.
        true_force_n: What every foot feels at a time, None where nobody knows.
    """

    def __init__(
        self,
        console: Console,
        legs: tuple[str, ...],
        title: str,
        true_force_n: Callable[[int], NDArray[np.float64]] | None,
    ) -> None:
        self._legs = legs
        self._title = title
        self._true_force_n = true_force_n
        self._blocks = _BLOCKS if can_show("".join(_BLOCKS), console.encoding) else _PLAIN
        self._drawn_ns = -_PERIOD_NS
        self._start_ns: int | None = None
        self._live = Live(console=console, auto_refresh=False)
        self._live.start()
        # Journal lines go above the table instead of through it.
        self._journal = logging.getLogger().handlers
        logging.getLogger().handlers = [RichHandler(console=console, show_time=False, show_path=False)]

    def observe(self, cycle: Cycle) -> None:
        """Redraw if it is time to."""
        t_ns = cycle.forces.t_sent_ns
        if self._start_ns is None:
            self._start_ns = t_ns
        if t_ns - self._drawn_ns < _PERIOD_NS:
            return
        self._drawn_ns = t_ns
        self._live.update(self._render(cycle, (t_ns - self._start_ns) * 1e-9), refresh=True)

    def close(self) -> None:
        """Leave the last picture on the screen."""
        self._live.stop()
        logging.getLogger().handlers = self._journal

    def _render(self, cycle: Cycle, elapsed_s: float) -> Group:
        forces = cycle.forces
        true_force_n = self._true_force_n(forces.t_sent_ns) if self._true_force_n else None
        table = Table(box=None, pad_edge=False, padding=(0, 1))  # fits 80 columns
        table.add_column("leg")
        table.add_column("state", min_width=max(map(len, _STATE_NAMES.values())), no_wrap=True)
        for axis in ("fx", "fy", "fz"):
            table.add_column(f"{axis} [N]", justify="right", min_width=7)
        table.add_column("load", min_width=_BAR_CELLS)
        if true_force_n is not None:
            table.add_column("felt [N]", justify="right", min_width=8)
        table.add_column("age \\[ms]", justify="right", min_width=8)
        for row, leg in enumerate(self._legs):
            state = State(int(forces.state[row]))
            valid = state in USABLE
            components = [_signed(value) if valid else "-" for value in forces.force_n[row].tolist()]
            cells: list[str | Text] = [
                leg,
                Text(_STATE_NAMES[state], _STYLES.get(state, "bold red")),
                *components,
                Text(_bar(float(forces.force_n[row, 2]), self._blocks) if valid else "", "cyan"),
            ]
            if true_force_n is not None:
                cells.append(Text(f"{true_force_n[row, 2]:.3f}", "dim"))
            cells.append(f"{forces.age_ns[row] * 1e-6:.1f}" if valid else "-")
            table.add_row(*cells)
        head = Text.assemble(
            ("footsense  ", "bold"), self._title, (f"   {elapsed_s:5.1f} s   scan {forces.sequence}", "dim")
        )
        return Group(head, Text(), table)


def can_show(text: str, encoding: str) -> bool:
    """Tell whether a terminal of this encoding knows all characters of a text."""
    try:
        text.encode(encoding)
    except (UnicodeEncodeError, LookupError):
        return False
    return True


def _signed(force_n: float) -> str:
    """Return a component [N]; what rounds to zero has no sign, which would flicker.

    Example:
        >>> _signed(-0.0004), _signed(-0.0006)
        ('+0.000', '-0.001')
    """
    return f"{round(force_n, 3) + 0.0:+.3f}"


def _bar(force_n: float, blocks: tuple[str, ...]) -> str:
    eighths = round(min(max(force_n / _BAR_FULL_N, 0.0), 1.0) * _BAR_CELLS * 8)
    full, part = divmod(eighths, 8)
    return blocks[8] * full + blocks[part]
