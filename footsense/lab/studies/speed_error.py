"""Page `speed-error`: what a millisecond and a dollar buy, and time against error of models and rates of publishing."""

import tempfile
from functools import partial
from pathlib import Path

import ngsolve as ng
from msgspec.structs import replace

from firmware_interface.chips import ad7147, fdc1004
from footsense.benchmarks.cycle import (
    N_WARM_UP_CYCLES,
    compare_cycle_durations,
    network_durations_us,
    simulated_walk_frames,
)
from footsense.benchmarks.latency_vs_error import measure_latency_vs_error
from footsense.benchmarks.scan import CONFIGURATIONS, newest_reading_age_ms, scan_period_ms
from footsense.config import DEFAULT, SMALL_BOARD
from footsense.foot.network_card import NETWORK_FILE
from footsense.frames import LEGS
from footsense.lab.board_comparison.networks import NetworkSubject, train_and_judge
from footsense.lab.board_comparison.page import LOADS, boards_text, draw_boards
from footsense.lab.board_comparison.windows import BoardScan, judged_windows
from footsense.lab.evaluation.fidelity_levels import compare_levels
from footsense.lab.fabrication.electronics import CHIPS
from footsense.lab.fem.mesh import COARSE_MESH, RELEASED_MESH
from footsense.lab.parallel import N_PROCESSES, compute_each
from footsense.lab.report import SAME_TABLE, StudyContext, Values, table, target
from footsense.lab.training.gait_readings import random_gaits
from footsense.lab.training.load_cases import random_loads

TITLE = "Speed against error"

#: Loads that a mesh is solved for anew.
_N_MESH_LOADS, _N_QUICK_MESH_LOADS = 12, 1
#: Channels of each hidden layer, eight units each; starts, and steps of training: far fewer than a released network's.
_CHANNELS, _QUICK_CHANNELS, _N_SEEDS, _STEPS, _QUICK_STEPS = (4, 14, 40), (4,), 5, 1000, 100
#: Random gaits, conversions of each, and loads at rest for training; gaits and loads of another seed for the test.
_N_GAITS, _CONVERSIONS, _N_RESTS, _N_TEST_GAITS, _N_TEST_RESTS = 300, 1100, 20_000, 100, 5_000
_TRAINING_SEED, _TEST_SEED = 11, 12
#: Calls of a network, and cycles of the service, that are timed.
_N_CALLS, _N_CYCLES = 2000, 800
#: Time of the host for a transaction [us].
_HOST_COST_US = 40
_SHOWN_LOADS = ("measured_walk", "step")


#: Largest capacitance that the converter of a board reads [pF].
_RANGE_END_PF = {"ad7147": ad7147.RANGE_END_PF, "fdc1004": fdc1004.RANGE_END_PF}
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
    """Measure age, price and error of boards and networks, foot models, and rates of converting and publishing."""
    ng.ngsglobals.msg_level = 0
    for name in _TIMED_SCENES:
        context.scene(name)
    published = measure_latency_vs_error(context)
    context.report_progress("rates done")
    models = compare_levels(
        context.response,
        context.foot_design,
        COARSE_MESH if context.quick else RELEASED_MESH,
        _N_QUICK_MESH_LOADS if context.quick else _N_MESH_LOADS,
        context.network.force_n,
    )
    context.report_progress("models of the foot done")
    bought = _boards_and_sizes(context)
    context.drawings["speed-error.png"] = draw_boards(bought)
    table_s = next(row["seconds"] for row in models if row["model"] == "linear")
    mesh_s = next(row["seconds"] for row in models if row["model"] == "mesh")
    held = _point(published, 400, 4)["walk"]["held_error_norm_rms_mn"]
    return {
        **bought,
        "models": models,
        "published": {**published, "loads": {name: published["loads"][name] for name in _SHOWN_LOADS}},
        "targets": [
            *_duration_targets(bought),
            target(
                "one solve of the mesh per load over a look-up in its table, time",
                "50",
                f"{mesh_s / table_s:.0f}",
                met=mesh_s / table_s >= 50,
            ),
            target(
                "measured walk, error at any time of the last force sent, default rates, rms",
                "35 mN",
                f"{held:.0f} mN",
                met=held <= 35,
            ),
        ],
    }


