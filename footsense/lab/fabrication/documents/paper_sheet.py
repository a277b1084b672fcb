"""A3 drawing sheets: views at a drawing scale, dimensions, notes, title block."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from matplotlib.path import Path as Outline

#: Width and height of A3 [mm], margin around it, and inches per mm.
WIDTH_MM, HEIGHT_MM, _MARGIN_MM, _INCH_PER_MM = 420.0, 297.0, 10.0, 1.0 / 25.4
_STANDARD_SCALES = (20.0, 10.0, 5.0, 4.0, 2.0, 1.0, 0.5, 0.2, 0.1)
#: Line widths of outlines and of dimensions [pt], as ISO 128 has them: 0.5 and 0.25 mm.
_THICK, _THIN = 1.2, 0.5
#: Length on paper below which the text of a dimension stands beside it [mm].
_MIN_LINE_WITH_CENTRED_TEXT_MM = 16.0


def largest_scale(size_mm: tuple[float, float], room_mm: tuple[float, float]) -> float:
    """Return the largest standard scale at which a part fits the space on the sheet; the smallest if none does.

    Example:
        >>> largest_scale((26.0, 17.0), (150.0, 120.0))
        5.0
    """
    fits = (s for s in _STANDARD_SCALES if s * size_mm[0] <= room_mm[0] and s * size_mm[1] <= room_mm[1])
    return next(fits, _STANDARD_SCALES[-1])


@dataclass(frozen=True, slots=True)
class View:
    """One view of a part on a sheet; drawing methods take the part's coordinates [mm].

    Attributes:
        axes: Axes of matplotlib.
        scale: mm on paper for a mm of the part.
    """

    axes: Any
    scale: float

    def draw_area(self, shape: Any, colour: str, hatch: str | None = None, *, edge: bool = True) -> None:
        """Draw a shapely polygon or multipolygon with its holes.

        Args:
            shape: The polygons [mm].
            colour: Colour of the area.
            hatch: Pattern of matplotlib; None for none.
            edge: Whether its edge is drawn.
        """
        for part in getattr(shape, "geoms", [shape]):
            rings = [np.asarray(ring.coords) for ring in (part.exterior, *part.interiors)]
            codes = [
                np.r_[Outline.MOVETO, np.full(len(ring) - 2, Outline.LINETO), Outline.CLOSEPOLY]
                for ring in rings
            ]
            outline = Outline(np.concatenate(rings), np.concatenate(codes))
            line = {"ec": "k", "lw": 0.6 * _THICK} if edge else {"lw": 0.0}
            self.axes.add_patch(PathPatch(outline, fc=colour, hatch=hatch, clip_on=False, **line))

    def draw_line(self, points: Sequence[tuple[float, float]], **options: Any) -> None:
        """Draw a polyline through points [mm]."""
        self.axes.plot(
            *zip(*points, strict=True), **({"color": "k", "lw": _THICK, "clip_on": False} | options)
        )

    def draw_centre_line(self, points: Sequence[tuple[float, float]]) -> None:
        """Draw a dash-dotted centre line through points [mm]."""
        self.draw_line(points, lw=_THIN, dashes=(12, 3, 2, 3))

    def draw_dimension(self, ends: Sequence[tuple[float, float]], offset_mm: float, text: str) -> None:
        """Draw a horizontal or vertical dimension line with its text.

        Args:
            ends: Two points of the part, at one height or above each other.
            offset_mm: Distance of the dimension line on paper [mm], up or to the right, negative for down or left.
            text: What it says.
        """
        (ax, ay), (bx, by) = ends
        off = offset_mm / self.scale
        upright = abs(ax - bx) < abs(ay - by)
        over = 1.5 / self.scale * np.sign(off)
        line = [(ax + off, ay), (ax + off, by)] if upright else [(ax, ay + off), (bx, ay + off)]
        for (x, y), (u, v) in zip(ends, line, strict=True):
            beyond = (u + over, v) if upright else (u, v + over)
            self.draw_line([(x, y), beyond], lw=_THIN)
        arrow = {
            "arrowstyle": "<|-|>",
            "lw": _THIN,
            "color": "k",
            "shrinkA": 0,
            "shrinkB": 0,
            "mutation_scale": 6,
        }
        self.axes.annotate("", line[0], line[1], arrowprops=arrow, annotation_clip=False)
        (ax, ay), (bx, by) = line
        shift = 0.8 / self.scale
        if (
            max(abs(ax - bx), abs(ay - by)) * self.scale < _MIN_LINE_WITH_CENTRED_TEXT_MM
        ):  # the text beside the arrows
            side = {"ha": "right" if upright and off < 0.0 else "left", "va": "center"}
            x = ax + 2.0 * np.sign(off) * shift if upright else max(ax, bx) + 2.0 * shift
            self.axes.text(x, (ay + by) / 2.0, text, fontsize=8, **side)
            return
        place = ((ax + bx) / 2.0 - shift * upright, (ay + by) / 2.0 + shift * (not upright))
        align = {"ha": "right", "va": "center"} if upright else {"ha": "center", "va": "bottom"}
        self.axes.text(*place, text, fontsize=8, rotation=90 if upright else 0, **align)

    def draw_note(
        self, at: tuple[float, float], text_mm: tuple[float, float], text: str, align: str | None = None
    ) -> None:
        """Draw a note with a leader line to a point of the part.

        Args:
            at: The place.
            text_mm: Offset of the text on paper [mm].
            text: The note.
            align: `left`, `center` or `right`; None for the side away from the place.
        """
        place = (at[0] + text_mm[0] / self.scale, at[1] + text_mm[1] / self.scale)
        arrow = {"arrowstyle": "-|>", "lw": _THIN, "color": "k", "shrinkB": 0, "mutation_scale": 6}
        self.axes.annotate(
            text, at, place, fontsize=8, arrowprops=arrow, annotation_clip=False, va="center",
            ha=align or ("left" if text_mm[0] >= 0.0 else "right"),
        )  # fmt: skip


class PaperSheet:
    """One A3 sheet of a drawing, with frame and title block.

    Args:
        title: Title of the sheet.
        about: Lines of its title block.
    """

    def __init__(self, title: str, about: Iterable[str]) -> None:
        self.figure = Figure(figsize=(WIDTH_MM * _INCH_PER_MM, HEIGHT_MM * _INCH_PER_MM))
        frame = self._axes((0.0, 0.0), (WIDTH_MM, HEIGHT_MM))
        frame.set(xlim=(0, WIDTH_MM), ylim=(0, HEIGHT_MM))
        corner = (WIDTH_MM - _MARGIN_MM, HEIGHT_MM - _MARGIN_MM)
        for low, high in (((_MARGIN_MM,) * 2, corner), ((290.0, _MARGIN_MM), (corner[0], 48.0))):
            xs, ys = zip(low, high, strict=True)
            frame.plot(np.take(xs, (0, 1, 1, 0, 0)), np.take(ys, (0, 0, 1, 1, 0)), "k", lw=_THICK)
        frame.text(294, 40, title, fontsize=13, weight="bold")
        for k, line in enumerate(about):
            frame.text(294, 33.5 - 5.0 * k, line, fontsize=8)
        self._frame = frame

    def _axes(self, corner_mm: tuple[float, float], size_mm: tuple[float, float]) -> Any:
        """Return empty matplotlib axes at a corner of the sheet, sized in mm."""
        place = (
            corner_mm[0] / WIDTH_MM,
            corner_mm[1] / HEIGHT_MM,
            size_mm[0] / WIDTH_MM,
            size_mm[1] / HEIGHT_MM,
        )
        axes = self.figure.add_axes(place)
        axes.set_axis_off()
        return axes

    def add_view(
        self,
        centre_mm: tuple[float, float],
        scale: float,
        part_mm: tuple[float, float, float, float],
        title: str,
        below_mm: float = 14.0,
    ) -> View:
        """Add a titled view of a part to the sheet at a given drawing scale.

        Args:
            centre_mm: Its middle on the sheet [mm].
            scale: mm on paper for a mm of the part.
            part_mm: Lowest x and y, highest x and y of the part [mm].
            title: Its title, below it; an asterisk stands for the scale.
            below_mm: Distance of the title from the part [mm].
        """
        low_x, low_y, high_x, high_y = part_mm
        size = scale * (high_x - low_x), scale * (high_y - low_y)
        corner = centre_mm[0] - size[0] / 2.0, centre_mm[1] - size[1] / 2.0
        axes = self._axes(corner, size)
        axes.set(xlim=(low_x, high_x), ylim=(low_y, high_y))
        ratio = f"{scale:g}:1" if scale >= 1.0 else f"1:{1.0 / scale:g}"
        heading = title.replace("*", ratio)
        self.write_text((centre_mm[0], corner[1] - below_mm), heading, size=10, ha="center", weight="bold")
        return View(axes, scale)

    def write_text(self, at_mm: tuple[float, float], text: str, size: float = 8, **options: Any) -> None:
        """Write a line of text on the sheet."""
        self._frame.text(*at_mm, text, fontsize=size, **({"va": "top"} | options))

    def write_table(
        self, at_mm: tuple[float, float], widths_mm: Sequence[float], rows: Sequence[Sequence[str]]
    ) -> None:
        """Write a table on the sheet; its first row is the heading.

        Args:
            at_mm: Its upper left corner [mm].
            widths_mm: Widths of its columns [mm].
            rows: Its cells.
        """
        left, top = at_mm
        for k, row in enumerate(rows):
            x, y = left, top - 5.5 * k
            for width, cell in zip(widths_mm, row, strict=True):
                self.write_text((x, y), cell, weight="normal" if k else "bold")
                x += width
            self._frame.plot((left, x), (y - 4.2,) * 2, "k", lw=_THIN)
