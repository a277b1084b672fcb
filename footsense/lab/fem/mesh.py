"""Mesh of the foot, or of its quarter x > 0, y > 0: coarse in smooth regions, graded towards singular edges.

The stress is singular at the edges of the spacer's bars and where the sheet's rim meets the hemispheres. Halving the
elements there gains a factor of two in error for eight times the work; instead the edges get one layer of thin
elements (hp refinement) under cubic displacements. The cavities are cut into square cells, on which gap closure
and contact pressure live, and the mesh follows them.
"""

from dataclasses import dataclass, replace
from typing import Any

import ngsolve as ng
import numpy as np
from netgen import occ
from netgen.meshing import MeshingParameters, NgException

from footsense.errors import ModelError
from footsense.foot.gap_contact import CELLS_PER_SIDE
from footsense.foot.response_table import GRID_SIDE
from footsense.frames import ROWS, Vector
from footsense.lab.geometry import FootDesign

#: Coordinates closer than this are equal [mm].
EQUAL_WITHIN_MM = 1e-3
#: The two bodies, and the direction from the sheet into their rubber.
BODY_SIDES = (("ground", -1.0), ("leg", 1.0))
#: Radius of the ball and width of the bars that a `MeshSize` is stated for [mm].
_BALL_MM, _BAR_MM = 10.0, 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class MeshSize:
    """Element sizes [mm], layers and polynomial order of the mesh.

    Lengths are those in a ball of 10 mm with bars of 1 mm; in another foot they are in proportion.

    Attributes:
        ball_mm: In the hemispheres.
        plate_mm: In the plates.
        surface_mm: On the curved surface that touches the ground, where the response is read.
        bar_mm: Along the edges of the spacer's bars.
        grading: How fast elements may grow [1], smaller is finer.
        edge_layers: Layers of thin elements around singular edges.
        edge_layer_rel: Thickness of each over that of the next [1].
        order: Polynomial order of displacement and geometry.
    """

    ball_mm: float = 5.0
    plate_mm: float = 2.0
    surface_mm: float = 3.0
    bar_mm: float = 0.5
    grading: float = 0.6
    edge_layers: int = 1
    edge_layer_rel: float = 0.08
    order: int = 3

    def scaled_to_foot(self, design: FootDesign) -> "MeshSize":
        """Return the mesh sizes scaled to a foot: by its ball radius, and near the spacer's bars by the bar width."""
        ball_rel = design.ball_radius_mm / _BALL_MM
        return replace(
            self,
            ball_mm=self.ball_mm * ball_rel,
            plate_mm=self.plate_mm * ball_rel,
            surface_mm=self.surface_mm * ball_rel,
            bar_mm=self.bar_mm * (design.pitch_mm - design.electrode_mm) / _BAR_MM,
        )


#: Mesh of the released table.
RELEASED_MESH = MeshSize()
#: Mesh of the tests and of `--quick`: a second per class, and closures some 6 % too small.
COARSE_MESH = MeshSize(edge_layer_rel=0.15, bar_mm=0.67, order=2)
#: Reference for RELEASED_MESH: elements half as large at the bars, smaller elsewhere, and one edge layer more.
FINEST_MESH = MeshSize(
    ball_mm=4.0, plate_mm=1.5, surface_mm=2.5, bar_mm=0.25, grading=0.5, edge_layers=2, edge_layer_rel=0.12
)


def hemisphere(design: FootDesign, side: str, level_mm: float, *, quarter: bool) -> Any:
    """Return the ground-side or leg-side hemisphere, with material `rubber_<side>` and curved face `curved_<side>`.

    Args:
        design: The foot.
        side: `ground` or `leg`.
        level_mm: z of its flat face [mm], below 0 on the ground side.
        quarter: Whether to cut off x < 0 and y < 0.
    """
    centre, radius_mm = occ.Pnt(0, 0, level_mm), design.ball_radius_mm
    inward = -1.0 if level_mm > 0.0 else 1.0
    ball = occ.Sphere(centre, radius_mm) * occ.HalfSpace(centre, occ.Vec(0, 0, inward))
    for face in ball.faces:
        face.name = f"curved_{side}" if abs(face.center.z - level_mm) > 0.1 * radius_mm else "flat"
    if quarter:
        ball *= occ.Box(occ.Pnt(0, 0, -3.0 * radius_mm), occ.Pnt(*(3.0 * radius_mm,) * 3))
    ball.mat(f"rubber_{side}")
    return ball


