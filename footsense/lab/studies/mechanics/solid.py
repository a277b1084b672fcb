"""Study `solid`: numerical errors of the finite element model and the capacitor model, and of each simplification."""

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeVar

import numpy as np
from matplotlib.figure import Figure

from footsense.foot.directions import directions
from footsense.foot.gap_contact import CELLS_PER_SIDE
from footsense.foot.response_table import FootResponse, contact_radius_mm
from footsense.frames import Vector
from footsense.lab.fem.centred import solve_centred_closures
from footsense.lab.fem.cross_sections import cavity_strip_closure_um, fringed_and_plate_capacitance_pf
from footsense.lab.fem.mesh import COARSE_MESH, FINEST_MESH, RELEASED_MESH, MeshSize
from footsense.lab.former_page import Plots, Study, StudyContext
from footsense.lab.geometry import FootDesign, Material
from footsense.lab.plots import subplot_row
from footsense.lab.response import make_response
from footsense.lab.training.load_cases import paper_training, paper_verification

Measured = TypeVar("Measured")

#: The paper's floor (section III A).
CEMENT = Material(25_000.0, 0.15)
#: The inclined load: the lowest of the paper's.
INCLINED_LOAD_ELEVATION_DEG = 40.0
#: Elements that close less than this share of the most closed one are left out of relative errors.
MIN_COUNTED_CLOSURE_REL = 0.05
_UNREFINED_MESH = MeshSize(bar_mm=0.67, edge_layers=0, order=2)
#: The reference of the inclined load, which needs two classes, is `finer`.
_MESH_SIZES = {
    "quadratic, no layers": _UNREFINED_MESH,
    "quadratic, no layers, finer": replace(_UNREFINED_MESH, bar_mm=0.33),
    "COARSE": COARSE_MESH,
    "SHIPPED": RELEASED_MESH,
    "finer": replace(RELEASED_MESH, bar_mm=0.33, edge_layers=2, edge_layer_rel=0.12),
    "FINEST": FINEST_MESH,
}
_QUICK_MESH_NAMES = ("quadratic, no layers", "COARSE")


@dataclass(frozen=True, slots=True, kw_only=True)
class ComputeTime:
    """Wall-clock and processor time of one step [s].

    Attributes:
        wall_s: Wall-clock time [s].
        processor_s: Time of all processors [s].
    """

    wall_s: float
    processor_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class MeshResult(ComputeTime):
    """Number of unknowns, computing time and error of one mesh.

    Attributes:
        name: Name of the mesh.
        order: Polynomial order of the elements.
        unknowns: Number of unknowns of the equations.
        corner_closure_um: Closure of a corner under the upright load [um].
        max_closure_error_rel_per_load: Largest relative error of a closure [1], upright and inclined.
    """

    name: str
    order: int
    unknowns: int
    corner_closure_um: float
    max_closure_error_rel_per_load: list[float]


@dataclass(frozen=True, slots=True, kw_only=True)
class HertzContact:
    """Hertz radius and corner closure at 1 N on ground of one material.

    Attributes:
        contact_modulus_mpa: E* of the contact [MPa].
        radius_mm: Radius of the patch [mm].
        corner_closure_um: Closure of a corner [um].
    """

    contact_modulus_mpa: float
    radius_mm: float
    corner_closure_um: float


@dataclass(frozen=True, slots=True)
class FringeResult:
    """Capacitance of an element with and without fringe field [pF], and the closures derived from both [um].

    Attributes:
        closure_um: Closure of the gap [um].
        plate_formula_pf: Capacitance by the plate formula [pF].
        with_fringe_pf: Capacitance with edges [pF].
        elastance_closure_um: Closure by elastance [um].
        stray_corrected_closure_um: Closure by elastance with the stray taken off [um].
    """

    closure_um: float
    plate_formula_pf: float
    with_fringe_pf: float
    elastance_closure_um: float
    stray_corrected_closure_um: float


