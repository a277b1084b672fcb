"""Study `hard-cases`: inputs at the limits of the models, each with expected and measured result."""

import dataclasses
import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial

import msgspec
import ngsolve as ng
import numpy as np
from msgspec.structs import replace

from footsense.errors import ConfigError, ModelError
from footsense.foot.directions import directions
from footsense.foot.force_errors import GRAM_FORCE_N
from footsense.foot.gap_contact import N_CELLS, ContactSolution, solve_contact_lcp
from footsense.foot.response_table import FootResponse
from footsense.foot.specimen import Foot
from footsense.frames import Vector
from footsense.lab.fem.centred import solve_centred_closures
from footsense.lab.fem.mesh import COARSE_MESH, MeshSize, build_quarter_mesh
from footsense.lab.fem.quarter import QuarterFoot
from footsense.lab.fem.symmetry_classes import Parity
from footsense.lab.foot_file import load_foot
from footsense.lab.former_page import Plots, Study, StudyContext
from footsense.lab.geometry import FootDesign, Material
from footsense.lab.studies.accuracy.hard_inputs import Case, network_cases, pipeline_cases

_UPWARD = np.array([[0.0, 0.0, 1.0]])
#: A mesh for statements that hold on any mesh.
_UNREFINED_MESH = MeshSize(edge_layers=0, order=2, bar_mm=1.0)


def kkt_residual(
    solution: ContactSolution, free_um: Vector, gap_um: Vector, compliance_um_per_n: Vector
) -> dict[str, float]:
    """Return how far a solution violates each optimality (KKT) condition, by name; zero for an exact one.

    Args:
        solution: The solution.
        free_um: Closure of each cell without contact [um], shape (324,).
        gap_um: Gap of each cell at rest [um], shape (324,).
        compliance_um_per_n: B, shape (324, 324).

    Returns:
        The largest of each: `balance_um` |d - (d0 - B l)|, `penetration_um` d - g, `pull_n` -l, `slack_nm_n`
        |l (g - d)|.
    """
    balance_um = solution.cell_closures_um - (free_um - compliance_um_per_n @ solution.cell_forces_n)
    slack_um = gap_um - solution.cell_closures_um
    return {
        "balance_um": float(np.abs(balance_um).max()),
        "penetration_um": float(max(0.0, -slack_um.min())),
        "pull_n": float(max(0.0, -solution.cell_forces_n.min())),
        "slack_nm_n": float(1e3 * np.abs(slack_um * solution.cell_forces_n).max()),
    }


def _expected_error_case(name: str, error: type[Exception], attempt: Callable[[], object]) -> Case:
    """Return the test case of an input that has to raise an error."""
    try:
        attempt()
    except Exception as raised:  # noqa: BLE001  any exception is the measured result
        first = re.split(r"[;(]|, got| of \w+\(", str(raised))[0].strip()
        return Case(name, error.__name__, f"{type(raised).__name__}: {first}", isinstance(raised, error))
    return Case(name, error.__name__, "no error", passed=False)


def _small_load_cases(response: FootResponse) -> Iterator[Case]:
    """Yield the cases of zero load and of a tenth of a gram-force."""
    foot = Foot(response)
    none_um = float(np.abs(foot.cell_closures_um(_UPWARD, 0.0 * _UPWARD)).max())
    yield Case("no load", "0 um, exactly", f"{none_um:g} um", none_um == 0.0)
    small_n = 0.1 * GRAM_FORCE_N
    per_newton = [
        foot.cell_closures_um(_UPWARD, load * _UPWARD)[0] / load for load in (small_n, 1e-6 * small_n)
    ]
    apart = float(np.abs(per_newton[0] - per_newton[1]).max() / np.abs(per_newton[1]).max())
    yield Case("0.1 gf", "closure per newton as at 1e-7 gf, to 1e-3", f"{apart:.1e}", apart < 1e-3)


def _gap_closing_cases(response: FootResponse) -> Iterator[Case]:
    """Yield the cases of loads that close gaps, and of the contact solver's accuracy."""
    foot, gap_um = Foot(response), response.design.gap_um
    loads_n = np.linspace(0.0, 200.0, 801)
    cell_closures_um = foot.cell_closures_um(np.repeat(_UPWARD, len(loads_n), 0), loads_n[:, None] * _UPWARD)
    shut = (cell_closures_um >= gap_um).sum(axis=1)
    first_n = float(loads_n[np.argmax(shut > 0)])
    steady = float(np.diff(cell_closures_um, axis=0).min())
    yield Case("first cell closes, upright", "above 1 N", f"{first_n:g} N", first_n > 1.0)
    yield Case("closures from 0 to 200 N", "never fall", f"least step {steady:.1e} um", steady > -1e-9)
    everything = bool(shut[-1] == N_CELLS)
    all_n = loads_n[np.argmax(shut == N_CELLS)]
    radius_mm = float(response.patch_radius_mm(_UPWARD[0], all_n * _UPWARD[0]))
    some = f"{shut[-1]} of {N_CELLS} cells at 200 N"
    found = f"{all_n:g} N, patch {radius_mm:.1f} mm" if everything else some
    yield Case("all nine gaps closed", "an end, every cell at its gap", found, everything)
    worst = 0.0
    compliance, gaps_um = response.compliance_um_per_n, np.full(N_CELLS, gap_um)
    for load_n in (2.0, 5.0, 20.0, 100.0):
        free_um = response.free_closure_um(_UPWARD[0], load_n * _UPWARD[0])
        rest = kkt_residual(solve_contact_lcp(free_um, gaps_um, compliance), free_um, gaps_um, compliance)
        worst = max(worst, rest["balance_um"] / float(np.abs(free_um).max()))
    yield Case("contact at 2 to 100 N", "balance to 1e-9 of the closure", f"{worst:.1e}", worst < 1e-9)


