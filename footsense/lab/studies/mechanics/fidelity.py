"""Study `fidelity`: computing time and error of the models of the foot."""

import functools
import timeit
from dataclasses import dataclass
from timeit import default_timer

import ngsolve as ng
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullLocator
from msgspec.structs import replace

from footsense.foot.capacitor import CapacitorDesign
from footsense.foot.force_errors import evaluate_force_errors
from footsense.foot.response_table import FootResponse
from footsense.foot.specimen import ContactLoads
from footsense.frames import Vector
from footsense.lab.evaluation.evaluate import ForceEstimator, rms
from footsense.lab.evaluation.fidelity_levels import (
    LEVEL_NAMES,
    FidelityLevel,
    LevelResponse,
    fidelity_level,
    half_space_response,
)
from footsense.lab.evaluation.half_space import HalfSpace
from footsense.lab.fem.forward import DirectSolveFoot
from footsense.lab.fem.mesh import COARSE_MESH, MeshSize
from footsense.lab.former_page import Plots, Study, StudyContext
from footsense.lab.geometry import FootDesign
from footsense.lab.training.load_cases import paper_training, paper_verification

#: Loads that are solved forward.
_FORWARD_LOADS, _FORWARD_LOADS_QUICK = 12, 2
#: Adjoint solves of a table: one per cell of the quarter and class.
N_ADJOINT_SOLVES = 81 * 3


@dataclass(frozen=True, slots=True)
class ForwardAgainstTable:
    """Times and differences of one solve per load against the table of adjoint solves.

    Attributes:
        mesh_and_factorise_s: Mesh and three factorisations, which both need [s].
        forward_solve_s_per_load: One load by four solves [s].
        adjoint_solve_s: One adjoint solve, of which a table takes one per cell of the quarter and class [s].
        table_s_per_load: One load by the table, many at once [s].
        closure_difference_rms_rel: Difference of the closures of cells, rms over rms [1].
        closure_difference_max_um: The largest difference of an element's closure [um].
        n: Loads that were solved.
    """

    mesh_and_factorise_s: float
    forward_solve_s_per_load: float
    adjoint_solve_s: float
    table_s_per_load: float
    closure_difference_rms_rel: float
    closure_difference_max_um: float
    n: int

    @property
    def forward_over_table_time(self) -> float:
        """Time of one solve over the time of one table look-up [1]."""
        return self.forward_solve_s_per_load / self.table_s_per_load


def forward_against_table(
    foot_design: FootDesign, size: MeshSize, response: FootResponse, loads: ContactLoads, n: int
) -> ForwardAgainstTable:
    """Return times of direct solves and of the adjoint table, and the difference of their closures.

    Args:
        foot_design: The foot.
        size: Resolution of the mesh of the solves.
        response: The table.
        loads: ContactLoads on which the table is timed.
        n: How many of them, evenly spread, are solved.
    """
    start = default_timer()
    foot = DirectSolveFoot(foot_design, size)
    factorise_s = default_timer() - start
    once = functools.partial(response.free_closure_um, loads.normal, loads.force_n)
    tabled, table_s = once(), min(timeit.repeat(once, repeat=3, number=1)) / len(loads.force_n)
    some = np.linspace(0, len(loads.force_n) - 1, n).round().astype(int)
    functionals = [quarter.closure_functional("cell0", 1.0) for quarter in foot.quarter_per_class]
    start = default_timer()
    for quarter, functional in zip(foot.quarter_per_class, functionals, strict=True):
        quarter.solve(functional)
    adjoint_s = (default_timer() - start) / len(functionals)
    start = default_timer()
    solved = np.stack([foot.cell_closures_um(loads.normal[load], loads.force_n[load]) for load in some])
    forward_s = (default_timer() - start) / n
    difference = solved - tabled[some]
    by_element = difference.reshape(n, 9, -1).mean(axis=-1)
    return ForwardAgainstTable(
        mesh_and_factorise_s=factorise_s,
        forward_solve_s_per_load=forward_s,
        adjoint_solve_s=adjoint_s,
        table_s_per_load=table_s,
        closure_difference_rms_rel=rms(difference) / rms(tabled[some]),
        closure_difference_max_um=float(np.abs(by_element).max()),
        n=n,
    )


def run_and_time_level(
    level: FidelityLevel, loads: ContactLoads, repeats: int = 1
) -> tuple[LevelResponse, float]:
    """Return a fidelity level's response to given loads, and its shortest computing time of several runs [s]."""
    taken_s = []
    for _ in range(repeats):
        start = default_timer()
        answer = level(loads.normal, loads.force_n)
        taken_s.append(default_timer() - start)
    return answer, min(taken_s)


def reported_force_n(
    network: ForceEstimator, design: CapacitorDesign, level_response: LevelResponse
) -> Vector:
    """Return the network's force estimate [N], shape (n, 3), from the capacitances of a level's response.

    Args:
        network: Makes forces [N] of closures over the gap [1].
        design: Dimensions of the capacitors.
        level_response: Closures and capacitances of the elements.
    """
    closure_um = design.closure_um(level_response.capacitance_pf, np.full(9, design.unloaded_pf))
    return network(closure_um / design.gap_um)