@dataclass(frozen=True, kw_only=True)
class Results:
    """Results of the study `solid`: errors of meshes, response table, ground, spacer and capacitors.

    Attributes:
        meshes: The meshes, the coarsest first.
        response: Time of the complete response; None in the quick form.
        cases: Time of the paper's cases with contact.
        n_cases: Number of these cases.
        contacts_by_ground: Contact with the ground, by its material.
        max_closure_change_by_ground_rel: Largest relative change of a closure by the material of the ground [1].
        spacer_mm: Thickness of the spacer [mm].
        strip_closure_by_traction_law_um: Closure of a strip with the spacer as a law [um].
        strip_closure_meshed_spacer_um: Closure of a strip with the spacer meshed [um].
        fringe: Elements with edges, unloaded first.
        table_errors_rel: Errors that the response table states [1].
        max_in_cell_closure_rms_um: Largest variation of the closure inside a cell, rms [um].
    """

    meshes: list[MeshResult]
    response: ComputeTime | None
    cases: ComputeTime
    n_cases: int
    contacts_by_ground: dict[str, HertzContact]
    max_closure_change_by_ground_rel: float
    spacer_mm: float
    strip_closure_by_traction_law_um: float
    strip_closure_meshed_spacer_um: float
    fringe: list[FringeResult]
    table_errors_rel: dict[str, float]
    max_in_cell_closure_rms_um: float


def _timed(step: Callable[[], Measured]) -> tuple[Measured, ComputeTime]:
    """Return the result of a step, and its wall-clock and processor time [s]."""
    before = os.times()
    result = step()
    after = os.times()
    processor_s = after.user + after.system - before.user - before.system
    return result, ComputeTime(wall_s=after.elapsed - before.elapsed, processor_s=processor_s)


def _largest_relative_error(closure_um: Vector, best_um: Vector) -> float:
    """Return the largest relative closure error of the elements that close enough to count [1]."""
    counted = np.abs(best_um) > MIN_COUNTED_CLOSURE_REL * np.abs(best_um).max()
    return float(np.abs(closure_um / best_um - 1.0)[counted].max())


def _solve_meshes(context: StudyContext) -> list[MeshResult]:
    """Return size, time and error of every mesh; the quick form leaves out the fine ones."""
    solved = []
    for name, size in _MESH_SIZES.items():
        if context.quick and name not in _QUICK_MESH_NAMES:
            continue
        elevation_deg = (
            (90.0,) if context.quick or size is FINEST_MESH else (90.0, INCLINED_LOAD_ELEVATION_DEG)
        )
        found, taken = _timed(partial(solve_centred_closures, context.foot_design, size, elevation_deg))
        solved.append((name, size, found, taken))
        context.report_progress(f"solid: {name}, {found.n_unknowns} unknowns, {taken.processor_s:.1f} s")
    best = [solved[-1][2].closure_um_per_n[0], solved[-1 if context.quick else -2][2].closure_um_per_n[-1]]
    return [
        MeshResult(
            wall_s=taken.wall_s,
            processor_s=taken.processor_s,
            name=name,
            order=size.order,
            unknowns=found.n_unknowns,
            corner_closure_um=found.closure_um_per_n[0].max(),
            max_closure_error_rel_per_load=[
                _largest_relative_error(own, of)
                for own, of in zip(found.closure_um_per_n, best, strict=False)
            ],
        )
        for name, size, found, taken in solved
    ]


def _compare_ground_materials(
    foot_design: FootDesign, response: FootResponse
) -> tuple[dict[str, HertzContact], float]:
    """Return the contacts with rigid ground and with cement at 1 N, and the largest relative change of a closure."""
    rubber = foot_design.rubber
    both_mpa = 1.0 / (1.0 / rubber.plane_strain_modulus_mpa + 1.0 / CEMENT.plane_strain_modulus_mpa)
    up = np.array([0.0, 0.0, 1.0])
    floors, closures = {}, []
    for name, modulus_mpa in (("rigid", rubber.plane_strain_modulus_mpa), ("cement", both_mpa)):
        radius_mm = float(contact_radius_mm(1.0, response.ball_radius_mm, modulus_mpa))
        closures.append(replace(response, hertz_modulus_mpa=modulus_mpa).free_element_closures_um(up, up))
        floors[name] = HertzContact(
            contact_modulus_mpa=modulus_mpa, radius_mm=radius_mm, corner_closure_um=closures[-1].max()
        )
    return floors, float(np.abs(closures[1] / closures[0] - 1.0).max())


def _fringe_results(foot_design: FootDesign) -> list[FringeResult]:
    """Return capacitances with and without fringe field at three closures."""
    capacitor, closed_um = foot_design.capacitor, (0.0, 5.0, 10.0)
    both_pf = [fringed_and_plate_capacitance_pf(foot_design, one_um) for one_um in closed_um]
    edged_pf, plates_pf = np.array(both_pf).T
    stray_pf = edged_pf[0] - plates_pf[0]
    read_um = capacitor.closure_um(edged_pf, edged_pf[0])
    corrected_um = capacitor.closure_um(edged_pf - stray_pf, edged_pf[0] - stray_pf)
    columns = (closed_um, plates_pf.tolist(), edged_pf.tolist(), read_um.tolist(), corrected_um.tolist())
    return [FringeResult(*row) for row in zip(*columns, strict=True)]


