"""The ball of a foot as text: which directions are covered, seen from above, one disc for each magnitude.

The pole, a force straight up the leg, is in the middle; forward is up and left is left, as for whoever stands behind
the robot. A cell is twice as high as it is wide, so a disc has twice as many columns as rows.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from rich.text import Text

from footsense.calibration.session.coverage import BANDS_GF, LOWEST_DEG, Coverage, Wish, angles_deg
from footsense.foot.force_errors import GRAM_FORCE_N

__all__ = ["COLUMNS", "GLYPHS", "PLAIN_GLYPHS", "Glyphs", "discs"]

Vector = NDArray[np.float64]

_ROWS = 11
COLUMNS = 2 * _ROWS - 1
_RIM_DEG = 90.0 - LOWEST_DEG


class Glyphs(NamedTuple):
    """What a cell is drawn with."""

    bare: str
    covered: str
    load: str
    wish: str


GLYPHS = Glyphs("·", "░", "●", "◎")
#: Where the terminal knows none of these.
PLAIN_GLYPHS = Glyphs(".", ":", "o", "X")

_STYLES = Glyphs("dim", "green", "bold green", "bold yellow")


def discs(coverage: Coverage, loads_n: Vector, wish: Wish, glyphs: Glyphs) -> list[Text]:
    """Return the lines of three discs beside each other.

    Args:
        coverage: What is covered.
        loads_n: Forces of the loads [N], shape (n, 3).
        wish: What to press next.
        glyphs: What to draw with.
    """
    loads: list[set[tuple[int, int]]] = [set() for _ in BANDS_GF]
    for force_n in loads_n:
        azimuth_deg, elevation_deg = angles_deg(force_n)
        loads[_band(float(np.linalg.norm(force_n)) / GRAM_FORCE_N)].add(_cell(azimuth_deg, elevation_deg))
    wished = _band(wish.magnitude_gf), _cell(wish.azimuth_deg, wish.elevation_deg)
    titles = [
        f"{gf:.0f} gf: {100 * share:.0f} %".center(COLUMNS)
        for gf, share in zip(BANDS_GF, coverage.shares_rel, strict=True)
    ]
    lines = [Text("   ".join(titles), "bold")]
    for row in range(_ROWS):
        line = Text()
        for band in range(len(BANDS_GF)):
            for column in range(COLUMNS):
                direction = _direction(row, column)
                if direction is None:
                    line.append(" ")
                elif (band, (row, column)) == wished:
                    line.append(glyphs.wish, _STYLES.wish)
                elif (row, column) in loads[band]:
                    line.append(glyphs.load, _STYLES.load)
                elif coverage.covers(band, direction):
                    line.append(glyphs.covered, _STYLES.covered)
                else:
                    line.append(glyphs.bare, _STYLES.bare)
            line.append("   ")
        lines.append(line)
    return lines


def _band(magnitude_gf: float) -> int:
    return int(np.argmin(np.abs(np.array(BANDS_GF) - magnitude_gf)))


def _cell(azimuth_deg: float, elevation_deg: float) -> tuple[int, int]:
    """Return row and column of a direction; what leans beyond the rim is drawn on it."""
    radius = min((90.0 - elevation_deg) / _RIM_DEG, 1.0) * (_ROWS - 1) / 2
    azimuth = math.radians(azimuth_deg)
    middle = (_ROWS - 1) / 2
    return round(middle - radius * math.cos(azimuth)), round(2 * (middle - radius * math.sin(azimuth)))


def _direction(row: int, column: int) -> Vector | None:
    """Return the direction that a cell stands for, a unit vector of shape (3,); None outside of the disc."""
    middle = (_ROWS - 1) / 2
    forward, left = (middle - row) / middle, (middle - column / 2) / middle
    radius = math.hypot(forward, left)
    if radius > 1.05:
        return None
    lean = math.radians(min(radius, 1.0) * _RIM_DEG)
    azimuth = math.atan2(left, forward)
    return np.array([math.sin(lean) * math.cos(azimuth), math.sin(lean) * math.sin(azimuth), math.cos(lean)])
