"""Geometry shared by all meshes of the foot, and the call of the mesh generator with its errors translated."""

from typing import Any

import ngsolve as ng
from netgen import occ
from netgen.meshing import MeshingParameters, NgException

from footsense.errors import ModelError
from footsense.lab.geometry import FootDesign

#: Coordinates closer than this are equal [mm].
EQUAL_WITHIN_MM = 1e-3
#: The two bodies, and the direction from the sheet into their rubber.
BODY_SIDES = (("ground", -1.0), ("leg", 1.0))


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


def bodies(
    design: FootDesign,
    plate_edge_mm: float,
    sheet_offset_mm: tuple[float, float] = (0.0, 0.0),
    *,
    quarter: bool,
) -> list[Any]:
    """Return hemisphere and plate of the ground side, then of the leg side; the plates meet in the plane z = 0.

    Args:
        design: The foot.
        plate_edge_mm: Largest edge of the mesh in the plates [mm].
        sheet_offset_mm: Centre of the sheet, which stays in the origin, from the axis of the balls [mm].
        quarter: Whether to cut off x < 0 and y < 0.
    """
    half_mm, solids = design.sheet_mm / 2.0, []
    to_axis = occ.Vec(-sheet_offset_mm[0], -sheet_offset_mm[1], 0.0)
    lowest_mm = 0.0 if quarter else -half_mm
    for side, up in BODY_SIDES:
        flat_mm = up * design.plate_mm
        level_mm = (min(0.0, flat_mm), max(0.0, flat_mm))
        ball = hemisphere(design, side, flat_mm, quarter=quarter)
        solids.append(ball.Move(to_axis) if any(sheet_offset_mm) else ball)
        solids.append(plate(f"pdms_{side}", (lowest_mm, lowest_mm), half_mm, level_mm, plate_edge_mm))
    return solids


def lies_in_coordinate_plane(part: Any, axis: str) -> bool:
    """Tell whether a face or an edge lies in the plane where a coordinate (`x`, `y`, `z`) is 0."""
    low, high = part.bounding_box
    return bool(max(abs(getattr(low, axis)), abs(getattr(high, axis))) < EQUAL_WITHIN_MM)


def square(x_mm: float, y_mm: float, side_mm: float) -> Any:
    """Return a square face in the plane z = 0, centred at x and y [mm]."""
    corner = occ.Pnt(x_mm - side_mm / 2.0, y_mm - side_mm / 2.0, 0.0)
    return occ.WorkPlane(occ.Axes(corner, n=occ.Z, h=occ.X)).Rectangle(side_mm, side_mm).Face()


def curved_mesh(
    shape: Any,
    parameters: MeshingParameters,
    order: int,
    *,
    edge_layers: int = 0,
    edge_layer_rel: float = 0.0,
) -> Any:
    """Return the curved mesh of a shape; raise ModelError if the mesh generator fails.

    Args:
        shape: The shape.
        parameters: Parameters of the mesher.
        order: Polynomial order of the geometry.
        edge_layers: Layers of thin elements at marked edges (hp refinement).
        edge_layer_rel: Thickness of each over that of the next [1].

    Raises:
        ModelError: The mesher fails.
    """
    try:
        mesh = ng.Mesh(occ.OCCGeometry(shape).GenerateMesh(parameters))
        if edge_layers:
            mesh.RefineHP(edge_layers, edge_layer_rel)
        mesh.Curve(order)
    except (NgException, RuntimeError) as error:
        raise ModelError(f"the foot cannot be meshed: {error}") from error
    return mesh