def _rim_contact_cases(response: FootResponse) -> Iterator[Case]:
    """Yield the cases of contacts near the ball's rim, and of invalid inputs."""
    low = directions(np.array([0.0, 90.0]), np.array([40.0, 40.0]))
    closures = response.free_element_closures_um(low, low)
    turned = float(np.abs(closures[1].reshape(3, 3) - closures[0].reshape(3, 3).T).max())
    yield Case("40 deg, at x and at y", "the same turned, to 1e-6 um", f"{turned:.1e} um", turned < 1e-6)
    below = directions(np.array(0.0), np.array(response.min_elevation_deg - 1.0))
    yield _expected_error_case(
        "contact below the table", ValueError, lambda: response.free_element_closures_um(below, below)
    )
    yield _expected_error_case(
        "NaN in a normal",
        ValueError,
        lambda: response.free_element_closures_um(np.full(3, np.nan), _UPWARD[0]),
    )
    gaps_um = np.full(3, response.design.gap_um)
    yield _expected_error_case(
        "NaN in a closure", ValueError, lambda: solve_contact_lcp(np.full(3, np.nan), gaps_um, np.eye(3))
    )
    yield _expected_error_case(
        "indefinite compliance",
        ArithmeticError,
        lambda: solve_contact_lcp(1.5 * gaps_um, gaps_um, -np.eye(3)),
    )
    silent = Foot(response).capacitance_pf(_UPWARD, np.full((1, 3), np.nan))
    yield Case("NaN in a force", "no number", str(silent[0, 0]), bool(np.isnan(silent).all()))


def _impossible_design_cases(foot_design: FootDesign) -> Iterator[Case]:
    """Yield the cases of impossible foot designs, refused without a finite element solve."""
    yield _expected_error_case(
        "plate of 10 nm",
        ModelError,
        lambda: build_quarter_mesh(replace(foot_design, plate_mm=1e-5), COARSE_MESH),
    )
    wide = msgspec.json.encode(replace(foot_design, sheet_mm=1.5 * foot_design.ball_radius_mm))
    yield _expected_error_case("sheet wider than the ball", ConfigError, lambda: load_foot(wide))
    for poisson in (0.5, 0.0):
        other = replace(foot_design, rubber=replace(foot_design.rubber, poisson=poisson))
        yield _expected_error_case(
            f"rubber of nu = {poisson:g}",
            ModelError,
            partial(QuarterFoot, other, _UNREFINED_MESH, Parity(1, 1)),
        )


def _hard_material_cases(foot_design: FootDesign) -> Iterator[Case]:
    """Yield the cases of extreme materials, each with a finite element solve."""
    lost = []
    for poisson in (0.49, 0.499, 0.4999):
        rubber = replace(foot_design, rubber=replace(foot_design.rubber, poisson=poisson))
        low, high = (
            solve_centred_closures(
                rubber, dataclasses.replace(_UNREFINED_MESH, order=order), (90.0,)
            ).closure_um_per_n.sum()
            for order in (2, 3)
        )
        lost.append(100.0 * (1.0 - float(low / high)))
    yield Case(
        "nu = 0.49, 0.499, 0.4999",
        "quadratic below cubic by the same share, to 2 %",
        ", ".join(f"{value:.2f} %" for value in lost),
        max(lost) - min(lost) < 2.0,
    )
    sheet = Material(foot_design.rubber.youngs_mpa / 150.0, foot_design.pdms.poisson)
    soft = replace(foot_design, pdms=sheet)
    spacer_um, ball_mm = 1000.0 * foot_design.spacer_mm, 2.0 * foot_design.ball_radius_mm
    for name, foot in (
        (f"{spacer_um:g} um spacer in a ball of {ball_mm:g} mm", foot_design),
        ("sheet 1/150 as stiff as the rubber", soft),
    ):
        quarter = QuarterFoot(foot, _UNREFINED_MESH, Parity(1, 1))
        load = quarter.traction_load(ng.CF((0.0, 0.0, 1.0)))
        rest = quarter.residual_rel(load, quarter.solve(load))
        yield Case(name, "residual below 1e-8", f"{rest:.1e}", rest < 1e-8)
    loose = replace(foot_design, spacer_mm=1e30)
    yield _expected_error_case(
        "a half that nothing holds", ModelError, lambda: QuarterFoot(loose, _UNREFINED_MESH, Parity(1, 1))
    )


@dataclass(frozen=True, kw_only=True)
class Results:
    """Results of the study `hard-cases`: all cases, grouped by heading."""

    groups: dict[str, list[Case]]


def compute(context: StudyContext) -> tuple[Results, Plots]:
    """Run every case; the quick form leaves out the cases that need a finite element solve."""
    response = context.response
    groups: dict[str, Iterable[Case]] = {
        "The foot under load": [
            *_small_load_cases(response),
            *_gap_closing_cases(response),
            *_rim_contact_cases(response),
            *_impossible_design_cases(context.foot_design),
        ],
        "The network": network_cases(context),
        "The daemon": pipeline_cases(context),
    }
    if not context.quick:
        groups["The solid"] = _hard_material_cases(context.foot_design)
    tried = {heading: list(cases) for heading, cases in groups.items()}
    for heading, cases in tried.items():
        context.report_progress(
            f"{heading}: {sum(case.passed for case in cases)} of {len(cases)} as expected"
        )
    return Results(groups=tried), {}


STUDY = Study(name="hard-cases", title="Hard cases", compute=compute)
