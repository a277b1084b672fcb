"""Study `network-size`: error and computing time of windowed networks by number of weights."""

from dataclasses import dataclass
from functools import partial
from timeit import Timer

import numpy as np
import onnxruntime
from matplotlib.figure import Figure

from footsense.estimation.missing_elements import Imputation
from footsense.estimation.network import steady_windows
from footsense.foot.force_errors import ForceErrors, evaluate_force_errors
from footsense.frames import ELEMENTS
from footsense.lab.former_page import Plots, Study, StudyContext
from footsense.lab.plots import subplot_row
from footsense.lab.training.export import onnx_model
from footsense.lab.training.gait_readings import random_gaits
from footsense.lab.training.gait_windows import windows_of
from footsense.lab.training.load_cases import measured_closure_rel, random_loads
from footsense.lab.training.snapshot.train import mean_closure_product_matrix
from footsense.lab.training.train_windowed import WindowTrainingSettings, train_windowed
from footsense.lab.training.windowed_network import predict
from footsense.ports import Window

#: Channels of each hidden layer, eight units each.
CHANNELS, QUICK_CHANNELS = (4, 8, 14, 20, 28, 40), (4,)
#: Steps of training, far fewer than the released network's, the same for every size.
STEPS, QUICK_STEPS = 4000, 100
#: Random gaits and loads at rest for training, and for the test a quarter as many of another seed.
GAITS, QUICK_GAITS, RESTS, QUICK_RESTS, TRAINING_SEED, TEST_SEED = 300, 8, 20_000, 400, 11, 12
#: Conversions of a gait, and true force from which the errors of gaits count [N].
CONVERSIONS, LOADED_N = 1100, 0.1
#: Legs in a call, runs in a timing, and timings; the fastest counts, because other processes only add time.
LEGS, RUNS, TIMINGS = 6, 200, 25
#: Kinds of test loads.
_TEST_LABELS = {"gait_errors": "random gaits", "steady_load_errors": "loads at rest"}


@dataclass(frozen=True, slots=True, kw_only=True)
class NetworkSizeResult:
    """Errors and run time of a network of one size.

    Attributes:
        channels: Channels of each hidden layer.
        weights: Number of weights.
        six_legs_us: Six legs through ONNX Runtime on one thread [us].
        gait_errors: Errors on random gaits, as of sending.
        steady_load_errors: Errors on random loads at rest with noise.
    """

    channels: int
    weights: int
    six_legs_us: float
    gait_errors: ForceErrors
    steady_load_errors: ForceErrors


@dataclass(frozen=True, kw_only=True)
class Results:
    """Results of the study `network-size`: training settings, and errors and run times by size.

    Attributes:
        steps: Training steps.
        batch: Windows in a step.
        n_training_gaits: Random gaits for training.
        n_training_steady_loads: Loads at rest for training.
        min_test_force_n: Smallest force of the test loads at rest [N].
        sizes: The networks, the smallest first.
    """

    steps: int
    batch: int
    n_training_gaits: int
    n_training_steady_loads: int
    min_test_force_n: float
    sizes: list[NetworkSizeResult]


def run_us(models: list[bytes]) -> list[float]:
    """Return the run time of six legs through each ONNX file on one thread [us], the fastest of several runs."""
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    timers = []
    for model in models:
        session = onnxruntime.InferenceSession(model, options, ["CPUExecutionProvider"])
        legs = {one.name: np.zeros((LEGS, one.shape[1]), np.float32) for one in session.get_inputs()}
        timers.append(Timer(partial(session.run, None, legs)))
    fastest = np.min([[timer.timeit(RUNS) for timer in timers] for _ in range(TIMINGS)], axis=0)
    return [1e6 * float(seconds) / RUNS for seconds in fastest]


