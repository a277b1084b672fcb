"""Page `hard-cases`: inputs at the limits of foot, network and solid; what is expected and what comes out."""

from collections.abc import Iterator
from typing import NamedTuple

import ngsolve as ng
import numpy as np
import onnx
from msgspec.structs import replace
from onnx import TensorProto, numpy_helper
from onnx.reference import ReferenceEvaluator

from footsense.estimation.network import steady_windows
from footsense.foot.directions import directions
from footsense.foot.force_errors import GRAM_FORCE_N
from footsense.foot.gap_contact import N_CELLS, solve_contact_lcp
from footsense.foot.network_card import INPUTS, NETWORK_FILE
from footsense.foot.response_table import FootResponse
from footsense.foot.specimen import Specimen
from footsense.frames import ELEMENTS
from footsense.lab.fem.mesh import MeshSize
from footsense.lab.fem.quarter import Parity, QuarterFoot
from footsense.lab.geometry import FootDesign, Material
from footsense.lab.report import StudyContext, Values, target
from footsense.lab.training.gait_readings import random_gaits
from footsense.lab.training.gait_windows import windows_of
from footsense.lab.training.load_cases import paper_verification
from footsense.ports import Window

TITLE = "Hard cases"

_UP = np.array([[0.0, 0.0, 1.0]])
#: A mesh for statements that hold on any mesh.
_UNREFINED_MESH = MeshSize(edge_layers=0, order=2, bar_mm=1.0)
#: Allowed difference of float32 from float64: a twentieth of a bit on CAN at rest, a half in motion [N].
_SINGLE_AT_REST_N, _SINGLE_IN_MOTION_N = 5e-5, 5e-4
#: Random gaits on which both are compared: seed, rounds, gaits of a round, conversions of each.
_SEED, _ROUNDS, _GAITS, _CONVERSIONS = 990_100, 3, 70, 1100


class _Case(NamedTuple):
    """An extreme input, what is expected of it, what came out, and whether that is it."""

    name: str
    expected: str
    measured: str
    passed: bool


def compute(context: StudyContext) -> Values:
    """Try every case; the quick form leaves out those that solve a mesh."""
    groups = {
        "The foot under load": list(_loads(context.response)),
        "The network": list(_network(context)),
    }
    if not context.quick:
        groups["The solid"] = list(_materials(context.foot_design))
    for heading, cases in groups.items():
        context.report_progress(
            f"{heading}: {sum(case.passed for case in cases)} of {len(cases)} as expected"
        )
    cases = [case for group in groups.values() for case in group]
    n_passed = sum(case.passed for case in cases)
    row = target(
        "hard cases that come out as expected",
        "all",
        f"{n_passed} of {len(cases)}",
        met=n_passed == len(cases),
    )
    named = {heading: [case._asdict() for case in group] for heading, group in groups.items()}
    return {"groups": named, "n_passed": n_passed, "n": len(cases), "targets": [row]}


def _loads(response: FootResponse) -> Iterator[_Case]:
    """Yield no load, a small one, loads that close all gaps, contacts at the rim, and numbers that are none."""
    foot, gap_um = Specimen(response), response.design.gap_um
    none_um = float(np.abs(foot.cell_closures_um(_UP, 0.0 * _UP)).max())
    yield _Case("no load", "0 um, exactly", f"{none_um:g} um", none_um == 0.0)
    small_n = 0.1 * GRAM_FORCE_N
    per_newton = [foot.cell_closures_um(_UP, load * _UP)[0] / load for load in (small_n, 1e-6 * small_n)]
    apart = float(np.abs(per_newton[0] - per_newton[1]).max() / np.abs(per_newton[1]).max())
    yield _Case("0.1 gf", "closure per newton as at 1e-7 gf, to 1e-3", f"{apart:.1e}", apart < 1e-3)
    loads_n = np.linspace(0.0, 200.0, 801)
    closures_um = foot.cell_closures_um(np.repeat(_UP, len(loads_n), 0), loads_n[:, None] * _UP)
    shut = (closures_um >= gap_um).sum(axis=1)
    first_n = float(loads_n[np.argmax(shut > 0)])
    steady = float(np.diff(closures_um, axis=0).min())
    yield _Case("first cell closes, upright", "above 1 N", f"{first_n:g} N", first_n > 1.0)
    yield _Case("closures from 0 to 200 N", "never fall", f"least step {steady:.1e} um", steady > -1e-9)
    all_n = loads_n[np.argmax(shut == N_CELLS)]
    radius_mm = float(response.patch_radius_mm(_UP[0], all_n * _UP[0]))
    everything = bool(shut[-1] == N_CELLS)
    found = f"{all_n:g} N, patch {radius_mm:.1f} mm" if everything else f"{shut[-1]} of {N_CELLS} at 200 N"
    yield _Case("all nine gaps closed", "an end, every cell at its gap", found, everything)
    worst, compliance, gaps_um = 0.0, response.compliance_um_per_n, np.full(N_CELLS, gap_um)
    for load_n in (2.0, 5.0, 20.0, 100.0):
        free_um = response.free_closure_um(_UP[0], load_n * _UP[0])
        solved = solve_contact_lcp(free_um, gaps_um, compliance)
        off_um = solved.cell_closures_um - (free_um - compliance @ solved.cell_forces_n)
        worst = max(worst, float(np.abs(off_um).max() / np.abs(free_um).max()))
    yield _Case("contact at 2 to 100 N", "balance to 1e-9 of the closure", f"{worst:.1e}", worst < 1e-9)
    low = directions(np.array([0.0, 90.0]), np.array([40.0, 40.0]))
    closures = response.free_element_closures_um(low, low)
    turned = float(np.abs(closures[1].reshape(3, 3) - closures[0].reshape(3, 3).T).max())
    yield _Case("40 deg, at x and at y", "the same turned, to 1e-6 um", f"{turned:.1e} um", turned < 1e-6)
    silent = foot.capacitance_pf(_UP, np.full((1, 3), np.nan))
    yield _Case("NaN in a force", "no number", str(silent[0, 0]), bool(np.isnan(silent).all()))


