"""The mesh of a quarter of the foot, x > 0 and y > 0: coarse where the solid is smooth, graded where it is singular.

The stress is singular at the edges of the spacer's bars and where the sheet's rim meets the hemispheres. Halving the
elements there gains a factor of two in error for eight times the work; instead the edges get one layer of thin
elements (hp refinement) under cubic displacements. The cavities are cut into square cells, on which gap closure
and contact pressure live, and the mesh follows them.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import ngsolve as ng
from netgen import occ
from netgen.meshing import NgException

from footsense.errors import ModelError
from footsense.foot.gap_contact import CELLS_PER_SIDE
from footsense.lab.geometry import FootDesign

#: Coordinates closer than this are equal [mm].
_NEAR_MM = 1e-3
#: Nothing of a foot may be thinner [mm]: faces closer than `_NEAR_MM` could not be told apart.
_THINNEST_MM = _NEAR_MM
#: Radius of the ball and width of the bars that a `MeshSize` is stated for [mm].
_BALL_MM, _BAR_MM = 10.0, 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class MeshSize:
    """How fine the mesh is: largest edge lengths [mm], layers, order.

    Lengths are those in a ball of 10 mm with bars of 1 mm; in another foot they are in proportion.

    Attributes:
        ball_mm: In the hemispheres.
        plate_mm: In the plates.
        surface_mm: On the curved surface that touches the ground, where the response is read.
        bar_mm: Along the edges of the spacer's bars.
        grading: How fast elements may grow [1], smaller is finer.
        layers: Layers of thin elements around singular edges.
        layer_rel: Thickness of each over that of the next [1].
        order: Polynomial order of displacement and geometry.
    """

    ball_mm: float = 5.0
    plate_mm: float = 2.0
    surface_mm: float = 3.0
    bar_mm: float = 0.5
    grading: float = 0.6
    layers: int = 1
    layer_rel: float = 0.08
    order: int = 3

    def in_foot(self, design: FootDesign) -> "MeshSize":
        """Return the lengths in a foot: by the radius of its ball and the width of its bars."""
        ball_rel = design.ball_radius_mm / _BALL_MM
        return replace(
            self,
            ball_mm=self.ball_mm * ball_rel,
            plate_mm=self.plate_mm * ball_rel,
            surface_mm=self.surface_mm * ball_rel,
            bar_mm=self.bar_mm * (design.pitch_mm - design.electrode_mm) / _BAR_MM,
        )


#: What the released table is made with.
SHIPPED = MeshSize()
#: What the tests and `--quick` use: a second per class, and closures some 6 % too small.
COARSE = MeshSize(layer_rel=0.15, bar_mm=0.67, order=2)
#: What SHIPPED is judged by: elements half as large at the bars, smaller elsewhere, and one layer more.
FINEST = MeshSize(
    ball_mm=4.0, plate_mm=1.5, surface_mm=2.5, bar_mm=0.25, grading=0.5, layers=2, layer_rel=0.12
)


@dataclass(frozen=True, slots=True)
class Cell:
    """One square cell of a cavity in the quarter.

    Attributes:
        name: Name of its face in the mesh.
        element: Element that it belongs to, flat index of the foot.
        forward: Place in the element along x, 0 the most forward.
        leftward: Place along y, 0 the leftmost.
        x_mm: Centre [mm].
        y_mm: Centre [mm].
    """

    name: str
    element: int
    forward: int
    leftward: int
    x_mm: float
    y_mm: float

    @property
    def index(self) -> int:
        """Flat index among the cells of the whole foot."""
        return (self.element * CELLS_PER_SIDE + self.forward) * CELLS_PER_SIDE + self.leftward


def quarter_cells(design: FootDesign) -> list[Cell]:
    """Return the cells of the quarter x > 0, y > 0: a quarter of the middle element, halves of two, a corner."""
    step = design.electrode_mm / CELLS_PER_SIDE
    cells: list[Cell] = []
    for element, (x_mm, y_mm) in enumerate(design.centres_mm):
        for i in range(CELLS_PER_SIDE):
            for j in range(CELLS_PER_SIDE):
                x = x_mm + design.electrode_mm / 2.0 - (i + 0.5) * step
                y = y_mm + design.electrode_mm / 2.0 - (j + 0.5) * step
                if x > 0.0 and y > 0.0:
                    cells.append(Cell(f"cell{len(cells)}", element, i, j, x, y))
    return cells


def _half(design: FootDesign, side: str, up: float, size: MeshSize) -> Iterator[Any]:
    """Yield hemisphere and plate of the `ground` (up = -1) or `leg` (up = +1) side, named for the weak form."""
    flat, wide = up * design.plate_mm, 3.0 * design.ball_radius_mm
    ball = occ.Sphere(occ.Pnt(0, 0, flat), design.ball_radius_mm) * occ.HalfSpace(
        occ.Pnt(0, 0, flat), occ.Vec(0, 0, -up)
    )
    for face in ball.faces:
        face.name = f"curved_{side}" if abs(face.center.z - flat) > 0.1 * design.ball_radius_mm else "flat"
    ball *= occ.Box(occ.Pnt(0, 0, -wide), occ.Pnt(wide, wide, wide))
    ball.mat(f"rubber_{side}")
    yield ball
    half = design.sheet_mm / 2.0
    plate = occ.Box(occ.Pnt(0, 0, min(0.0, flat)), occ.Pnt(half, half, max(0.0, flat)))
    plate.mat(f"pdms_{side}")
    plate.maxh = size.plate_mm
    yield plate


def _cell_face(cell: Cell, side_mm: float) -> Any:
    """Return a cell as a named face in the plane of the spacer."""
    corner = occ.Pnt(cell.x_mm - side_mm / 2.0, cell.y_mm - side_mm / 2.0, 0.0)
    face = occ.WorkPlane(occ.Axes(corner, n=occ.Z, h=occ.X)).Rectangle(side_mm, side_mm).Face()
    face.name = cell.name
    return face


def _name_faces(shape: Any, size: MeshSize) -> None:
    """Name bars and mirror planes, and set the size on the surface that touches the ground."""
    for face in shape.faces:
        low, high = face.bounding_box
        if max(abs(low.z), abs(high.z)) < _NEAR_MM and not (face.name or "").startswith("cell"):
            face.name = "bars"
        for axis in ("x", "y"):
            if max(abs(getattr(low, axis)), abs(getattr(high, axis))) < _NEAR_MM:
                face.name = f"mirror_{axis}"
        if face.name == "curved_ground":
            face.maxh = size.surface_mm


def _is_bar_edge(design: FootDesign, edge: Any) -> bool:
    """Tell whether an edge is the border of a bar against a cavity, and not inside the crossing of two bars."""
    low, high = edge.bounding_box
    borders = (design.electrode_mm / 2.0, design.pitch_mm - design.electrode_mm / 2.0)
    for axis, along in (("x", "y"), ("y", "x")):
        across = (getattr(low, axis), getattr(high, axis))
        on_border = any(abs(value - border) < _NEAR_MM for border in borders for value in across)
        middle = getattr(edge.center, along)
        crossing = borders[0] < middle < borders[1]
        if on_border and abs(across[0] - across[1]) < _NEAR_MM and not crossing:
            return bool(max(abs(low.z), abs(high.z)) < _NEAR_MM)
    return False


def _is_rim(design: FootDesign, edge: Any) -> bool:
    """Tell whether an edge is the sheet's outer border against a hemisphere."""
    low, high = edge.bounding_box
    level = all(abs(abs(end.z) - design.plate_mm) < _NEAR_MM for end in (low, high))
    at_border = max(abs(edge.center.x), abs(edge.center.y)) > design.sheet_mm / 2.0 - _NEAR_MM
    return (
        level and at_border and max(abs(edge.center.x), abs(edge.center.y)) < design.sheet_mm / 2.0 + _NEAR_MM
    )


