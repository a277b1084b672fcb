"""Mesh of one load case: both hemispheres with their plates, refined at the contact and at the cavities' edges.

The stress is singular along the edges of the bars. One level of hp refinement there (prisms that shrink towards
the edge) resolves that for a few hundred elements. If load and foot are mirrored by the plane y = 0, the half
with y > 0 is meshed.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from netgen import occ
from netgen.meshing import MeshingParameters

from footsense.foot.directions import tangent_frame
from footsense.frames import Vector
from footsense.lab.fem.solids import EQUAL_WITHIN_MM, bodies, curved_mesh, lies_in_coordinate_plane, square
from footsense.lab.geometry import FootDesign

#: The mesh is fine out to this many radii of the expected contact patch: finite strain and friction shift it.
REFINED_RADIUS_OVER_PATCH = 1.3


@dataclass(frozen=True, slots=True, kw_only=True)
class ContactMeshSize:
    """Element sizes [mm] and polynomial order of the finite-strain contact mesh.

    Attributes:
        ball_mm: Largest edge in the hemispheres [mm].
        plate_mm: Largest edge in the plates [mm].
        bar_mm: Largest edge along the edges of the bars [mm].
        edge_layer_rel: Where the hp refinement cuts the elements at a bar's edge, over their size [1].
        patch_element_rel: Edge where the floor touches, over the Hertz radius [1].
        order: Polynomial order of displacement and geometry; the pressure has one less.
    """

    ball_mm: float = 2.5
    plate_mm: float = 1.5
    bar_mm: float = 0.5
    edge_layer_rel: float = 0.15
    patch_element_rel: float = 0.3
    order: int = 2


def _cut_at_y0(shape: Any) -> list[Any]:
    """Return the part of a shape with y > 0, as a list of one shape or none."""
    low, high = shape.bounding_box
    if high.y < EQUAL_WITHIN_MM:
        return []
    # Cutting a face that needs no cut would lose it.
    return (
        [shape] if low.y > -EQUAL_WITHIN_MM else [shape * occ.HalfSpace(occ.Pnt(0, 0, 0), occ.Vec(0, -1, 0))]
    )


def _in_cavity(design: FootDesign, low: Any, high: Any) -> bool:
    """Return whether a box in the plane z = 0 lies in a cavity of the spacer."""
    reach = design.electrode_mm / 2.0 + EQUAL_WITHIN_MM
    return any(
        max(x_mm - low.x, high.x - x_mm, y_mm - low.y, high.y - y_mm) < reach
        for x_mm, y_mm in design.element_centres_mm
    )


def _name_faces(shape: Any, design: FootDesign) -> None:
    """Name the faces that the weak form uses: `cavity`, `bars` (bonded) and `mirror`; all others stay free."""
    for face in shape.faces:
        low, high = face.bounding_box
        if lies_in_coordinate_plane(face, "z"):
            face.name = "cavity" if _in_cavity(design, low, high) else "bars"
        elif lies_in_coordinate_plane(face, "y"):
            face.name = "mirror"


def _refine_at_bar_edges(shape: Any, design: FootDesign, size: ContactMeshSize) -> None:
    """Mark the edges between cavities and bars for hp refinement, except on the sheet's border."""
    inside = design.sheet_mm / 2.0 - EQUAL_WITHIN_MM
    for edge in shape.edges:
        low, high = edge.bounding_box
        if not lies_in_coordinate_plane(edge, "z"):
            continue
        for start, end in ((low.x, high.x), (low.y, high.y)):
            if abs(end - start) < EQUAL_WITHIN_MM < abs(start) < inside:
                edge.hpref = 1
                edge.maxh = size.bar_mm


def _refine_patch(
    parameters: MeshingParameters,
    design: FootDesign,
    normal: Vector,
    size_mm: float,
    reach_mm: float,
) -> None:
    """Set the element size to `size_mm` within `reach_mm` of the contact point."""
    first, second = tangent_frame(normal)
    centre = np.array([0.0, 0.0, -design.plate_mm])
    steps = np.arange(-np.ceil(reach_mm / size_mm), np.ceil(reach_mm / size_mm) + 1.0) * size_mm
    for along in steps:
        for across in steps:
            depth_squared = design.ball_radius_mm**2 - along**2 - across**2
            if along**2 + across**2 <= reach_mm**2:
                point = centre - np.sqrt(depth_squared) * normal + along * first + across * second
                parameters.RestrictH(*map(float, point), size_mm)


def build_mesh(
    design: FootDesign, size: ContactMeshSize, normal: Vector, patch_mm: float, *, is_half_foot: bool
) -> Any:
    """Return the curved mesh of the foot [mm, foot frame, origin in the middle of the spacer].

    Args:
        design: The foot.
        size: Largest edges.
        normal: Inward unit normal at the contact [1], shape (3,).
        patch_mm: Expected radius of the contact patch [mm].
        is_half_foot: Mesh only y > 0, with the face `mirror` in y = 0.

    Returns:
        An NGSolve mesh of the materials `rubber_ground`, `pdms_ground`, `rubber_leg`, `pdms_leg`.
    """
    cavities = [square(*centre_mm, design.electrode_mm) for centre_mm in design.element_centres_mm]
    shapes = [*bodies(design, size.plate_mm, quarter=False), *cavities]
    if is_half_foot:
        shapes = [part for shape in shapes for part in _cut_at_y0(shape)]
    shape = occ.Glue(shapes)
    _name_faces(shape, design)
    _refine_at_bar_edges(shape, design, size)
    parameters = MeshingParameters(maxh=size.ball_mm, grading=0.4)
    _refine_patch(
        parameters, design, normal, size.patch_element_rel * patch_mm, REFINED_RADIUS_OVER_PATCH * patch_mm
    )
    return curved_mesh(shape, parameters, size.order, edge_layers=1, edge_layer_rel=size.edge_layer_rel)
