"""Live display of a recording session: coverage, next load, present forces."""

from collections import deque

import numpy as np
from rich.console import Console, Group
from rich.text import Text

from footsense.calibration.session.coverage import azimuth_and_elevation_deg
from footsense.calibration.session.guide import SessionGuide
from footsense.cli.live import LiveView
from footsense.cli.record.coverage_ball import GLYPHS, PLAIN_GLYPHS, coverage_discs
from footsense.foot.force_errors import GRAM_FORCE_N
from footsense.frames import USABLE, Cycle, State, Vector

_REDRAW_PERIOD_NS = 100_000_000
#: Messages that the picture shows.
N_SHOWN_MESSAGES = 4


class RecordingView(LiveView):
    """Observer that redraws the session's live display ten times a second.

    Args:
        console: Terminal to draw on.
        guide: Guide of the session.
        messages: Its last messages.
        row: Row of the leg in the frames.
        title: Foot and session.
    """

    def __init__(
        self, console: Console, guide: SessionGuide, messages: deque[str], row: int, title: str
    ) -> None:
        super().__init__(console, _REDRAW_PERIOD_NS)
        self._guide = guide
        self._row = row
        self._title = title
        self._glyphs = PLAIN_GLYPHS if console.options.ascii_only else GLYPHS
        self._messages = messages
        self._n_drawn = -1
        self._discs: list[Text] = []

    def render(self, cycle: Cycle, elapsed_s: float) -> Group:
        """Return coverage, forces, next load, progress and messages for a terminal of 80 columns."""
        guide = self._guide
        target = guide.coverage.next_load
        if guide.coverage.n_loads != self._n_drawn:  # drawing looks up a thousand cells
            self._n_drawn = guide.coverage.n_loads
            self._discs = coverage_discs(guide.coverage, guide.load_reference_forces_n, target, self._glyphs)
        state = State(int(cycle.forces.state[self._row]))
        foot_n = cycle.forces.force_n[self._row] if state in USABLE else np.full(3, np.nan)
        pressed = "pressed" if guide.is_pressed else "free"
        target_text = (
            f"{target.magnitude_gf:.0f} gf from azimuth {5 * round(target.azimuth_deg / 5) % 360}, "
            f"elevation {5 * round(target.elevation_deg / 5):.0f} deg"
        )
        return Group(
            Text.assemble(("footsense record  ", "bold"), f"{self._title}, {elapsed_s:.1f} s"),
            Text(),
            *self._discs,
            Text(),
            Text.assemble(("reference  ", "bold"), _force_text(guide.reference_n), (f"   {pressed}", "dim")),
            Text.assemble(("foot       ", "bold"), _force_text(foot_n), (f"   {state.name.lower()}", "dim")),
            Text.assemble(("next       ", "bold"), (target_text, "yellow"), ", hold it still, release"),
            Text.assemble(("so far     ", "bold"), guide.coverage.progress_text()),
            *(
                Text(f"  {line}", "dim" if line.startswith("press") else "bold red")
                for line in self._messages
            ),
        )


def _force_text(force_n: Vector) -> str:
    """Return a force as text: components, magnitude, azimuth and elevation; a dash for NaN.

    Example:
        >>> _force_text(np.array([0.0, 0.5, 0.5]))
        ' +0.000  +0.500  +0.500 N   72.1 gf  az  90  el 45'
    """
    if not np.isfinite(force_n).all():
        return "      -       -       - N"
    components = " ".join(f"{value + 0.0:+7.3f}" for value in force_n.round(3))
    azimuth_deg, elevation_deg = azimuth_and_elevation_deg(force_n)
    size_gf = np.linalg.norm(force_n) / GRAM_FORCE_N
    return f"{components} N  {size_gf:5.1f} gf  az {round(azimuth_deg) % 360:3d}  el {elevation_deg:2.0f}"