def compute(context: StudyContext) -> tuple[Results, Plots]:
    """Return errors and run time of a network of every size, trained alike, with a figure."""
    response, loads = context.response, context.foot_design.loads
    design = response.design
    quick = QUICK_CHANNELS, QUICK_STEPS, QUICK_GAITS, QUICK_RESTS
    channels, steps, n_gaits, n_rests = quick if context.quick else (CHANNELS, STEPS, GAITS, RESTS)
    gaits, test_gaits = (
        random_gaits(response, seed, n, CONVERSIONS, loads.max_n)
        for seed, n in ((TRAINING_SEED, n_gaits), (TEST_SEED, n_gaits // 4))
    )
    rest, test_rest = (
        random_loads(response, loads, n, seed)
        for seed, n in ((TRAINING_SEED, n_rests), (TEST_SEED, n_rests // 4))
    )
    context.report_progress(f"network-size: {n_gaits} gaits and {n_rests} loads at rest for training")
    walked = windows_of(test_gaits)
    loaded = np.linalg.norm(walked.force_n, axis=1) >= LOADED_N
    none_missing = np.zeros((int(loaded.sum()), ELEMENTS), bool)
    counted = np.linalg.norm(test_rest.force_n, axis=1) >= loads.min_evaluated_force_n
    rng = np.random.default_rng(TEST_SEED)
    tests = {
        "gait_errors": (
            walked.force_n[loaded],
            Window(walked.closure_rel[loaded], walked.age_s[loaded], none_missing),
        ),
        "steady_load_errors": (
            test_rest.force_n[counted],
            steady_windows(measured_closure_rel(design, test_rest.closure_um[counted], rng)),
        ),
    }
    imputation = Imputation(
        mean_closure_product_matrix(rest.with_symmetric_copies().closure_um / design.gap_um)
    )
    trained = []
    for c in channels:
        settings = WindowTrainingSettings(
            channels=c, steps=steps, min_force_n=loads.min_relative_loss_force_n
        )
        trained.append(train_windowed(gaits, rest, design, settings, imputation))
        context.report_progress(f"network-size: {trained[-1].n_weights} weights trained")
    times_us = run_us([onnx_model(weights, {}).SerializeToString() for weights in trained])
    sizes = []
    for weights, time_us in zip(trained, times_us, strict=True):
        judged = {
            name: evaluate_force_errors(force_n, predict(weights, window).force_n)
            for name, (force_n, window) in tests.items()
        }
        sizes.append(
            NetworkSizeResult(
                channels=weights.channels, weights=weights.n_weights, six_legs_us=time_us, **judged
            )
        )
    results = Results(
        steps=steps,
        batch=settings.batch,
        n_training_gaits=n_gaits,
        n_training_steady_loads=n_rests,
        min_test_force_n=loads.min_evaluated_force_n,
        sizes=sizes,
    )
    return results, {"network-size.png": _figure(sizes)}


def _figure(sizes: list[NetworkSizeResult]) -> Figure:
    """Return the figure of direction error over number of weights and over run time [us]."""
    figure, axes = subplot_row(2, 8.8, 4.0, sharey=True)
    for panel, quantity in zip(axes, ("weights", "six_legs_us"), strict=True):
        x = [getattr(size, quantity) for size in sizes]
        for (name, words), colour in zip(_TEST_LABELS.items(), ("C0", "C3"), strict=True):
            rows = [getattr(size, name) for size in sizes]
            mean, p95 = [row.direction_deg for row in rows], [row.direction_p95_deg for row in rows]
            panel.loglog(x, mean, "o-", color=colour, label=f"{words}, mean")
            panel.loglog(x, p95, "^:", color=colour, label=f"{words}, p95", ms=4)
        panel.grid(alpha=0.3, which="both")
    axes[0].set(xlabel="weights", ylabel="direction error [deg]")
    axes[1].set(xlabel="six legs, one thread [us]")
    axes[0].legend(fontsize=7)
    return figure


STUDY = Study(name="network-size", title="How many weights", compute=compute, uses_network=False)
