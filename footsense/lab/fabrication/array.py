"""Coordinates of the rows, columns and elements of a foot's array."""

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise

from footsense.lab.geometry import FootDesign

#: Coordinates closer than this are one line [mm].
_EQUAL_WITHIN_MM = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class ElementArray:
    """Positions of the electrode rows and columns, in the foot frame (x forward, y left, z up the leg).

    Attributes:
        row_x_mm: x of each row [mm], the most forward first.
        column_y_mm: y of each column [mm], the leftmost first.
        electrode_mm: Side of an electrode and of its cavity [mm].
        sheet_mm: Side of the sheet [mm].
    """

    row_x_mm: tuple[float, ...]
    column_y_mm: tuple[float, ...]
    electrode_mm: float
    sheet_mm: float

    @classmethod
    def from_design(cls, design: FootDesign) -> "ElementArray":
        """Return the electrode array of a foot design.

        Example:
            >>> from footsense.daemon.foot_types import released_path
            >>> from footsense.lab.foot_file import load_foot
            >>> ElementArray.from_design(load_foot(released_path("foot.yaml"))).row_x_mm
            (5.0, 0.0, -5.0)
        """
        return cls(
            row_x_mm=_distinct_coordinates_mm(x for x, _ in design.element_centres_mm),
            column_y_mm=_distinct_coordinates_mm(y for _, y in design.element_centres_mm),
            electrode_mm=design.electrode_mm,
            sheet_mm=design.sheet_mm,
        )

    @property
    def centres_mm(self) -> list[tuple[float, float]]:
        """Centre (x, y) of each element [mm], row by row."""
        return [(x, y) for x in self.row_x_mm for y in self.column_y_mm]

    @property
    def rim_mm(self) -> float:
        """Width of the sheet outside the outermost electrodes [mm]; 0 where the array fills the sheet."""
        outermost = max(abs(p) for p in (*self.row_x_mm, *self.column_y_mm))
        return max(0.0, self.sheet_mm / 2.0 - outermost - self.electrode_mm / 2.0)

    @property
    def spacer_bar_width_mm(self) -> float:
        """Width of the spacer's bars [mm]: the smallest distance between neighbouring electrodes."""
        pitches = [a - b for lines in (self.row_x_mm, self.column_y_mm) for a, b in pairwise(lines)]
        return min(pitches) - self.electrode_mm


def _distinct_coordinates_mm(values_mm: Iterable[float]) -> tuple[float, ...]:
    """Return the distinct coordinates of the element centres, highest first [mm]."""
    lines: list[float] = []
    for value in sorted(values_mm, reverse=True):
        if not lines or lines[-1] - value > _EQUAL_WITHIN_MM:
            lines.append(value)
    return tuple(lines)
