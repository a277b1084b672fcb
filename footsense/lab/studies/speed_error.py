"""Page `speed-error`: time against error of the models of the foot, of network sizes, and of rates of scan and publishing."""

from dataclasses import replace
from functools import partial
from timeit import Timer, default_timer

import ngsolve as ng
import numpy as np
import onnxruntime

from footsense.benchmarks.latency_vs_error import measure_latency_vs_error
from footsense.estimation.missing_elements import Imputation
from footsense.estimation.network import steady_windows
from footsense.foot.force_errors import evaluate_force_errors
from footsense.foot.specimen import ContactLoads
from footsense.frames import ELEMENTS
from footsense.lab.evaluation.evaluate_models import rms
from footsense.lab.evaluation.fidelity_levels import LevelResponse, fidelity_levels
from footsense.lab.fem.mesh import COARSE_MESH, RELEASED_MESH
from footsense.lab.report import StudyContext, Values, spread, table, target
from footsense.lab.training.export import onnx_model
from footsense.lab.training.gait_readings import random_gaits
from footsense.lab.training.gait_windows import windows_of
from footsense.lab.training.load_cases import (
    measured_closure_rel,
    paper_training,
    paper_verification,
    random_loads,
)
from footsense.lab.training.train_windowed import WindowTrainingSettings, train_windowed
from footsense.lab.training.windowed_network import mean_closure_product_matrix, predict
from footsense.ports import Window

TITLE = "Speed against error"

#: Loads that a mesh is solved for anew.
_N_MESH_LOADS, _N_QUICK_MESH_LOADS = 12, 1
#: Channels of each hidden layer, eight units each; starts, and steps of training: far fewer than a released network's.
_CHANNELS, _QUICK_CHANNELS, _N_SEEDS, _STEPS, _QUICK_STEPS = (4, 14, 40), (4,), 5, 1000, 100
#: Random gaits and loads at rest for training; a quarter as many of another seed for the test.
_N_GAITS, _N_RESTS, _TRAINING_SEED, _TEST_SEED = 300, 20_000, 11, 12
#: Conversions of a gait, and true force from which the errors in gaits count [N].
_CONVERSIONS, _LOADED_N = 1100, 0.1
#: Legs in a call, runs in a timing, timings of each size, one after the other; the fastest counts.
_LEGS, _RUNS, _N_TIMINGS = 6, 200, 25
_SHOWN_LOADS = ("measured_walk", "step")


