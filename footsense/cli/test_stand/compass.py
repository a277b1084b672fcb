"""Compass of a session on the test stand: which directions its loads cover, where to press next, where one presses.

It is the foot from above, forwards up. A direction is that in which the force pushes the foot; straight up the leg is
in the middle, and the lowest elevation of the protocol at the rim.
"""

import math

import numpy as np
from rich.text import Text

from footsense.calibration.guide import (
    MIN_ELEVATION_DEG,
    N_BANDS_TO_COVER,
    Coverage,
    azimuth_and_elevation_deg,
)
from footsense.foot.directions import directions
from footsense.frames import Vector

#: Lines and columns, counted from the middle; a character is half as wide as it is high.
_LINES, _COLUMNS = range(-5, 6), range(-10, 11)
_LEFT = "left  "
_RIM_DEG = 90.0 - MIN_ELEVATION_DEG

#: Mark and style of a direction by the number of magnitudes whose loads cover it.
_MARKS = ((".", "dim"), ("o", "cyan"), ("#", "green"))
_NEXT, _NOW = ("X", "bold yellow"), ("+", "bold red")


class Compass:
    """The compass of a session, drawn beside a service that scans: what does not change is computed once.

    Args:
        coverage: What the loads cover, as of each drawing.
    """

    def __init__(self, coverage: Coverage) -> None:
        self._coverage = coverage
        #: Number of the nearest of the coverage's directions, by line and column from the middle; none outside the rim.
        self._nearest: dict[tuple[int, int], int] = {}
        for line in _LINES:
            for column in _COLUMNS:
                forward, left = -line / _LINES[-1], -column / _COLUMNS[-1]
                tilt_rel = math.hypot(forward, left)
                if tilt_rel <= 1.02:  # a whole rim
                    azimuth_deg = math.degrees(math.atan2(left, forward))
                    direction = directions(azimuth_deg, 90.0 - tilt_rel * _RIM_DEG)
                    self._nearest[line, column] = int(np.argmax(coverage.directions @ direction))

    def draw(self, force_n: Vector) -> Text:
        """Return the compass as it is now.

        Args:
            force_n: Force on the reference [N], shape (3,); NaN for none to be shown.
        """
        bands = np.minimum(self._coverage.n_covering_bands, N_BANDS_TO_COVER).tolist()
        marks = {place: _MARKS[bands[number]] for place, number in self._nearest.items()}
        target = self._coverage.next_load
        marks[_place(target.azimuth_deg, target.elevation_deg)] = _NEXT
        if np.isfinite(force_n).all():
            azimuth_deg, elevation_deg = azimuth_and_elevation_deg(force_n)
            marks[_place(azimuth_deg, max(elevation_deg, MIN_ELEVATION_DEG))] = _NOW
        middle = " " * (len(_LEFT) + _COLUMNS[-1] - 3)
        parts: list[tuple[str, str]] = [(f"{middle}forward\n", "dim")]
        for line in _LINES:
            parts.append((_LEFT if line == 0 else " " * len(_LEFT), "dim"))
            parts += [marks.get((line, column), (" ", "")) for column in _COLUMNS]
            parts.append(("  right\n" if line == 0 else "\n", "dim"))
        return Text.assemble(*parts, (f"{middle}  back", "dim"))


def legend() -> Text:
    """Return what the marks of the compass mean."""
    meanings = (
        (_NEXT, "press here next"),
        (_NOW, "where you press now"),
        (_MARKS[0], "nothing yet"),
        (_MARKS[1], "covered by one magnitude"),
        (_MARKS[2], "covered by two: done"),
    )
    return Text("\n").join(Text.assemble(Text(*mark), f"  {meaning}") for mark, meaning in meanings)


def _place(azimuth_deg: float, elevation_deg: float) -> tuple[int, int]:
    """Return the line and column of a direction, counted from the middle."""
    tilt_rel, azimuth = (90.0 - elevation_deg) / _RIM_DEG, math.radians(azimuth_deg)
    return (
        -round(tilt_rel * math.cos(azimuth) * _LINES[-1]),
        -round(tilt_rel * math.sin(azimuth) * _COLUMNS[-1]),
    )