def _duration_targets(bought: Values) -> list[Values]:
    """Return the targets of the times of network and cycle."""
    released_us = bought["networks"][-1]["six_legs_us"]
    rows = [
        target(
            "network, six legs, p50",
            f"{_WANTED_NETWORK_US:g} us",
            f"{released_us:.0f} us",
            met=released_us <= _WANTED_NETWORK_US,
        )
    ]
    for key, cycle_rel in _WANTED_CYCLE_REL.items():
        board = bought["boards"][key]
        found_rel = board["cycle_us"] / board["frame_us"]
        rows.append(
            target(
                f"{board['board']}: whole cycle over the time between two frames, p50",
                f"{cycle_rel:g}",
                f"{found_rel:.3f}",
                met=found_rel <= cycle_rel,
            )
        )
    return rows


def _scan_of(key: str) -> BoardScan:
    """Return the scan of a board as its simulation on its buses takes it."""
    config = _ROBOTS[key]
    return BoardScan(
        step_s=1e-3 * scan_period_ms(config, _HOST_COST_US) / config.scan_plan.n_conversions,
        send_delay_s=1e-3 * newest_reading_age_ms(config)["p50"],
        noise_pf=1e-3 * config.conversion_rate.noise_ff,
        range_end_pf=_RANGE_END_PF[config.board],
    )


def _board(key: str, scan: BoardScan) -> Values:
    """Return parts, price and times of a board."""
    config = _ROBOTS[key]
    return {
        "title": f"{config.board}, {('one bus', 'two buses')[len(config.buses) - 1]}",
        "board": config.board,
        "n_chips": len(CHIPS[config.board]),
        "price_usd": sum(chip.price_usd for chip in CHIPS[config.board]),
        "sent_after_ms": 1e3 * scan.send_delay_s,
        "scan_ms": 1e3 * scan.step_s * config.scan_plan.n_conversions,
        "mean_age_ms": 1e3 * scan.mean_age_s,
        "range_end_pf": scan.range_end_pf,
        "frame_us": 1e6 / config.frames_hz,
    }


def _boards_and_sizes(context: StudyContext) -> Values:
    """Return boards by their key, networks of every size, and the errors of all of them by start."""
    response, loads, quick = context.response, context.foot_design.loads, context.quick
    seeds, steps = (2, _QUICK_STEPS) if quick else (_N_SEEDS, _STEPS)
    n_gaits, n_rests, n_test_gaits, n_test_rests = (
        (8, 400, 2, 100) if quick else (_N_GAITS, _N_RESTS, _N_TEST_GAITS, _N_TEST_RESTS)
    )
    scans = {key: _scan_of(key) for key in _ROBOTS}
    boards = {key: _board(key, scan) for key, scan in scans.items()}
    for key in _WANTED_CYCLE_REL:
        frames = simulated_walk_frames(N_WARM_UP_CYCLES + (50 if quick else _N_CYCLES), _ROBOTS[key])
        boards[key]["cycle_us"] = compare_cycle_durations(frames, _ROBOTS[key])["p50"]
    context.report_progress("boards timed")
    subject = NetworkSubject(
        response,
        random_gaits(response, _TRAINING_SEED, n_gaits, _CONVERSIONS, loads.max_n),
        random_loads(response, loads, n_rests, _TRAINING_SEED),
        {
            key: judged_windows(response, loads, scan, _TEST_SEED, n_test_rests, n_test_gaits)
            for key, scan in scans.items()
        },
        context.files(NETWORK_FILE) / NETWORK_FILE,
        loads.min_relative_loss_force_n,
    )
    for key, tests in subject.tests.items():
        boards[key]["without_force_rel"] = {load: test.without_force_rel for load, test in tests.items()}
    context.report_progress("gaits done")
    sizes = [*(_QUICK_CHANNELS if quick else _CHANNELS), None]
    parts = [(channels, seed) for channels in sizes for seed in range(1 if channels is None else seeds)]
    found = dict(
        zip(
            parts,
            compute_each(
                partial(train_and_judge, subject, steps),
                parts,
                scheduler=context.scheduler,
                n_processes=1 if quick else N_PROCESSES,
            ),
            strict=True,
        )
    )
    context.report_progress("networks trained")
    firsts = [found[channels, 0] for channels in sizes]
    networks = [
        {
            "channels": channels,
            "weights": first.n_weights,
            "direction_deg": {
                key: {
                    load: [found[part].direction_deg[key][load] for part in parts if part[0] == channels]
                    for load in LOADS
                }
                for key in scans
            },
            "six_legs_us": time_us,
        }
        for channels, first, time_us in zip(
            sizes, firsts, _six_legs_us([first.file for first in firsts], quick=quick), strict=True
        )
    ]
    return {
        "host_cost_us": _HOST_COST_US,
        "n_seeds": seeds,
        "steps": steps,
        "boards": boards,
        "networks": networks,
    }