def build_mesh(design: FootDesign, size: MeshSize) -> Any:
    """Return the curved mesh of the quarter.

    Args:
        design: The foot.
        size: How fine.

    Returns:
        The mesh, in mm, foot frame, origin in the middle of the spacer; faces `cell0`.., `bars`, `curved_ground`,
        `curved_leg`, `mirror_x` (the plane x = 0), `mirror_y`.

    Raises:
        ModelError: A part is thinner than a micrometre, or the mesher gives up on this geometry.
    """
    thinnest_mm = min(design.plate_mm, design.spacer_mm, design.electrode_mm, design.ball_radius_mm)
    if not thinnest_mm > _THINNEST_MM:  # NaN is refused too
        raise ModelError(f"no part of a foot is thinner than {_THINNEST_MM:g} mm, got {design}")
    size, step = size.in_foot(design), design.electrode_mm / CELLS_PER_SIDE
    solids = [*_half(design, "ground", -1.0, size), *_half(design, "leg", 1.0, size)]
    shape = occ.Glue([*solids, *(_cell_face(cell, step) for cell in quarter_cells(design))])
    _name_faces(shape, size)
    for edge in shape.edges:
        if _is_bar_edge(design, edge):
            edge.maxh = size.bar_mm
            edge.hpref = 1
        elif _is_rim(design, edge):
            edge.hpref = 1
    try:
        mesh = ng.Mesh(occ.OCCGeometry(shape).GenerateMesh(maxh=size.ball_mm, grading=size.grading))
        if size.layers:
            mesh.RefineHP(size.layers, size.layer_rel)
        mesh.Curve(size.order)
    except (NgException, RuntimeError) as error:
        raise ModelError(
            f"the foot cannot be meshed with {size}: {error}; check the sizes of {design}"
        ) from error
    return mesh
