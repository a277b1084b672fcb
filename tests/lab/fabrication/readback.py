"""Files of a foot, read back: Gerber and drill files by a parser that did not write them, DXF and STEP.

gerbonara reads, shapely measures; nothing of the writer or of the artwork is used.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import ezdxf
import shapely
from gerbonara import ExcellonFile, GerberFile
from gerbonara import graphic_primitives as primitives
from gerbonara.utils import MM
from netgen import occ

#: Straight segments by which a polygon approximates a quarter circle.
_SEGMENTS_PER_QUARTER_CIRCLE = 32
#: Shapes are grown by this before they are united, so that those that touch become one [mm].
_TOUCH_DISTANCE_MM = 1e-6
#: Share of a conductor's area that has to be left where nothing but its round ends is etched away [1].
_MIN_AREA_SHARE_AFTER_EROSION = 0.97


@dataclass(frozen=True, slots=True)
class CopperShape:
    """One shape of a copper layer, read from Gerber.

    Attributes:
        polygon: A polygon of shapely [mm].
        aperture_function: Its aperture function.
        net: Its net; empty for none.
        pin_number: Number of its contact; empty where it is none.
    """

    polygon: Any
    aperture_function: str
    net: str
    pin_number: str


def read_layer(path: Path) -> list[CopperShape]:
    """Return the shapes of a Gerber file."""
    shapes = []
    for thing in GerberFile.open(path).objects:
        attributes, aperture = dict(thing.attrs or {}), dict(thing.aperture.attrs)
        parts = [_polygon(primitive) for primitive in thing.to_primitives(MM)]
        shapes.append(
            CopperShape(
                polygon=shapely.union_all(parts),
                aperture_function=_attribute_text(aperture, ".AperFunction"),
                net=_attribute_text(attributes, ".N"),
                pin_number=_attribute_text(attributes, ".P").partition(",")[2],
            )
        )
    return shapes


def read_outline(path: Path) -> Any:
    """Return the polygon that the lines of a profile layer enclose [mm]."""
    lines = [
        shapely.LineString([(line.x1, line.y1), (line.x2, line.y2)]) for line in GerberFile.open(path).objects
    ]
    (outline,) = shapely.get_parts(shapely.polygonize(lines))
    return outline


def read_holes(path: Path) -> list[tuple[float, float, float]]:
    """Return u, v and diameter of each hole of a drill file [mm]."""
    return [(hole.x, hole.y, hole.aperture.diameter) for hole in ExcellonFile.open(path).objects]


def connected_conductors(shapes: Sequence[CopperShape]) -> list[list[CopperShape]]:
    """Return the shapes grouped by touching copper (geometry, not net names): each list is one conductor."""
    copper = shapely.get_parts(
        shapely.union_all([shape.polygon.buffer(_TOUCH_DISTANCE_MM) for shape in shapes])
    )
    return [[shape for shape in shapes if shape.polygon.intersects(piece)] for piece in copper]


def narrowest_width_mm(areas: Sequence[Any]) -> float:
    """Return the width of a conductor's narrowest part [mm]."""
    whole = shapely.union_all(list(areas)).buffer(_TOUCH_DISTANCE_MM)
    low, high = 0.0, float(whole.length)
    while high - low > 1e-4:
        width = 0.5 * (low + high)
        left = whole.buffer(-0.5 * width, join_style="mitre")
        kept_rel = left.buffer(0.5 * width, join_style="mitre").area / whole.area
        holds = left.geom_type == "Polygon" and kept_rel > _MIN_AREA_SHARE_AFTER_EROSION
        low, high = (width, high) if holds else (low, width)
    return low


def _polygon(primitive: Any) -> Any:
    """Return the shapely polygon [mm] of a primitive of the Gerber parser.

    Raises:
        FootsenseError: It is of a kind that these layers have none of.
    """
    if isinstance(primitive, primitives.Line):
        ends = [(primitive.x1, primitive.y1), (primitive.x2, primitive.y2)]
        return shapely.LineString(ends).buffer(primitive.width / 2.0, quad_segs=_SEGMENTS_PER_QUARTER_CIRCLE)
    if isinstance(primitive, primitives.Rectangle) and not primitive.rotation:
        u, v = primitive.w / 2.0, primitive.h / 2.0
        return shapely.box(primitive.x - u, primitive.y - v, primitive.x + u, primitive.y + v)
    if isinstance(primitive, primitives.Circle):
        return shapely.Point(primitive.x, primitive.y).buffer(
            primitive.r, quad_segs=_SEGMENTS_PER_QUARTER_CIRCLE
        )
    raise AssertionError(f"no layer of a flex should have a {type(primitive).__name__}")


def _attribute_text(attributes: dict[str, Any], name: str) -> str:
    """Return a Gerber attribute's fields joined by commas; empty if the attribute is missing."""
    value = attributes.get(name, "")
    return value if isinstance(value, str) else ",".join(value)


def read_dxf(path: Path) -> Any:
    """Return the polygon of a DXF file [mm]: the largest closed line, minus those inside it."""
    document = ezdxf.readfile(path)
    rings = [
        shapely.Polygon([(point[0], point[1]) for point in line.get_points()])
        for line in document.modelspace().query('LWPOLYLINE[layer=="CUT"]')
    ]
    outer, *inner = sorted(rings, key=lambda ring: -ring.area)
    return outer.difference(shapely.union_all(inner))


def read_step(path: Path) -> Any:
    """Return the shape of a STEP file [mm]."""
    return occ.OCCGeometry(str(path)).shape
