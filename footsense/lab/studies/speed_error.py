"""Page `speed-error`: age and price of the boards, time of network and cycle, and rates of publishing against error."""

from collections.abc import Callable
from timeit import default_timer

import ngsolve as ng
import numpy as np
from msgspec.structs import replace

from footsense.benchmarks.cycle import (
    N_WARM_UP_CYCLES,
    compare_cycle_durations,
    network_durations_us,
    simulated_walk_frames,
)
from footsense.benchmarks.latency_vs_error import measure_latency_vs_error
from footsense.benchmarks.scan import CONFIGURATIONS, newest_reading_age_ms, scan_period_ms
from footsense.config import DEFAULT, SMALL_BOARD
from footsense.foot.force_errors import evaluate_force_errors
from footsense.foot.gap_contact import capacitance_pf, element_means
from footsense.foot.network_card import NETWORK_FILE
from footsense.foot.specimen import ContactLoads, Specimen
from footsense.frames import ELEMENTS, LEGS, Vector
from footsense.lab.evaluation.evaluate_models import rms
from footsense.lab.fabrication.electronics import CHIPS
from footsense.lab.fem.forward import DirectSolveFoot
from footsense.lab.fem.mesh import COARSE_MESH, RELEASED_MESH
from footsense.lab.report import StudyContext, Values, target, target_at_most
from footsense.lab.training.load_cases import paper_training, paper_verification

TITLE = "Speed against error"

#: Loads that a mesh is solved for anew.
_N_MESH_LOADS, _N_QUICK_MESH_LOADS = 12, 1
#: Calls of a network, and cycles of the service, that are timed.
_N_CALLS, _N_CYCLES = 2000, 800
#: Time of the host for a transaction [us].
HOST_COST_US = 40
_SHOWN_LOAD = "measured_walk"
#: Robots of six legs by board and number of buses. On one bus the AD7147 are behind a multiplexer, too.
_ROBOTS = CONFIGURATIONS | {
    "ad7147_one_bus": replace(DEFAULT, buses=SMALL_BOARD.buses),
    "ad7147_two_buses": DEFAULT,
}
#: Limits of the targets: network, six legs [us]; whole cycle over the time between two frames [1], by robot.
_WANTED_NETWORK_US = 90.0
_WANTED_CYCLE_REL = {"ad7147_two_buses": 0.12, "one_bus": 0.12}


#: Scenes in which boards are timed and forces published.
_TIMED_SCENES = ("hanging", "measured_walk", "tripod")


def compute(context: StudyContext) -> Values:
    """Measure age, price and cycle of the boards, table against mesh, and rates of converting and publishing."""
    ng.ngsglobals.msg_level = 0
    for name in _TIMED_SCENES:
        context.scene(name)
    published = measure_latency_vs_error(context)
    context.report_progress("rates done")
    mesh = _table_and_mesh(context)
    context.report_progress("table and mesh done")
    boards = {key: _board(key, quick=context.quick) for key in _ROBOTS}
    network_file = context.files(NETWORK_FILE) / NETWORK_FILE
    (six_legs_us,) = network_durations_us([network_file], len(LEGS), 50 if context.quick else _N_CALLS)
    held_mn = next(
        point["walk"]["held_error_norm_rms_mn"]
        for point in published["points"]
        if (point["rate_sps"], point["publish_every"]) == (400, 4)
    )
    walk = published.pop("loads")[_SHOWN_LOAD]["methods"]
    return {
        "boards": boards,
        "network": {"weights": context.network.card["training"]["weights"], "six_legs_us": six_legs_us},
        "mesh": mesh,
        "published": published | {"walk": walk},
        "targets": [
            target_at_most("network, six legs, p50", [_WANTED_NETWORK_US], [six_legs_us], "{:.0f} us"),
            *(
                target_at_most(
                    f"{board['board']}: whole cycle over the time between two frames, p50",
                    [_WANTED_CYCLE_REL[key]],
                    [board["cycle_us"] / board["frame_us"]],
                    "{:.3f}",
                )
                for key, board in boards.items()
                if key in _WANTED_CYCLE_REL
            ),
            target(
                "one solve of the mesh per load over a look-up in its table, time",
                "50",
                f"{mesh['mesh_s'] / mesh['table_s']:.0f}",
                met=mesh["mesh_s"] / mesh["table_s"] >= 50,
            ),
            target_at_most(
                "measured walk, error at any time of the last force sent, default rates, rms",
                [35],
                [held_mn],
                "{:.0f} mN",
            ),
        ],
    }


