"""Live display of a recording session: covered directions, next load, present forces.

Covered directions are a disc for each magnitude band, seen from above.

The pole, a force straight up the leg, is in the middle; forward is up and left is left, as seen from behind the robot.
A character is twice as high as wide, so a disc has twice as many columns as rows.
"""

import math
from collections import deque

import numpy as np
from rich.console import Console, Group
from rich.text import Text

from footsense.calibration.session.coverage import (
    MAGNITUDE_BAND_CENTRES_GF,
    MIN_ELEVATION_DEG,
    Coverage,
    NextLoad,
    azimuth_and_elevation_deg,
    nearest_band,
)
from footsense.calibration.session.guide import SessionGuide
from footsense.cli.live import LiveView
from footsense.foot.directions import directions
from footsense.foot.force_errors import GRAM_FORCE_N
from footsense.frames import USABLE, Cycle, State, Vector
from footsense.leg_words import word_of

_REDRAW_PERIOD_NS = 100_000_000
#: Messages that the picture shows.
N_SHOWN_MESSAGES = 4
_DISC_ROWS = 11
_DISC_COLUMNS = 2 * _DISC_ROWS - 1
_CENTRE_ROW = (_DISC_ROWS - 1) / 2
_RIM_ANGLE_DEG = 90.0 - MIN_ELEVATION_DEG


#: Characters for uncovered and covered directions, for loads, and for the next load; and for a terminal without those.
_GLYPHS, _PLAIN_GLYPHS = "·░●◎", ".:oX"
_GLYPH_STYLES = ("dim", "green", "bold green", "bold yellow")


def coverage_discs(coverage: Coverage, forces_n: Vector, target: NextLoad, glyphs: str) -> list[Text]:
    """Return the text lines of three discs of covered directions, side by side.

    Args:
        coverage: Coverage of the loads.
        forces_n: Their forces [N], shape (n, 3).
        target: The next load.
        glyphs: Four characters to draw with.
    """
    loads = {
        (
            nearest_band(float(np.linalg.norm(force_n)) / GRAM_FORCE_N),
            *_disc_cell(*azimuth_and_elevation_deg(force_n)),
        )
        for force_n in forces_n
    }
    next_cell = (nearest_band(target.magnitude_gf), *_disc_cell(target.azimuth_deg, target.elevation_deg))
    titles = [
        f"{gf:.0f} gf: {100 * share:.0f} %".center(_DISC_COLUMNS)
        for gf, share in zip(MAGNITUDE_BAND_CENTRES_GF, coverage.covered_directions_rel, strict=True)
    ]
    lines = [Text("   ".join(titles), "bold")]
    for row in range(_DISC_ROWS):
        line = Text()
        for band in range(len(MAGNITUDE_BAND_CENTRES_GF)):
            for column in range(_DISC_COLUMNS):
                direction, cell = _cell_direction(row, column), (band, row, column)
                if direction is None:
                    line.append(" ")
                    continue
                kind = (
                    3
                    if cell == next_cell
                    else 2
                    if cell in loads
                    else int(coverage.is_covered(band, direction))
                )
                line.append(glyphs[kind], _GLYPH_STYLES[kind])
            line.append("   ")
        lines.append(line)
    return lines


def _disc_cell(azimuth_deg: float, elevation_deg: float) -> tuple[int, int]:
    """Return row and column of a direction in a disc; directions that are too low go to the rim."""
    radius = min((90.0 - elevation_deg) / _RIM_ANGLE_DEG, 1.0) * _CENTRE_ROW
    azimuth = math.radians(azimuth_deg)
    return round(_CENTRE_ROW - radius * math.cos(azimuth)), round(
        2 * (_CENTRE_ROW - radius * math.sin(azimuth))
    )


def _cell_direction(row: int, column: int) -> Vector | None:
    """Return the direction of a disc's cell as a unit vector, shape (3,); None outside the disc."""
    forward, left = (_CENTRE_ROW - row) / _CENTRE_ROW, (_CENTRE_ROW - column / 2) / _CENTRE_ROW
    radius = math.hypot(forward, left)
    if radius > 1.05:
        return None
    return directions(math.degrees(math.atan2(left, forward)), 90.0 - min(radius, 1.0) * _RIM_ANGLE_DEG)


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
        self._glyphs = _PLAIN_GLYPHS if console.options.ascii_only else _GLYPHS
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
            Text.assemble(("foot       ", "bold"), _force_text(foot_n), (f"   {word_of(state)}", "dim")),
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