def compute(context: StudyContext) -> Values:
    """Measure time and error of foot models, networks of several sizes, and rates of converting and publishing."""
    ng.ngsglobals.msg_level = 0
    published = measure_latency_vs_error(context)
    context.report_progress("rates done")
    models = _foot_models(context)
    context.report_progress("models of the foot done")
    sizes = _network_sizes(context)
    table_s = next(row["seconds"] for row in models if row["model"] == "linear")
    mesh_s = next(row["seconds"] for row in models if row["model"] == "mesh")
    held = _point(published, 400, 4)["walk"]["held_error_norm_rms_mn"]
    return {
        "models": models,
        "n_seeds": 2 if context.quick else _N_SEEDS,
        "steps": _QUICK_STEPS if context.quick else _STEPS,
        "sizes": sizes,
        "published": {**published, "loads": {name: published["loads"][name] for name in _SHOWN_LOADS}},
        "targets": [
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


def _point(published: Values, rate_sps: int, every: int) -> Values:
    """Return the figures of one rate of conversions and of publishing."""
    found: Values = next(
        point
        for point in published["points"]
        if (point["rate_sps"], point["publish_every"]) == (rate_sps, every)
    )
    return found


def _foot_models(context: StudyContext) -> list[Values]:
    """Return time of a load [s] and difference from the table with gap contact, by model."""
    response, design = context.response, context.response.design
    force_n = np.concatenate([paper_training(response).force_n, paper_verification(response).force_n])
    loads = ContactLoads.centred(force_n)
    n_solved = _N_QUICK_MESH_LOADS if context.quick else _N_MESH_LOADS
    some = np.linspace(0, len(force_n) - 1, n_solved).round().astype(int)
    size = COARSE_MESH if context.quick else RELEASED_MESH
    answers: dict[str, LevelResponse] = {}
    rows: list[Values] = []
    for name, make_level in fidelity_levels(response, context.foot_design, size).items():
        on_mesh = name == "mesh"
        normal, own_n = (part[some] if on_mesh else part for part in loads)
        started = default_timer()
        level = make_level()
        before_s = default_timer() - started
        times_s = []
        for _ in range(1 if on_mesh else 3):
            started = default_timer()
            answers[name] = level(normal, own_n)
            times_s.append(default_timer() - started)
        rows.append(
            {"model": name, "seconds": min(times_s) / len(own_n), "before_s": before_s, "n": len(own_n)}
        )
    finest = answers["contact"]

    def read_n(answer: LevelResponse) -> np.ndarray:
        closure_um = design.closure_um(answer.capacitance_pf, np.full(ELEMENTS, design.unloaded_pf))
        return context.network.force_n(closure_um / design.gap_um)

    for row in rows:
        own = answers[row["model"]]
        other = LevelResponse(*(part[some] for part in (finest.closure_um, finest.capacitance_pf)))
        reference = other if row["model"] == "mesh" else finest
        errors = evaluate_force_errors(read_n(reference), read_n(own))
        row |= {
            "closure_rel": rms(own.closure_um - reference.closure_um) / rms(reference.closure_um),
            "direction_deg": errors.direction_deg,
            "direction_max_deg": errors.direction_max_deg,
            "magnitude_gf": errors.magnitude_gf,
        }
    return rows


def _network_sizes(context: StudyContext) -> list[Values]:
    """Return weights, time of six legs [us], and errors of networks of every size, by start."""
    response, loads, design = context.response, context.foot_design.loads, context.response.design
    n_gaits, n_rests = (8, 400) if context.quick else (_N_GAITS, _N_RESTS)
    channels = _QUICK_CHANNELS if context.quick else _CHANNELS
    gaits, test_gaits = (
        random_gaits(response, seed, n, _CONVERSIONS, loads.max_n)
        for seed, n in ((_TRAINING_SEED, n_gaits), (_TEST_SEED, n_gaits // 4))
    )
    rest, test_rest = (
        random_loads(response, loads, n, seed)
        for seed, n in ((_TRAINING_SEED, n_rests), (_TEST_SEED, n_rests // 4))
    )
    walked = windows_of(test_gaits)
    loaded = np.linalg.norm(walked.force_n, axis=1) >= _LOADED_N
    nothing = np.zeros((int(loaded.sum()), ELEMENTS), bool)
    counted = np.linalg.norm(test_rest.force_n, axis=1) >= loads.min_evaluated_force_n
    rng = np.random.default_rng(_TEST_SEED)
    resting = steady_windows(measured_closure_rel(design, test_rest.closure_um[counted], rng))
    tests = {
        "gaits": (
            walked.force_n[loaded],
            Window(walked.closure_rel[loaded], walked.age_s[loaded], nothing),
        ),
        "rest": (test_rest.force_n[counted], resting),
    }
    moments = mean_closure_product_matrix(rest.with_symmetric_copies().closure_um / design.gap_um)
    settings = WindowTrainingSettings(
        steps=_QUICK_STEPS if context.quick else _STEPS, min_force_n=loads.min_relative_loss_force_n
    )
    rows, models = [], []
    for n_channels in channels:
        errors: dict[str, list[float]] = {name: [] for name in tests}
        for seed in range(2 if context.quick else _N_SEEDS):
            own = replace(settings, channels=n_channels, seed=seed)
            weights = train_windowed(gaits, rest, design, own, Imputation(moments))
            for name, (force_n, window) in tests.items():
                found = evaluate_force_errors(force_n, predict(weights, window).force_n)
                errors[name].append(found.direction_deg)
        models.append(onnx_model(weights, {}).SerializeToString())
        rows.append({"channels": n_channels, "weights": weights.n_weights, "direction_deg": errors})
        context.report_progress(f"networks of {weights.n_weights} weights trained")
    for row, time_us in zip(rows, _times_us(models), strict=True):
        row["six_legs_us"] = time_us
    return rows


def _times_us(models: list[bytes]) -> list[float]:
    """Return the time of six legs through each ONNX model on one thread [us]; the models take turns."""
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    timers = []
    for model in models:
        session = onnxruntime.InferenceSession(model, options, ["CPUExecutionProvider"])
        legs = {one.name: np.zeros((_LEGS, one.shape[1]), np.float32) for one in session.get_inputs()}
        timers.append(Timer(partial(session.run, None, legs)))
    fastest = np.min([[timer.timeit(_RUNS) for timer in timers] for _ in range(_N_TIMINGS)], axis=0)
    return [1e6 * float(seconds) / _RUNS for seconds in fastest]


def text(values: Values) -> str:
    """Return the page's Markdown."""
    models = table(
        "model | a load [s] | before the first [s] | loads | closures off, rms | direction off, mean / worst [deg]"
        " | magnitude [gf]",
        values["models"],
        "{model} | {seconds:.3g} | {before_s:.2g} | {n} | {closure_rel:.1%} | {direction_deg:.2f} / {direction_max_deg:.1f}"
        " | {magnitude_gf:.2f}",
    )
    sizes = table(
        "weights | six legs [us] | random gaits, direction [deg] | loads at rest, direction [deg]",
        [
            (
                row["weights"],
                f"{row['six_legs_us']:.0f}",
                *(spread(row["direction_deg"][test]) for test in ("gaits", "rest")),
            )
            for row in values["sizes"]
        ],
    )
    published = values["published"]
    methods = table(
        "load | published, order of the scan | error when sent, rms [mN] | at any time [mN] | direction mean / 95 % [deg] | lag [ms]",
        [load | one for load in published["loads"].values() for one in load["methods"]],
        "{title} | {method}, {scan_order} | {errors[error_norm_rms_mn]:.0f} | {errors[held_error_norm_rms_mn]:.0f}"
        " | {errors[direction_error_mean_p95_deg][0]:.1f} / {errors[direction_error_mean_p95_deg][1]:.1f} | {errors[lag_ms]:.1f}",
    )
    points = table(
        "S/s | conversions per force | forces/s | CAN [kbit/s] | age of the last force, median / 99 % [ms] | noise, standing [mN]"
        " | walk, at any time [mN] | when sent [mN]",
        published["points"],
        "{rate_sps} | {publish_every} | {forces_hz:.0f} | {can_kbit_s:.0f}"
        " | {walk[held_age_p50_p99_ms][0]:.0f} / {walk[held_age_p50_p99_ms][1]:.0f} | {standing_noise_norm_rms_mn:.2f}"
        " | {walk[held_error_norm_rms_mn]:.0f} | {walk[error_norm_rms_mn]:.0f}",
    )
    return f"""
## Models of the foot

How a contact closes nine gaps, by four models: a formula (Boussinesq's point force on a half-space, a lattice of bars,
statics; nothing is fitted), the response table (`linear`), the table with gaps that close and carry load (`contact`:
simulator and training use it), and a solve of the table's mesh for each load (`mesh`, gaps open). On the paper's loads;
direction and magnitude are differences between the forces that the released network reads from both. `contact` is the
reference because it is what a scene needs; what its physics leaves out is on the page [physics](physics.md).

{models}

A table takes minutes to make; once made it answers as fast as the formula and as right as the mesh.

## Sizes of the network

Windowed networks trained alike for {values["steps"]} steps, {values["n_seeds"]} starts of each size (the released network is trained much longer; the
comparison counts here): mean over the windows of each start, then over the starts. Tests are gaits and loads of another
seed, made by the response table of the training. Times are of one thread; the sizes take turns, the fastest of {_N_TIMINGS} counts.

{sizes}

## Rates of converting and publishing

Six legs on a bus of 400 kHz with 40 us of the host per transaction: a conversion every {published["conversion_period_ms"]:.2f} ms, a force sent
{published["send_delay_ms"]:.2f} ms after the middle of its last conversion. *At any time* is the error of the last force that a consumer has, *lag*
the shift of the truth that fits it best. One seed of noise; {published["strides"]} strides of six legs, steps at {published["scan_phases"]} phases of the scan. Beside
the service's method stand the newest readings as they are, and readings extrapolated to the time of sending.

{methods}

{points}

The error on a walk is limited by age, not by noise.
"""