def plate(
    name: str, corner_mm: tuple[float, float], half_mm: float, level_mm: tuple[float, float], edge_mm: float
) -> Any:
    """Return a square PDMS plate as a solid.

    Args:
        name: Name of the plate's material.
        corner_mm: Lowest x and y [mm].
        half_mm: Highest x and y [mm].
        level_mm: z of its lower and upper face [mm].
        edge_mm: Largest edge of its mesh [mm].
    """
    solid = occ.Box(occ.Pnt(*corner_mm, level_mm[0]), occ.Pnt(half_mm, half_mm, level_mm[1]))
    solid.mat(name)
    solid.maxh = edge_mm
    return solid


def bodies(design: FootDesign, plate_edge_mm: float, sheet_offset_mm: float, *, quarter: bool) -> list[Any]:
    """Return hemisphere and plate of the ground side, then of the leg side; the plates meet in the plane z = 0.

    Args:
        design: The foot.
        plate_edge_mm: Largest edge of the mesh in the plates [mm].
        sheet_offset_mm: x of the centre of the sheet, which stays in the origin, from the axis of the balls [mm].
        quarter: Whether to cut off x < 0 and y < 0.
    """
    half_mm, solids = design.sheet_mm / 2.0, []
    to_axis = occ.Vec(-sheet_offset_mm, 0.0, 0.0)
    lowest_mm = 0.0 if quarter else -half_mm
    for side, up in BODY_SIDES:
        flat_mm = up * design.plate_mm
        level_mm = (min(0.0, flat_mm), max(0.0, flat_mm))
        ball = hemisphere(design, side, flat_mm, quarter=quarter)
        solids.append(ball.Move(to_axis) if sheet_offset_mm else ball)
        solids.append(plate(f"pdms_{side}", (lowest_mm, lowest_mm), half_mm, level_mm, plate_edge_mm))
    return solids


def lies_in_coordinate_plane(part: Any, axis: str) -> bool:
    """Tell whether a face or an edge lies in the plane where a coordinate (`x`, `y`, `z`) is 0."""
    low, high = part.bounding_box
    return bool(max(abs(getattr(low, axis)), abs(getattr(high, axis))) < EQUAL_WITHIN_MM)


@dataclass(frozen=True, slots=True)
class CavityCell:
    """One square cell of an element's cavity.

    Attributes:
        name: Name of its face in the mesh.
        element: Element that it belongs to, flat index of the foot.
        row: Place in the grid of all cells along x, 0 the most forward.
        column: Place along y, 0 the leftmost.
        x_mm: Centre [mm].
        y_mm: Centre [mm].
    """

    name: str
    element: int
    row: int
    column: int
    x_mm: float
    y_mm: float


def cavity_cells(design: FootDesign, *, quarter: bool = True) -> list[CavityCell]:
    """Return the cavity cells of a foot, in flat order, or those of its quarter.

    Those of the quarter are in x > 0, y > 0; of an element on a mirror plane only those on this side.
    The mesh follows the last bit of a centre, so each kind keeps the sum that its tables were made with.
    """
    step = design.electrode_mm / CELLS_PER_SIDE
    cells: list[CavityCell] = []
    for element, (x_mm, y_mm) in enumerate(design.element_centres_mm):
        row, column = (CELLS_PER_SIDE * place for place in divmod(element, ROWS))
        for i in range(CELLS_PER_SIDE):
            for j in range(CELLS_PER_SIDE):
                x, y = (
                    centre_mm + design.electrode_mm / 2.0 - (k + 0.5) * step
                    if quarter
                    else centre_mm + (design.electrode_mm - step) / 2.0 - k * step
                    for centre_mm, k in ((x_mm, i), (y_mm, j))
                )
                if not quarter or (x > 0.0 and y > 0.0):
                    cells.append(CavityCell(f"cell{len(cells)}", element, row + i, column + j, x, y))
    return cells


