"""Spacer and film as polygons in the foot frame (seen from above, x right, y up), and as DXF files.

Both keep two ears with alignment holes, on the sides on which no tail leaves; they are cut off after bonding. A vented
foot gets a channel in the spacer to every cavity that is not open to the edge of the sheet: a cavity without one would
be sealed.
"""

import itertools
from pathlib import Path
from typing import Any

import ezdxf
import shapely
from ezdxf import units

from footsense.lab.fabrication import dimensions
from footsense.lab.fabrication.parts.flex import alignment_ear
from footsense.lab.geometry import FootDesign

#: Lengths are equal within this [mm].
_ROUNDING_TOLERANCE_MM = 1e-9


def alignment_hole_centres_mm(ball_radius_mm: float) -> list[tuple[float, float]]:
    """Return the centres (x, y) of the alignment holes [mm]: behind the foot and to its right."""
    far = ball_radius_mm + dimensions.ALIGNMENT_HOLE_TO_BALL_MM
    return [(-far, 0.0), (0.0, -far)]


def film_outline(design: FootDesign) -> Any:
    """Return the outline of the insulating film, a shapely polygon [mm]: the whole sheet with its ears."""
    half, places = design.sheet_mm / 2.0, alignment_hole_centres_mm(design.ball_radius_mm)
    whole = shapely.union_all(
        [shapely.box(-half, -half, half, half), *(alignment_ear(half, p) for p in places)]
    )
    drilled = [
        shapely.Point(place).buffer(dimensions.ALIGNMENT_HOLE_DIAMETER_MM / 2.0, quad_segs=16)
        for place in places
    ]
    return whole.difference(shapely.union_all(drilled))


def spacer_openings(design: FootDesign) -> Any:
    """Return the cavities cut into the spacer [mm]: electrode-sized; without a rim, open to the sheet's edge."""
    half, edge = design.electrode_mm / 2.0, design.sheet_mm / 2.0

    outer = half + design.pitch_mm if has_spacer_rim(design) else edge
    spans = ((design.pitch_mm - half, outer), (-half, half), (-outer, half - design.pitch_mm))
    return shapely.union_all(
        [shapely.box(low_x, low_y, x, y) for (low_x, x), (low_y, y) in itertools.product(spans, spans)]
    )


def has_spacer_rim(design: FootDesign) -> bool:
    """Tell whether the sheet exceeds the array by enough for a closed rim of the spacer."""
    return design.rim_mm > dimensions.MIN_SPACER_RIM_MM - _ROUNDING_TOLERANCE_MM


def vent_channels(design: FootDesign) -> list[Any]:
    """Return the channels that vent closed cavities to the air, along the rows to the left [mm]."""
    lines = design.line_mm
    rows, ends = list(lines), (lines[-1], design.sheet_mm / 2.0 + 1.0)
    if not has_spacer_rim(design):
        rows, ends = [0.0], (0.0, lines[0])
    half = dimensions.CAVITY_VENT_WIDTH_MM / 2.0
    return [shapely.box(x - half, ends[0], x + half, ends[1]) for x in rows]


def spacer_outline(design: FootDesign) -> Any:
    """Return the spacer, a shapely polygon [mm]: bars around the cavities, with ears."""
    openings = shapely.union_all([spacer_openings(design), *vent_channels(design)])
    return film_outline(design).difference(openings)


def write_dxf(path: Path, shape: Any, note: str) -> None:
    """Write a polygon to a DXF file as closed lines [mm], with a text note below it.

    Args:
        path: The file.
        shape: A polygon of shapely, in one piece [mm].
        note: Text beside it: part, material, thickness.
    """
    ezdxf.options.write_fixed_meta_data_for_testing = True  # the same foot gives the same bytes
    document = ezdxf.new("R2010", units=units.MM)
    document.layers.add("CUT")
    document.layers.add("NOTE", color=8)
    space = document.modelspace()
    for ring in (shape.exterior, *shape.interiors):
        space.add_lwpolyline(list(ring.coords)[:-1], close=True, dxfattribs={"layer": "CUT"})
    low_x, low_y, *_ = shape.bounds
    text = space.add_text(note, height=1.5, dxfattribs={"layer": "NOTE"})
    text.set_placement((low_x, low_y - 4.0))
    # The library adds classes in the order of a set, which differs from process to process.
    document.classes.add_required_classes(document.dxfversion)
    document.classes.classes = dict(sorted(document.classes.classes.items()))
    document.saveas(path)
