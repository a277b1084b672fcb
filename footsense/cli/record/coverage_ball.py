"""Covered force directions as text: one disc per magnitude band, seen from above.

The pole, a force straight up the leg, is in the middle; forward is up and left is left, as seen from behind the robot.
A character is twice as high as wide, so a disc has twice as many columns as rows.
"""

import math
from typing import NamedTuple

import numpy as np
from rich.text import Text

from footsense.calibration.session.coverage import (
    MAGNITUDE_BAND_CENTRES_GF,
    MIN_ELEVATION_DEG,
    Coverage,
    NextLoad,
    azimuth_and_elevation_deg,
    nearest_band,
)
from footsense.foot.directions import directions
from footsense.foot.force_errors import GRAM_FORCE_N
from footsense.frames import Vector

_DISC_ROWS = 11
DISC_COLUMNS = 2 * _DISC_ROWS - 1
_CENTRE_ROW = (_DISC_ROWS - 1) / 2
_RIM_ANGLE_DEG = 90.0 - MIN_ELEVATION_DEG


class Glyphs(NamedTuple):
    """Characters for uncovered and covered directions, for loads, and for the next load."""

    uncovered: str
    covered: str
    load: str
    next_load: str


GLYPHS = Glyphs("·", "░", "●", "◎")
#: For a terminal without those.
PLAIN_GLYPHS = Glyphs(".", ":", "o", "X")

_GLYPH_STYLES = Glyphs("dim", "green", "bold green", "bold yellow")


def coverage_discs(coverage: Coverage, forces_n: Vector, target: NextLoad, glyphs: Glyphs) -> list[Text]:
    """Return the text lines of three discs of covered directions, side by side.

    Args:
        coverage: Coverage of the loads.
        forces_n: Their forces [N], shape (n, 3).
        target: The next load.
        glyphs: Characters to draw with.
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
        f"{gf:.0f} gf: {100 * share:.0f} %".center(DISC_COLUMNS)
        for gf, share in zip(MAGNITUDE_BAND_CENTRES_GF, coverage.covered_directions_rel, strict=True)
    ]
    lines = [Text("   ".join(titles), "bold")]
    for row in range(_DISC_ROWS):
        line = Text()
        for band in range(len(MAGNITUDE_BAND_CENTRES_GF)):
            for column in range(DISC_COLUMNS):
                direction, cell = _cell_direction(row, column), (band, row, column)
                if direction is None:
                    line.append(" ")
                elif cell == next_cell:
                    line.append(glyphs.next_load, _GLYPH_STYLES.next_load)
                elif cell in loads:
                    line.append(glyphs.load, _GLYPH_STYLES.load)
                elif coverage.is_covered(band, direction):
                    line.append(glyphs.covered, _GLYPH_STYLES.covered)
                else:
                    line.append(glyphs.uncovered, _GLYPH_STYLES.uncovered)
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
