"""Study `fidelity`: computing time and error of four models of the foot, from a formula to finite strain."""

from dataclasses import dataclass

import ngsolve as ng
import numpy as np
from msgspec.structs import replace

from footsense.foot.specimen import ContactLoads
from footsense.lab.fem.mesh import COARSE_MESH, MeshSize
from footsense.lab.fidelity.compare import FidelityError, fidelity_error, run_and_time_level
from footsense.lab.fidelity.drawing import capacitance_pattern_figure, error_over_time_figure
from footsense.lab.fidelity.forward import ForwardAgainstTable, forward_against_table
from footsense.lab.fidelity.half_space import HalfSpace
from footsense.lab.fidelity.levels import (
    LEVEL_NAMES,
    LevelResponse,
    fidelity_level,
    finite_strain_level,
    half_space_response,
)
from footsense.lab.fidelity.loads import loads_in_mirror_plane, paper_loads
from footsense.lab.former_page import Plots, Study, StudyContext

#: Loads of the full solve: elevation of contact normal and of force [deg], magnitude [gf]. The load of the
#: paper's Fig. 17, one that leans away from the normal, and two that close gaps.
FULL_SOLVE_LOADS = ((45.0, 45.0, 100.0), (70.0, 90.0, 100.0), (90.0, 90.0, 150.0), (60.0, 60.0, 150.0))
#: Loads that are solved forward.
_FORWARD_LOADS, _FORWARD_LOADS_QUICK = 12, 2
#: Adjoint solves of a table: one per cell of the quarter and class.
N_ADJOINT_SOLVES = 81 * 3


#: Differences between level_responses, by model.
Differences = dict[str, FidelityError]


@dataclass(frozen=True, kw_only=True)
class DifferencesFromFullSolve:
    """Differences of the cheaper models from the full finite-strain solve.

    Attributes:
        differences: Differences from the full solve.
        mesh_difference_rel: Difference of the closures at the first load by the mesh alone, rms over rms [1].
        physics_difference_rel: Difference of those closures by finite strain and the floor alone, rms over rms [1].
    """

    differences: Differences
    mesh_difference_rel: float
    physics_difference_rel: float


@dataclass(frozen=True, kw_only=True)
class Results:
    """Computing time and error of the four models of the foot.

    Attributes:
        n_loads: The paper's loads.
        seconds_per_load: Time of a load [s], by model.
        differences_from_contact_level: Differences from `contact`.
        half_space_variant_differences: Differences of the variants of the formula from `contact`.
        min_max_sheet_force_share: Smallest and largest share of the vertical force that the formula puts on the sheet
            [1].
        rubber_over_pdms_contact_modulus: Contact modulus of the rubber over that of PDMS [1].
        forward: One solve per load, beside the table.
        forward_on_coarse_mesh: Whether those solves are on a coarser mesh than the table's.
        differences_from_finite_strain: The cheap models beside the full solve; None in the quick form.
    """

    n_loads: int
    seconds_per_load: dict[str, float]
    differences_from_contact_level: Differences
    half_space_variant_differences: Differences
    min_max_sheet_force_share: tuple[float, float]
    rubber_over_pdms_contact_modulus: float
    forward: ForwardAgainstTable
    forward_on_coarse_mesh: bool
    differences_from_finite_strain: DifferencesFromFullSolve | None


def _time_levels(
    context: StudyContext, names: tuple[str, ...], loads: ContactLoads
) -> tuple[dict[str, LevelResponse], dict[str, float]]:
    """Return the responses of the models, and the computing time per load of each [s]."""
    level_responses, seconds = {}, {}
    for name in names:
        level = fidelity_level(name, context.response, context.foot_design)
        level_responses[name], taken_s = run_and_time_level(level, loads, repeats=1 if name == "full" else 3)
        seconds[name] = taken_s / len(loads.force_n)
        context.report_progress(f"fidelity: {name}, {len(loads.force_n)} loads in {taken_s:.2g} s")
    return level_responses, seconds


def _differences_from_finest(
    context: StudyContext, level_responses: dict[str, LevelResponse], finest: LevelResponse
) -> Differences:
    """Return the differences of each model's closures and capacitances from the finest model's."""
    network, design = context.network.force_n, context.response.design
    return {name: fidelity_error(answer, finest, network, design) for name, answer in level_responses.items()}


