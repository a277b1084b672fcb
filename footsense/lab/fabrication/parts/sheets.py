"""Spacer and film as flat shapes, seen from above in the foot frame (x right, y up), and as DXF files.

Both keep two ears with alignment holes, on the sides on which no tail leaves; they are cut off after bonding. A vented
foot gets a channel in the spacer to every cavity that is not open to the edge of the sheet: a cavity without one would
be sealed.
"""

from pathlib import Path
from typing import Any

import ezdxf
import shapely
from ezdxf import units

from footsense.errors import ConfigError
from footsense.foot.cavity.air import CavityKind
from footsense.lab.fabrication import process
from footsense.lab.fabrication.array import ElementArray
from footsense.lab.fabrication.parts.flex import ear


def holes(ball_radius_mm: float) -> list[tuple[float, float]]:
    """Return the centres (x, y) of the alignment holes [mm]: behind the foot and to its right."""
    far = ball_radius_mm + process.EAR_MM
    return [(-far, 0.0), (0.0, -far)]


def film(array: ElementArray, ball_radius_mm: float) -> Any:
    """Return the film, a polygon of shapely [mm]: the whole sheet with its ears."""
    half, places = array.sheet_mm / 2.0, holes(ball_radius_mm)
    whole = shapely.union_all([shapely.box(-half, -half, half, half), *(ear(half, p) for p in places)])
    drilled = [shapely.Point(place).buffer(process.HOLE_MM / 2.0, quad_segs=16) for place in places]
    return whole.difference(shapely.union_all(drilled))


def cavities(array: ElementArray) -> Any:
    """Return the cavities, as large as the electrodes [mm]."""
    half = array.electrode_mm / 2.0
    return shapely.union_all(
        [shapely.box(x - half, y - half, x + half, y + half) for x, y in array.centres_mm]
    )


def vents(array: ElementArray) -> list[Any]:
    """Return the channels that connect closed cavities with the air, along the rows towards the left [mm]."""
    rows, columns = list(array.row_x_mm), array.column_y_mm
    if array.rim_mm > 0.0:
        ends = columns[-1], array.sheet_mm / 2.0 + 1.0
    else:  # the cavities at the edge of the sheet are open
        if len(columns) < 3:
            return []
        rows, ends = rows[1:-1], (columns[-2], columns[0])
    half = process.VENT_MM / 2.0
    return [shapely.box(x - half, ends[0], x + half, ends[1]) for x in rows]


def spacer(array: ElementArray, ball_radius_mm: float, cavity: CavityKind) -> Any:
    """Return the spacer, a polygon of shapely [mm]: bars around the cavities, with its ears.

    Raises:
        ConfigError: The cavities are not to be vented and reach the edge of the sheet.
    """
    open_parts = [cavities(array)]
    if cavity == "vented":
        open_parts += vents(array)
    elif array.rim_mm < process.MIN_RIM_MM - 1e-9:
        closed_mm = array.sheet_mm + 2.0 * (process.MIN_RIM_MM - array.rim_mm)
        raise ConfigError(
            f"sheet_mm: {cavity} cavities need a rim of {process.MIN_RIM_MM:g} mm around the array, a sheet of "
            f"{array.sheet_mm:g} mm leaves {array.rim_mm:g} mm; use sheet_mm: {closed_mm:g} or cavity: vented"
        )
    return film(array, ball_radius_mm).difference(shapely.union_all(open_parts))


def write_dxf(path: Path, shape: Any, note: str) -> None:
    """Write a polygon as closed lines, in mm, with the thickness as a note.

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
    document.saveas(path)


def read_dxf(path: Path) -> Any:
    """Return the polygon that the closed lines of a DXF file bound [mm]: the largest, less those in it."""
    document = ezdxf.readfile(path)
    rings = [
        shapely.Polygon([(point[0], point[1]) for point in line.get_points()])
        for line in document.modelspace().query('LWPOLYLINE[layer=="CUT"]')
    ]
    outer, *inner = sorted(rings, key=lambda ring: -ring.area)
    return outer.difference(shapely.union_all(inner))
