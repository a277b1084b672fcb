"""Finite element model of a whole, unsymmetric foot, for assembly errors that break the symmetry.

The sheet stays where it is, the balls move. What an imperfection changes is added to the released table, so that the
error of the coarse mesh of a whole foot cancels:

    table of the imperfect foot = released table + (imperfect - as designed), both on meshes of that size

Bonds are linear: a bar that is not bonded also bears no pressure.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import msgspec
import ngsolve as ng
import numpy as np
from netgen import occ
from netgen.meshing import MeshingParameters

from footsense.foot.directions import normalized
from footsense.foot.gap_contact import CELLS_PER_SIDE, N_CELLS
from footsense.foot.response_table import FLAT_OF_GRID, GRID_SIDE, FootResponse, series_basis
from footsense.frames import Vector
from footsense.lab.fem.adjoint import SURFACE_QUADRATURE_ORDER
from footsense.lab.fem.elasticity import BondedLayer, mixed_strain_energy_density, strain_energy_density
from footsense.lab.fem.mesh import COARSE_MESH, MeshSize, is_bar_edge, name_bar_faces
from footsense.lab.fem.solids import BODY_SIDES, curved_mesh, hemisphere, plate, square
from footsense.lab.geometry import (
    MIN_FITTED_ELEVATION_DEG,
    MIN_TABLE_ELEVATION_DEG,
    UM_PER_MM,
    FootDesign,
    ThinFilm,
)
from footsense.lab.response import (
    FITTED_PATCH_RADIUS_REL,
    SERIES_DEGREE,
    make_response,
    mean_over_patch,
    spherical_cap_normals,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Imperfection:
    """Assembly errors of a foot: offset sheet, partly bonded bar.

    Attributes:
        sheet_offset_mm: Centre of the sheet from the axis of the balls, along x and y [mm].
        bonded_width_share: Share of its width over which the bar between front and middle row is bonded [1].
    """

    sheet_offset_mm: tuple[float, float] = (0.0, 0.0)
    bonded_width_share: float = 1.0


#: Put together as designed.
NO_IMPERFECTION = Imperfection()


def _mesh(design: FootDesign, size: MeshSize, imperfection: Imperfection) -> Any:
    """Return the curved mesh of the whole foot; faces "cell0".. in flat order, `bars`, `curved_ground`, `curved_leg`.

    Raises:
        ModelError: The mesher gives up.
    """
    size, half = size.scaled_to_foot(design), design.sheet_mm / 2.0
    offset_x, offset_y = imperfection.sheet_offset_mm
    solids = []
    for side, up in BODY_SIDES:
        ball = hemisphere(design, side, up * design.plate_mm, quarter=False)
        ball = ball.Move(occ.Vec(-offset_x, -offset_y, 0.0))
        level_mm = (min(0.0, up * design.plate_mm), max(0.0, up * design.plate_mm))
        solids += [ball, plate(f"pdms_{side}", (-half, -half), half, level_mm, size.plate_mm)]
    step, inside = (
        design.electrode_mm / CELLS_PER_SIDE,
        (design.electrode_mm - design.electrode_mm / CELLS_PER_SIDE) / 2.0,
    )
    for x_mm, y_mm in design.element_centres_mm:
        for cell in range(CELLS_PER_SIDE**2):
            forward, leftward = divmod(cell, CELLS_PER_SIDE)
            face = square(x_mm + inside - forward * step, y_mm + inside - leftward * step, step)
            face.name = f"cell{len(solids) - 4}"
            solids.append(face)
    shape = occ.Glue(solids)
    name_bar_faces(shape)
    for face in shape.faces:
        if face.name == "curved_ground":
            face.maxh = size.surface_mm
    for edge in shape.edges:
        if is_bar_edge(design, edge):
            edge.maxh, edge.hpref = size.bar_mm, 1
    parameters = MeshingParameters(maxh=size.ball_mm, grading=size.grading)
    return curved_mesh(
        shape,
        parameters,
        size.order,
        edge_layers=size.edge_layers,
        edge_layer_rel=size.edge_layer_rel,
    )


def solve_whole_foot(
    design: FootDesign, imperfection: Imperfection, size: MeshSize = COARSE_MESH
) -> tuple[Vector, Vector]:
    """Return response series [um/N], (products, 324, 3), and compliance [um/N], (324, 324), of a whole foot.

    Args:
        design: The foot.
        imperfection: Its imperfections.
        size: Resolution of the mesh.

    Raises:
        ModelError: The foot cannot be meshed.
    """
    mesh = _mesh(design, size, imperfection)
    order = size.order
    ground = ng.VectorH1(mesh, order=order, definedon="rubber_ground|pdms_ground")
    leg = ng.VectorH1(mesh, order=order, definedon="rubber_leg|pdms_leg", dirichlet="curved_leg")
    p_ground, p_leg = (ng.H1(mesh, order=order - 1, definedon=f"rubber_{side}") for side, _ in BODY_SIDES)
    space = ground * leg * p_ground * p_leg
    (u_ground, u_leg, p_g, p_l), (v_ground, v_leg, *_) = space.TnT()
    form = ng.BilinearForm(space, symmetric=True)
    for side, u, p in (("ground", u_ground, p_g), ("leg", u_leg, p_l)):
        form += ng.Variation(mixed_strain_energy_density(design.rubber, u, p) * ng.dx(f"rubber_{side}"))
        form += ng.Variation(strain_energy_density(design.pdms, u) * ng.dx(f"pdms_{side}"))
    inner, outer = design.half_axis_bar_spans_mm[-1]
    in_bar = ng.IfPos(ng.x - inner, ng.IfPos(outer - ng.x, 1.0, 0.0), 0.0)
    layer = BondedLayer(design.pdms, design.spacer_mm)
    bonded = 1.0 - (1.0 - imperfection.bonded_width_share) * in_bar
    form += bonded * layer.traction(u_ground - u_leg) * (v_ground - v_leg) * ng.ds(layer.face_pattern)
    points = mesh.MapToAllElements(
        ng.IntegrationRule(ng.TRIG, SURFACE_QUADRATURE_ORDER), mesh.Boundaries("curved_ground")
    )
    rule = ng.IntegrationRule(ng.TRIG, SURFACE_QUADRATURE_ORDER)
    centre = ng.CF((-imperfection.sheet_offset_mm[0], -imperfection.sheet_offset_mm[1], -design.plate_mm))
    normal = -normalized(np.asarray((ng.CF((ng.x, ng.y, ng.z)) - centre)(points)))
    jacobian = np.asarray(ng.specialcf.JacobianMatrix(3, 2)(points)).reshape(-1, 3, 2)
    area = np.linalg.norm(np.cross(jacobian[:, :, 0], jacobian[:, :, 1]), axis=1)
    weight = area * np.tile(np.asarray(rule.weights), len(area) // len(rule.weights))
    with ng.TaskManager():
        form.Assemble()
        inverse = form.mat.Inverse(space.FreeDofs(), "sparsecholesky")
        functionals = []
        for cell in range(N_CELLS):
            functional = ng.LinearForm(space)
            functional += (v_ground[2] - v_leg[2]) / design.cavity_cell_area_mm2 * ng.ds(f"cell{cell}")
            functionals.append(functional.Assemble())
        rows = np.stack([functional.vec.FV().NumPy() for functional in functionals])
        field = ng.GridFunction(space)
        influence, compliance = [], []
        for functional in functionals:
            field.vec.data = inverse * functional.vec
            influence.append(np.asarray(field.components[0](points)))
            compliance.append(rows @ field.vec.FV().NumPy())
    used = normal[:, 2] >= np.sin(np.radians(MIN_FITTED_ELEVATION_DEG))
    root = np.sqrt(weight[used])[:, None]
    basis = series_basis(normal[used], SERIES_DEGREE, MIN_FITTED_ELEVATION_DEG) * root
    sampled = np.stack(influence, axis=1)[used] * root[:, :, None] * UM_PER_MM
    series = np.linalg.lstsq(basis, sampled.reshape(len(basis), -1), rcond=1e-10)[0]
    whole = np.stack(compliance) * UM_PER_MM
    return series.reshape(len(series), -1, 3), (whole + whole.T) / 2.0


def with_added_response(
    response: FootResponse, design: FootDesign, series: Vector, compliance: Vector
) -> FootResponse:
    """Return a response table with a change of series and compliance added.

    Args:
        response: The released table.
        design: Its foot.
        series: Change of the series of G0 [um/N], shape (products, 324, 3).
        compliance: Change of the compliance [um/N], shape (324, 324).
    """
    flat = series.reshape(len(series), -1)
    normal, patch_mm = (
        spherical_cap_normals(MIN_TABLE_ELEVATION_DEG),
        FITTED_PATCH_RADIUS_REL * design.ball_radius_mm,
    )
    basis = series_basis(normal, SERIES_DEGREE, MIN_FITTED_ELEVATION_DEG)
    growth = (mean_over_patch(flat, normal, patch_mm, design) - basis @ flat) / patch_mm**2
    patch = np.linalg.lstsq(basis, growth, rcond=1e-10)[0].reshape(series.shape)
    whole = response.closure_coefficients.reshape(2, len(series), 3, -1).transpose(0, 1, 3, 2) + np.stack(
        [series, patch]
    )
    order = FLAT_OF_GRID.ravel()
    stiff = (response.compliance_um_per_n + compliance)[np.ix_(order, order)]
    return replace(
        response,
        quarter_series=whole[:, :, FLAT_OF_GRID],
        quarter_compliance=stiff.reshape((GRID_SIDE,) * 4),
        sha256="",
    )


#: What differs, by name; the first is what whole feet are compared with.
_SOLIDS: dict[str, Imperfection | ThinFilm] = {
    "designed": NO_IMPERFECTION,
    "gold": ThinFilm(thickness_um=0.1, youngs_mpa=79e3, poisson=0.42),
    "sheet_off_centre": Imperfection(sheet_offset_mm=(0.6, 0.0)),
    "bar_not_bonded": Imperfection(bonded_width_share=0.01),
}


def other_tables(
    design: FootDesign,
    response: FootResponse,
    each: Callable[[Callable[[Any], Any], Iterable[Any]], list[Any]],
) -> dict[str, FootResponse]:
    """Return the tables of `gold`, which stiffens the plates, `sheet_off_centre` and `bar_not_bonded`.

    Args:
        design: The released foot.
        response: Its table.
        each: Applies a function to each of some parts, such as `compute_each`.
    """
    solved = dict(zip(_SOLIDS, each(partial(_solve, design, response), _SOLIDS.values()), strict=True))
    series, compliance = solved.pop("designed")
    return {
        name: one
        if isinstance(one, FootResponse)
        else with_added_response(response, design, one[0] - series, one[1] - compliance)
        for name, one in solved.items()
    }


def _solve(design: FootDesign, response: FootResponse, change: Imperfection | ThinFilm) -> Any:
    """Return series and compliance of an imperfect whole foot, or the table of one with stiffer plates."""
    if isinstance(change, ThinFilm):
        return gilded_table(design, response, change)
    return solve_whole_foot(design, change)


def gilded_table(design: FootDesign, response: FootResponse, gold: ThinFilm) -> FootResponse:
    """Return the response table of a foot whose plates are stiffened by a film."""
    gilded, bare = (
        make_response(one, COARSE_MESH) for one in (msgspec.structs.replace(design, gold=gold), design)
    )
    return replace(
        response,
        quarter_series=response.quarter_series + gilded.quarter_series - bare.quarter_series,
        quarter_compliance=response.quarter_compliance + gilded.quarter_compliance - bare.quarter_compliance,
    )