def _six_legs_us(files: list[bytes], *, quick: bool) -> list[float]:
    """Return the time of six legs through each network [us]."""
    with tempfile.TemporaryDirectory() as folder:
        paths = [Path(folder) / f"{number}.onnx" for number in range(len(files))]
        for path, file in zip(paths, files, strict=True):
            path.write_bytes(file)
        return network_durations_us(paths, len(LEGS), 50 if quick else _N_CALLS)


def _point(published: Values, rate_sps: int, every: int) -> Values:
    """Return the figures of one rate of conversions and of publishing."""
    found: Values = next(
        point
        for point in published["points"]
        if (point["rate_sps"], point["publish_every"]) == (rate_sps, every)
    )
    return found


def text(values: Values) -> str:
    """Return the page's Markdown."""
    models = table(
        "model | a load [s] | before the first [s] | loads | closures off, rms | direction off, mean / worst [deg]"
        " | magnitude [gf]",
        values["models"],
        "{model} | {seconds:.3g} | {before_s:.2g} | {n} | {closure_rel:.1%} | {direction_deg:.2f} / {direction_max_deg:.1f}"
        " | {magnitude_gf:.2f}",
    )
    published = values["published"]
    methods = table(
        f"load, {SAME_TABLE} | published, order of the scan | error when sent, rms [mN] | at any time [mN] | direction mean / 95 % [deg] | lag [ms]",
        [load | one for load in published["loads"].values() for one in load["methods"]],
        "{title} | {method}, {scan_order} | {errors[error_norm_rms_mn]:.0f} | {errors[held_error_norm_rms_mn]:.0f}"
        " | {errors[direction_error_mean_p95_deg][0]:.1f} / {errors[direction_error_mean_p95_deg][1]:.1f} | {errors[lag_ms]:.1f}",
    )
    points = table(
        f"S/s, {SAME_TABLE} | conversions per force | forces/s | CAN [kbit/s] | age of the last force, median / 99 % [ms] | noise, standing [mN]"
        " | walk, at any time [mN] | when sent [mN]",
        published["points"],
        "{rate_sps} | {publish_every} | {forces_hz:.0f} | {can_kbit_s:.0f}"
        " | {walk[held_age_p50_p99_ms][0]:.0f} / {walk[held_age_p50_p99_ms][1]:.0f} | {standing_noise_norm_rms_mn:.2f}"
        " | {walk[held_error_norm_rms_mn]:.0f} | {walk[error_norm_rms_mn]:.0f}",
    )
    return f"""
{boards_text(values)}

## Models of the foot

How a contact closes nine gaps, by four models: a formula (Boussinesq's point force on a half-space, a lattice of bars,
statics; nothing is fitted), the response table (`linear`), the table with gaps that close and carry load (`contact`:
simulator and training use it), and a solve of the table's mesh for each load (`mesh`, gaps open). On the paper's loads;
direction and magnitude are differences between the forces that the released network reads from both. `contact` is the
reference because it is what a scene needs; what its physics leaves out is on the page [physics](physics.md).

{models}

A table takes minutes to make; once made it answers as fast as the formula and as right as the mesh.

## Rates of converting and publishing

Six legs on a bus of 400 kHz with 40 us of the host per transaction: a conversion every {published["conversion_period_ms"]:.2f} ms, a force sent
{published["send_delay_ms"]:.2f} ms after the middle of its last conversion. *At any time* is the error of the last force that a consumer has, *lag*
the shift of the truth that fits it best. One seed of noise; {published["strides"]} strides of six legs, steps at {published["scan_phases"]} phases of the scan. Beside
the service's method stand the newest readings as they are, and readings extrapolated to the time of sending.

{methods}

{points}

The error on a walk is limited by age, not by noise.
"""