def _board(key: str, *, quick: bool) -> Values:
    """Return parts, price and times of a board on its buses."""
    config = _ROBOTS[key]
    scan_ms, sent_after_ms = scan_period_ms(config, HOST_COST_US), newest_reading_age_ms(config)["p50"]
    step_ms = scan_ms / config.scan_plan.n_conversions
    found: Values = {
        "title": f"{config.board}, {('one bus', 'two buses')[len(config.buses) - 1]}",
        "board": config.board,
        "n_chips": len(CHIPS[config.board]),
        "price_usd": sum(chip.price_usd for chip in CHIPS[config.board]),
        "sent_after_ms": sent_after_ms,
        "scan_ms": scan_ms,
        "mean_age_ms": sent_after_ms + 0.5 * (ELEMENTS - 1) * step_ms,
        "frame_us": 1e6 / config.frames_hz,
    }
    if key in _WANTED_CYCLE_REL:
        frames = simulated_walk_frames(N_WARM_UP_CYCLES + (50 if quick else _N_CYCLES), config)
        found["cycle_us"] = compare_cycle_durations(frames, config)["p50"]
    return found


def _table_and_mesh(context: StudyContext) -> Values:
    """Return times of a load [s], and errors of a solve of the mesh with open gaps, on the paper's loads."""
    response, capacitor, network = context.response, context.foot_design.capacitor, context.network
    paper_n = np.concatenate([paper_training(response).force_n, paper_verification(response).force_n])
    loads = ContactLoads.centred(paper_n)
    n = _N_QUICK_MESH_LOADS if context.quick else _N_MESH_LOADS
    normal, force_n = (part[np.linspace(0, len(paper_n) - 1, n).round().astype(int)] for part in loads)

    def read_pf(cells_um: Vector) -> Vector:
        distance_um = np.maximum(capacitor.gap_um - cells_um, 0.0) + capacitor.film_equivalent_um
        return capacitance_pf(capacitor, distance_um)

    def sensed(cells_um: Vector) -> tuple[Vector, Vector]:
        """Return mean closures [um], and the forces that the network reads [N]."""
        unloaded_pf = np.full(ELEMENTS, capacitor.unloaded_pf)
        closure_um = capacitor.closure_um(read_pf(cells_um), unloaded_pf)
        return element_means(cells_um), network.force_n(closure_um / capacitor.gap_um)

    def seconds(work: Callable[[], object]) -> float:
        started = default_timer()
        work()
        return default_timer() - started

    table_s = min(seconds(lambda: read_pf(response.free_closure_um(*loads))) for _ in range(3)) / len(paper_n)
    started = default_timer()
    solver = DirectSolveFoot(context.foot_design, COARSE_MESH if context.quick else RELEASED_MESH)
    before_s, started = default_timer() - started, default_timer()
    solved_um = np.stack([solver.cell_closures_um(*load) for load in zip(normal, force_n, strict=True)])
    mesh_s = (default_timer() - started) / n
    own_um, own_n = sensed(solved_um)
    table_um, table_n = sensed(Specimen(response).cell_closures_um(normal, force_n))
    errors = evaluate_force_errors(table_n, own_n)
    return {
        "table_s": table_s,
        "mesh_s": mesh_s,
        "before_s": before_s,
        "n": n,
        "closure_rel": rms(own_um - table_um) / rms(table_um),
        "direction_deg": errors.direction_deg,
        "direction_max_deg": errors.direction_max_deg,
        "magnitude_gf": errors.magnitude_gf,
    }
