"""The live picture of a session on the test_stand: what is covered, what to press next, and what the reference says."""

import numpy as np
from numpy.typing import NDArray
from rich.console import Console, Group
from rich.text import Text

from footsense.calibration.session.coverage import angles_deg
from footsense.calibration.session.guide import Guide
from footsense.cli.live_view import LiveView, can_show
from footsense.cli.record.coverage_ball import GLYPHS, PLAIN_GLYPHS, discs
from footsense.foot.force_errors import GRAM_FORCE_N
from footsense.frames import USABLE, Cycle, State

__all__ = ["RecordTable"]

_PERIOD_NS = 100_000_000
_LINES = 4


class RecordTable(LiveView):
    """An observer that redraws the picture some ten times a second.

    Args:
        console: Where to draw.
        guide: What it shows.
        row: Row of the leg in the frames.
        title: Which foot and session it is.
    """

    def __init__(self, console: Console, guide: Guide, row: int, title: str) -> None:
        super().__init__(console, _PERIOD_NS)
        self._guide = guide
        self._row = row
        self._title = title
        self._glyphs = GLYPHS if can_show("".join(GLYPHS), console.encoding) else PLAIN_GLYPHS
        self._news: list[str] = []
        self._n_drawn = -1
        self._discs: list[Text] = []

    def render(self, cycle: Cycle, elapsed_s: float) -> Group:
        """Return ball, forces, the next load and what is left; they fit 80 columns."""
        guide = self._guide
        self._news = [*self._news, *guide.news()][-_LINES:]
        wish = guide.coverage.next
        if guide.coverage.n_loads != self._n_drawn:  # a thousand cells are looked up for it
            self._n_drawn = guide.coverage.n_loads
            self._discs = discs(guide.coverage, guide.directions_n, wish, self._glyphs)
        state = State(int(cycle.forces.state[self._row]))
        foot_n = cycle.forces.force_n[self._row] if state in USABLE else np.full(3, np.nan)
        held = "pressed" if guide.pressed else "free"
        press = (
            f"{wish.magnitude_gf:.0f} gf from azimuth {5 * round(wish.azimuth_deg / 5) % 360}, "
            f"elevation {5 * round(wish.elevation_deg / 5):.0f} deg"
        )
        return Group(
            Text.assemble(("footsense record  ", "bold"), f"{self._title}, {elapsed_s:.1f} s"),
            Text(),
            *self._discs,
            Text(),
            Text.assemble(("reference  ", "bold"), _force(guide.reference_n), (f"   {held}", "dim")),
            Text.assemble(("foot       ", "bold"), _force(foot_n), (f"   {state.name.lower()}", "dim")),
            Text.assemble(("next       ", "bold"), (press, "yellow"), ", hold it still, let go"),
            Text.assemble(("so far     ", "bold"), guide.coverage.words()),
            *(Text(f"  {line}", "dim" if line.startswith("press") else "bold red") for line in self._news),
        )


def _force(force_n: NDArray[np.float64]) -> str:
    """Return a force in words.

    Example:
        >>> _force(np.array([0.0, 0.5, 0.5]))
        ' +0.000  +0.500  +0.500 N   72.1 gf  az  90  el 45'
    """
    if not np.isfinite(force_n).all():
        return "      -       -       - N"
    components = " ".join(f"{value + 0.0:+7.3f}" for value in force_n.round(3))
    azimuth_deg, elevation_deg = angles_deg(force_n)
    size_gf = np.linalg.norm(force_n) / GRAM_FORCE_N
    return f"{components} N  {size_gf:5.1f} gf  az {round(azimuth_deg) % 360:3d}  el {elevation_deg:2.0f}"