@dataclass(frozen=True, slots=True)
class FidelityError:
    """Errors of one fidelity level against the finest on the same loads.

    Attributes:
        closure_difference_rms_rel: Difference of the closures, rms over rms of the reference [1].
        closure_difference_max_um: The largest difference of a closure [um].
        capacitance_difference_rms_rel: Difference of the capacitance changes, rms over rms of the reference [1].
        capacitance_difference_max_pf: The largest difference of a capacitance [pF].
        direction_difference_deg: Mean angle between the forces that the network reads from both [deg].
        magnitude_difference_gf: Mean difference of their magnitudes [gf].
        n: Loads.
    """

    closure_difference_rms_rel: float
    closure_difference_max_um: float
    capacitance_difference_rms_rel: float
    capacitance_difference_max_pf: float
    direction_difference_deg: float
    magnitude_difference_gf: float
    n: int


def fidelity_error(
    level_response: LevelResponse, finest: LevelResponse, network: ForceEstimator, design: CapacitorDesign
) -> FidelityError:
    """Return the error of a level's response against that of a finer level.

    Args:
        level_response: To the loads.
        finest: To the same loads.
        network: As in `reported_force_n`.
        design: Dimensions of the capacitors.
    """
    closure_um = level_response.closure_um - finest.closure_um
    capacitance_pf = level_response.capacitance_pf - finest.capacitance_pf
    change_pf = finest.capacitance_pf - design.unloaded_pf
    read = evaluate_force_errors(
        reported_force_n(network, design, finest), reported_force_n(network, design, level_response)
    )
    return FidelityError(
        closure_difference_rms_rel=rms(closure_um) / rms(finest.closure_um),
        closure_difference_max_um=float(np.abs(closure_um).max()),
        capacitance_difference_rms_rel=rms(capacitance_pf) / rms(change_pf),
        capacitance_difference_max_pf=float(np.abs(capacitance_pf).max()),
        direction_difference_deg=read.direction_deg,
        magnitude_difference_gf=read.magnitude_gf,
        n=len(closure_um),
    )


def paper_loads(response: FootResponse) -> ContactLoads:
    """Return the paper's 362 + 180 centred loads (section III F)."""
    force_n = np.concatenate([paper_training(response).force_n, paper_verification(response).force_n])
    return ContactLoads.centred(force_n)


#: Differences between level_responses, by model.
Differences = dict[str, FidelityError]


@dataclass(frozen=True, kw_only=True)
class Results:
    """Computing time and error of the models of the foot.

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
    """

    n_loads: int
    seconds_per_load: dict[str, float]
    differences_from_contact_level: Differences
    half_space_variant_differences: Differences
    min_max_sheet_force_share: tuple[float, float]
    rubber_over_pdms_contact_modulus: float
    forward: ForwardAgainstTable
    forward_on_coarse_mesh: bool


def _time_levels(
    context: StudyContext, names: tuple[str, ...], loads: ContactLoads
) -> tuple[dict[str, LevelResponse], dict[str, float]]:
    """Return the responses of the models, and the computing time per load of each [s]."""
    level_responses, seconds = {}, {}
    for name in names:
        level = fidelity_level(name, context.response, context.foot_design)
        level_responses[name], taken_s = run_and_time_level(level, loads, repeats=3)
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


def error_over_time_figure(
    seconds: dict[str, float],
    distances: dict[str, FidelityError],
    finest: str,
    forward: ForwardAgainstTable,
    n: int,
) -> Figure:
    """Return the figure of error over computing time; the finest level, the reference, as a line.

    Args:
        seconds: Time of a load [s], by level.
        distances: Differences from the finest, by level.
        finest: Name of the finest.
        forward: One solve per load, drawn at the error of `linear`.
        n: Loads of the time axis.
    """
    figure = Figure(figsize=(8.2, 4.4), layout="constrained")
    axes = figure.subplots()
    for place, (name, apart) in enumerate(distances.items()):
        at = (seconds[name] * n, 100.0 * apart.closure_difference_rms_rel)
        axes.plot(*at, "o", color=f"C{place}", ms=9)
        axes.annotate(name, at, xytext=(0, 9), textcoords="offset points", ha="center")
    at = (forward.forward_solve_s_per_load * n, 100.0 * distances["linear"].closure_difference_rms_rel)
    axes.plot(*at, "D", color="0.5", ms=8)
    axes.annotate("linear, one solve per load", at, xytext=(0, 9), textcoords="offset points", ha="right")
    axes.axvline(seconds[finest] * n, color="k", ls="--")
    axes.annotate(
        f"{finest}: counted from",
        (seconds[finest] * n, 0.97),
        xycoords=("data", "axes fraction"),
        xytext=(-5, 0),
        textcoords="offset points",
        rotation=90,
        ha="right",
        va="top",
    )
    axes.set(xscale="log", yscale="log", xlabel=f"time for the {n} load cases of the paper [s]")
    axes.set_ylabel(f"closures: rms difference from {finest} [%]")
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_locator(NullLocator())
    axes.margins(x=0.15, y=0.2)
    axes.grid(alpha=0.3)
    return figure


def compute(context: StudyContext) -> tuple[Results, Plots]:
    """Return times and errors of the models."""
    ng.ngsglobals.msg_level = 0
    loads, foot_design = paper_loads(context.response), context.foot_design
    cheap, seconds = _time_levels(context, LEVEL_NAMES[:3], loads)
    forward = _compare_forward(context, loads)
    apart = _differences_from_finest(
        context, {name: cheap[name] for name in LEVEL_NAMES[:2]}, cheap["contact"]
    )
    figures = {"fidelity.png": error_over_time_figure(seconds, apart, "contact", forward, len(loads.force_n))}
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
    )
    return results, figures


STUDY = Study(name="fidelity", title="The fidelity levels", compute=compute)
