"""Sections and edges of Open CASCADE solids as two-dimensional shapes for drawings."""

from typing import Any

import numpy as np
import shapely
from netgen import occ

from footsense.frames import Vector

#: Points along an edge.
_POINTS_PER_EDGE = 49
#: Points of one vertex, rounded [mm].
_VERTEX_GRID_MM = 1e-6
_BEYOND_ALL_PARTS_MM = 1e3


def section_y0(solid: Any) -> Any:
    """Return the section of a solid by the plane y = 0 as shapely polygons in (x, z) [mm]."""
    corner = occ.Pnt(-_BEYOND_ALL_PARTS_MM, 0, -_BEYOND_ALL_PARTS_MM)
    axes = occ.Axes(corner, n=occ.Vec(0, -1, 0), h=occ.X)
    cut = occ.WorkPlane(axes).Rectangle(2.0 * _BEYOND_ALL_PARTS_MM, 2.0 * _BEYOND_ALL_PARTS_MM).Face() * solid
    faces = []
    for face in cut.faces:
        lines = [shapely.LineString(points[:, (0, 2)]) for points in edge_polylines(face)]
        rings = shapely.get_parts(shapely.polygonize(shapely.set_precision(lines, _VERTEX_GRID_MM)))
        outer, *inner = sorted(rings, key=lambda ring: -ring.area)
        faces.append(outer.difference(shapely.union_all(inner)) if inner else outer)
    return shapely.union_all(faces)


def edge_polylines(shape: Any) -> list[Vector]:
    """Return the edges of a shape as polylines [mm], each of shape (n, 3)."""
    found = []
    for edge in shape.edges:
        begin, end = edge.parameter_interval
        points = [edge.Value(t) for t in np.linspace(begin, end, _POINTS_PER_EDGE)]
        found.append(np.array([(p.x, p.y, p.z) for p in points]))
    return found