def _compare_forward(context: StudyContext, loads: ContactLoads) -> ForwardAgainstTable:
    """Return times and errors of direct solves against the table, on its mesh (quick: a coarse one)."""
    size = COARSE_MESH if context.quick else MeshSize(**context.response.provenance["mesh"])
    n = _FORWARD_LOADS_QUICK if context.quick else _FORWARD_LOADS
    forward = forward_against_table(context.foot_design, size, context.response, loads, n)
    context.report_progress(
        f"fidelity: three classes factorised in {forward.mesh_and_factorise_s:.1f} s, {n} loads solved"
    )
    return forward


def _compare_half_space(
    context: StudyContext, loads: ContactLoads, contact: LevelResponse
) -> tuple[Differences, tuple[float, float]]:
    """Return errors of the formula's variants against the contact level, and the sheet's share of the force [1]."""
    foot_design = context.foot_design
    alone = HalfSpace(foot_design, balanced=False)
    variants = {
        "half-space": HalfSpace(foot_design),
        "without statics": alone,
        "with PDMS for the rubber": HalfSpace(replace(foot_design, rubber=foot_design.pdms)),
    }
    level_responses = {
        name: half_space_response(one, loads.normal, loads.force_n) for name, one in variants.items()
    }
    edge_mm = (foot_design.sheet_mm - foot_design.pitch_mm) / 2.0
    side_mm = [edge_mm, foot_design.pitch_mm, edge_mm]
    area_mm2 = np.outer(side_mm, side_mm).ravel()
    carried = (alone.element_pressure_mpa(loads.normal, loads.force_n) @ area_mm2) / loads.force_n[:, 2]
    return _differences_from_finest(context, level_responses, contact), (carried.min(), carried.max())


def _compare_with_full(
    context: StudyContext, level_responses: dict[str, LevelResponse]
) -> DifferencesFromFullSolve:
    """Return errors against the finite-strain solve, split into mesh and physics at the first load."""
    reduced, taken_s = run_and_time_level(
        finite_strain_level(context.foot_design, reduced=True), loads_in_mirror_plane(FULL_SOLVE_LOADS[:1])
    )
    context.report_progress(f"fidelity: full without finite strain and floor, in {taken_s:.1f} s")
    first, contact = (
        LevelResponse(level_responses[name].closure_um[:1], level_responses[name].capacitance_pf[:1])
        for name in ("full", "contact")
    )
    return DifferencesFromFullSolve(
        differences=_differences_from_finest(
            context, {name: level_responses[name] for name in LEVEL_NAMES[:3]}, level_responses["full"]
        ),
        mesh_difference_rel=_differences_from_finest(context, {"contact": contact}, reduced)[
            "contact"
        ].closure_difference_rms_rel,
        physics_difference_rel=_differences_from_finest(context, {"reduced": reduced}, first)[
            "reduced"
        ].closure_difference_rms_rel,
    )


def compute(context: StudyContext) -> tuple[Results, Plots]:
    """Return times and errors of the models; the quick form leaves out the finite-strain solve."""
    ng.ngsglobals.msg_level = 0
    loads, foot_design = paper_loads(context.response), context.foot_design
    cheap, seconds = _time_levels(context, LEVEL_NAMES[:3], loads)
    forward = _compare_forward(context, loads)
    apart = _differences_from_finest(
        context, {name: cheap[name] for name in LEVEL_NAMES[:2]}, cheap["contact"]
    )
    shown, finest, full, figures = apart, "contact", None, {}
    if not context.quick:
        level_responses, taken = _time_levels(context, LEVEL_NAMES, loads_in_mirror_plane(FULL_SOLVE_LOADS))
        full = _compare_with_full(context, level_responses)
        shown, finest, seconds["full"] = full.differences, "full", taken["full"]
        unloaded_pf = context.response.design.unloaded_pf
        figures["fidelity-pattern.png"] = capacitance_pattern_figure(
            {name: one.capacitance_pf[0].reshape(3, 3) - unloaded_pf for name, one in level_responses.items()}
        )
    figures["fidelity.png"] = error_over_time_figure(seconds, shown, finest, forward, len(loads.force_n))
    formula, carried_rel = _compare_half_space(context, loads, cheap["contact"])
    results = Results(
        n_loads=len(loads.force_n),
        seconds_per_load=seconds,
        differences_from_contact_level=apart,
        half_space_variant_differences=formula,
        min_max_sheet_force_share=carried_rel,
        rubber_over_pdms_contact_modulus=foot_design.rubber.plane_strain_modulus_mpa
        / foot_design.pdms.plane_strain_modulus_mpa,
        forward=forward,
        forward_on_coarse_mesh=context.quick,
        differences_from_finite_strain=full,
    )
    return results, figures


STUDY = Study(name="fidelity", title="The fidelity levels", compute=compute)