def quarter_grid(per_cell: Vector, design: FootDesign, axis: int) -> Vector:
    """Return per-cell values of the quarter (in the order of `cavity_cells`) as a square grid in place of `axis`."""
    order = np.empty((GRID_SIDE // 2,) * 2, np.intp)
    for number, cell in enumerate(cavity_cells(design)):
        order[cell.row, cell.column] = number
    return np.take(per_cell, order, axis=axis)


def _cell_face(cell: CavityCell, side_mm: float) -> Any:
    """Return a cavity cell as a named square face in the spacer's plane."""
    corner = occ.Pnt(cell.x_mm - side_mm / 2.0, cell.y_mm - side_mm / 2.0, 0.0)
    face = occ.WorkPlane(occ.Axes(corner, n=occ.Z, h=occ.X)).Rectangle(side_mm, side_mm).Face()
    face.name = cell.name
    return face


def name_mirrors_and_size_ground(shape: Any, size: MeshSize) -> None:
    """Name the faces in the mirror planes, and set the element size on the ground-side surface."""
    for face in shape.faces:
        for axis in ("x", "y"):
            if lies_in_coordinate_plane(face, axis):
                face.name = f"mirror_{axis}"
        if face.name == "curved_ground":
            face.maxh = size.surface_mm


def _is_bar_edge(design: FootDesign, edge: Any) -> bool:
    """Tell whether an edge is the border between a spacer bar and a cavity, not the crossing of two bars."""
    low, high = edge.bounding_box
    start, end = design.bar_span_mm
    for axis, along in (("x", "y"), ("y", "x")):
        across = (getattr(low, axis), getattr(high, axis))
        on_border = any(
            abs(abs(value) - border) < EQUAL_WITHIN_MM for border in (start, end) for value in across
        )
        crossing = start < abs(getattr(edge.center, along)) < end
        if on_border and abs(across[0] - across[1]) < EQUAL_WITHIN_MM and not crossing:
            return lies_in_coordinate_plane(edge, "z")
    return False


def _is_sheet_border_edge(design: FootDesign, edge: Any) -> bool:
    """Tell whether an edge is the outer border of the sheet on a hemisphere."""
    low, high = edge.bounding_box
    level = all(abs(abs(end.z) - design.plate_mm) < EQUAL_WITHIN_MM for end in (low, high))
    from_axis_mm = max(abs(edge.center.x), abs(edge.center.y))
    return level and abs(from_axis_mm - design.sheet_mm / 2.0) < EQUAL_WITHIN_MM


def build_mesh(
    design: FootDesign, size: MeshSize, sheet_offset_mm: float = 0.0, *, quarter: bool = True
) -> Any:
    """Return the curved finite element mesh of a foot or of its quarter.

    Args:
        design: The foot.
        size: Largest edges.
        sheet_offset_mm: x of the centre of the sheet, which stays in the origin, from the axis of the balls [mm].
        quarter: Whether to mesh x > 0, y > 0 alone.

    Returns:
        The mesh, in mm, foot frame, origin in the middle of the spacer; faces "cell0".., `bars`, `curved_ground`,
        `curved_leg`, `mirror_x` (the plane x = 0), `mirror_y`.

    Raises:
        ModelError: The mesher gives up on this geometry.
    """
    size, step = size.scaled_to_foot(design), design.electrode_mm / CELLS_PER_SIDE
    solids = bodies(design, size.plate_mm, sheet_offset_mm, quarter=quarter)
    cells = cavity_cells(design, quarter=quarter)
    shape = occ.Glue([*solids, *(_cell_face(cell, step) for cell in cells)])
    for face in shape.faces:
        if lies_in_coordinate_plane(face, "z") and not (face.name or "").startswith("cell"):
            face.name = "bars"
    name_mirrors_and_size_ground(shape, size)
    for edge in shape.edges:
        if _is_bar_edge(design, edge):
            edge.maxh = size.bar_mm
            edge.hpref = 1
        elif quarter and _is_sheet_border_edge(design, edge):
            edge.hpref = 1
    return curved_mesh(shape, size)


def curved_mesh(shape: Any, size: MeshSize) -> Any:
    """Return the curved mesh of a shape, with layers of thin elements at marked edges (hp refinement).

    Raises:
        ModelError: The mesher fails.
    """
    try:
        parameters = MeshingParameters(maxh=size.ball_mm, grading=size.grading)
        mesh = ng.Mesh(occ.OCCGeometry(shape).GenerateMesh(parameters))
        if size.edge_layers:
            mesh.RefineHP(size.edge_layers, size.edge_layer_rel)
        mesh.Curve(size.order)
    except (NgException, RuntimeError) as error:
        raise ModelError(f"the foot cannot be meshed with {size}: {error}") from error
    return mesh