def _closure_variation_inside_cells(response: FootResponse) -> tuple[float, float]:
    """Return the largest rms closure variation inside a cell [um], and its capacitance error [1].

    Upright and inclined loads of 1 N. A closure that varies by a standard deviation s inside a cell raises the mean of
    1/D by s^2/D^2; s^2 = (slope x step)^2 / 12 per direction, the slope by differences of neighbouring cells.
    """
    force = directions(0.0, [90.0, INCLINED_LOAD_ELEVATION_DEG])
    cell_closures_um = np.minimum(response.free_closure_um(force, force), response.design.gap_um)
    grid = cell_closures_um.reshape(2, -1, CELLS_PER_SIDE, CELLS_PER_SIDE)
    variance = sum(np.gradient(grid, axis=axis) ** 2 for axis in (2, 3)) / 12.0
    distance_um = response.design.gap_um + response.design.film_equivalent_um - grid
    lost = (variance / distance_um**3).sum(axis=(2, 3)) / (1.0 / distance_um).sum(axis=(2, 3))
    return float(np.sqrt(variance.max())), float(lost.max())


def compute(context: StudyContext) -> tuple[Results, Plots]:
    """Return the errors of mesh, ground, spacer and electrodes; the quick form omits fine meshes and response table."""
    foot_design, response = context.foot_design, context.response
    meshes, taken = _solve_meshes(context), None
    if not context.quick:
        _, taken = _timed(partial(make_response, foot_design, RELEASED_MESH, context.report_progress))
    cases, cases_taken = _timed(lambda: (paper_training(response), paper_verification(response)))
    floors, ground_change_rel = _compare_ground_materials(foot_design, response)
    cell_um, cell_rel = _closure_variation_inside_cells(response)
    stated = response.provenance
    results = Results(
        meshes=meshes,
        response=taken,
        cases=cases_taken,
        n_cases=sum(len(one.force_n) for one in cases),
        contacts_by_ground=floors,
        max_closure_change_by_ground_rel=ground_change_rel,
        spacer_mm=foot_design.spacer_mm,
        strip_closure_by_traction_law_um=cavity_strip_closure_um(foot_design, solid=False),
        strip_closure_meshed_spacer_um=cavity_strip_closure_um(foot_design, solid=True),
        fringe=_fringe_results(foot_design),
        table_errors_rel={
            "foot against its transpose": stated["mesh_asymmetry_rel"],
            "samples against series": stated["fit_residual_rel"],
            "series four degrees shorter": stated["interpolation_rel"],
            "cells of 6 x 6: C of an element at 1 N, worst": cell_rel,
        },
        max_in_cell_closure_rms_um=cell_um,
    )
    return results, {"solid.png": _figure(meshes)}


def _figure(meshes: Sequence[MeshResult]) -> Figure:
    """Return the figure of mesh error over processor time."""
    figure, (axes,) = subplot_row(1, 7.0, 4.2)
    names = ("upright, 1 N", f"{INCLINED_LOAD_ELEVATION_DEG:g} deg, 1 N")
    for load, (name, marker) in enumerate(zip(names, "os", strict=True)):
        points = [
            (mesh.processor_s, 100.0 * mesh.max_closure_error_rel_per_load[load])
            for mesh in meshes
            if len(mesh.max_closure_error_rel_per_load) > load
            and mesh.max_closure_error_rel_per_load[load] > 0.0
        ]
        axes.plot(*zip(*sorted(points), strict=True), marker + "-", label=name, alpha=0.8)
    for mesh in meshes:
        if mesh.max_closure_error_rel_per_load[0] > 0.0:
            place = (mesh.processor_s, 100.0 * mesh.max_closure_error_rel_per_load[0])
            axes.annotate(mesh.name, place, xytext=(5, 6), textcoords="offset points", fontsize=8)
    axes.axhline(1.0, color="k", lw=0.8, ls="--", label="target")
    axes.set(xscale="log", yscale="log", xlabel="processor time [s]", ylabel="worst error of a closure [%]")
    axes.grid(visible=True, which="both", alpha=0.25)
    axes.margins(x=0.2)
    axes.legend()
    return figure


STUDY = Study(name="solid", title="How exact the solid is", compute=compute, uses_network=False)