def _materials(design: FootDesign) -> Iterator[_Case]:
    """Yield extreme materials, each with a finite element solve."""
    soft = replace(design, pdms=Material(design.rubber.youngs_mpa / 150.0, design.pdms.poisson))
    spacer = f"{1000.0 * design.spacer_mm:g} um spacer in a ball of {2.0 * design.ball_radius_mm:g} mm"
    for name, foot in ((spacer, design), ("sheet 1/150 as stiff as the rubber", soft)):
        quarter = QuarterFoot(foot, _UNREFINED_MESH, Parity(1, 1))
        load = quarter.traction_load(ng.CF((0.0, 0.0, 1.0)))
        rest = quarter.residual_rel(load, quarter.solve(load))
        yield _Case(name, "residual below 1e-8", f"{rest:.1e}", rest < 1e-8)


def _network(context: StudyContext) -> Iterator[_Case]:
    """Yield extreme inputs of the network alone, and float32 against float64."""
    network = context.network
    none_n = float(np.abs(network.force_n(np.zeros((1, ELEMENTS)))).max())
    yield _Case("no closure", "0 N, exactly", f"{none_n:g} N", none_n == 0.0)
    tiny_n = float(np.abs(network.force_n(np.full((1, ELEMENTS), 1e-40))).max())
    yield _Case("closures of 1e-40, subnormal in float32", "below 1 uN", f"{tiny_n:.1e} N", tiny_n < 1e-6)
    force_n = network.force_n(np.where(np.arange(ELEMENTS) == 4, np.nan, 0.0)[None])
    yield _Case("one NaN", "no number", str(force_n[0].tolist()), bool(np.isnan(force_n).any()))
    far_n = network.force_n(np.full((1, ELEMENTS), 10.0))
    size_n = f"{np.linalg.norm(far_n):.0f} N"
    yield _Case("closures ten gaps wide", "a finite number", size_n, bool(np.isfinite(far_n).all()))
    model = onnx.load(context.files(NETWORK_FILE) / NETWORK_FILE)
    for stored in model.graph.initializer:
        if stored.data_type == TensorProto.FLOAT:
            stored.CopyFrom(numpy_helper.from_array(numpy_helper.to_array(stored).astype(float), stored.name))
    for node in model.graph.node:
        if node.op_type == "Cast":
            node.attribute[0].i = TensorProto.DOUBLE
    graph = ReferenceEvaluator(model)

    def apart_n(window: Window) -> float:
        inputs = {
            signal.name: np.asarray(part, np.float64).reshape(len(part), signal.width)
            for signal, part in zip(INPUTS, window, strict=True)
        }
        return float(np.abs(network.estimate(window).force_n - graph.run(["force_n"], inputs)[0]).max())

    rested = steady_windows(paper_verification(context.response).closure_um / context.response.design.gap_um)
    compared = [("180 loads at rest", apart_n(rested), _SINGLE_AT_REST_N)]
    n, walked_n = 0, 0.0
    for seed in range(1 if context.quick else _ROUNDS):
        n_gaits = 4 if context.quick else _GAITS
        max_n = context.foot_design.loads.max_n
        windows = windows_of(random_gaits(context.response, _SEED + seed, n_gaits, _CONVERSIONS, max_n))
        nothing = np.zeros((len(windows.gait), ELEMENTS), bool)
        n += len(nothing)
        walked_n = max(walked_n, apart_n(Window(windows.closure_rel, windows.age_s, nothing)))
    compared.append((f"{n} conversions of random gaits", walked_n, _SINGLE_IN_MOTION_N))
    for what, found_n, limit_n in compared:
        name = f"float32 against float64, {what}"
        yield _Case(name, f"below {1e3 * limit_n:g} mN", f"{1e3 * found_n:.1e} mN", found_n < limit_n)
