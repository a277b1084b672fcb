"""Study `network-size`: error and time of networks with more or fewer weights."""

from dataclasses import dataclass
from functools import partial
from timeit import Timer

import numpy as np
import onnxruntime
from matplotlib.figure import Figure

from footsense.foot.force_errors import Errors, errors
from footsense.lab.studies.page import Figures, Study, StudyContext
from footsense.lab.studies.plots import panels
from footsense.lab.training.export import onnx_model
from footsense.lab.training.load_cases import Cases, measured_closure_rel, paper_verification, random_loads
from footsense.lab.training.network import Weights
from footsense.lab.training.train import Protocol, predict, train

#: Channels of each hidden layer, eight units each; the released network has 14.
CHANNELS, QUICK_CHANNELS = (2, 4, 6, 8, 11, 14, 18, 24), (4, 8)
#: Steps of training, far fewer than the released network's, the same for every size.
STEPS, QUICK_STEPS, BATCH = 4000, 1000, 256
#: Random loads for training and for the test (a quarter as many), and their seeds.
CASES, QUICK_CASES, TRAINING_SEED, TEST_SEED = 20_000, 2000, 11, 12
#: The project's limit of the weights.
WEIGHT_LIMIT = 2000
#: Runs in one timing, and timings; the fastest counts, because other processes only add time.
RUNS, TIMINGS = 200, 25


@dataclass(frozen=True, slots=True, kw_only=True)
class Size:
    """Size, errors and run time of one network.

    Attributes:
        channels: Channels of each hidden layer.
        weights: Number of weights.
        run_us: One row through ONNX Runtime on one thread [us].
        random: Errors on held-out random loads with noise.
        paper: Errors on the paper's verification cases with noise.
    """

    channels: int
    weights: int
    run_us: float
    random: Errors
    paper: Errors


@dataclass(frozen=True, kw_only=True)
class Results:
    """Errors of networks of all sizes.

    Attributes:
        steps: Training steps.
        cases: Random loads for training.
        from_n: Smallest force of the test loads [N].
        sizes: The networks, the smallest first.
    """

    steps: int
    cases: int
    from_n: float
    sizes: list[Size]


def run_us(models: list[bytes]) -> list[float]:
    """Return the time of one row through each ONNX file on one thread [us], timed in turns, the fastest of each."""
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    timers = []
    for model in models:
        session = onnxruntime.InferenceSession(model, options, ["CPUExecutionProvider"])
        row = dict.fromkeys(("closure_rel", "missing"), np.zeros((1, 9), np.float32))
        timers.append(Timer(partial(session.run, None, row)))
    fastest = np.min([[timer.timeit(RUNS) for timer in timers] for _ in range(TIMINGS)], axis=0)
    return [1e6 * float(seconds) / RUNS for seconds in fastest]


def train_sizes(context: StudyContext, channels: tuple[int, ...], cases: int, steps: int) -> list[Weights]:
    """Return networks with so many channels each, trained in the same steps on the same random loads."""
    training = random_loads(context.response, context.foot_design.loads, cases, TRAINING_SEED)
    trained = []
    for c in channels:
        protocol = Protocol(channels=c, steps=steps, batch=BATCH)
        trained.append(train(training, context.response.design, protocol))
        context.say(f"network-size: {trained[-1].size} weights trained")
    return trained


def compute(context: StudyContext) -> tuple[Results, Figures]:
    """Train, test and time a network of every size."""
    response, loads = context.response, context.foot_design.loads
    quick = QUICK_CHANNELS, QUICK_STEPS, QUICK_CASES
    channels, steps, n = quick if context.quick else (CHANNELS, STEPS, CASES)
    drawn = random_loads(response, loads, n // 4, TEST_SEED)
    counted = np.linalg.norm(drawn.force_n, axis=1) >= loads.min_judged_n
    tests = Cases(drawn.force_n[counted], drawn.closure_um[counted]), paper_verification(response)
    rng = np.random.default_rng(TEST_SEED)
    measured = [
        (cases.force_n, measured_closure_rel(response.design, cases.closure_um, rng)) for cases in tests
    ]
    trained = train_sizes(context, channels, n, steps)
    times_us = run_us([onnx_model(weights, {}).SerializeToString() for weights in trained])
    sizes = []
    for c, weights, time_us in zip(channels, trained, times_us, strict=True):
        random, paper = (
            errors(force_n, predict(weights, closure_rel)[0]) for force_n, closure_rel in measured
        )
        sizes.append(Size(channels=c, weights=weights.size, run_us=time_us, random=random, paper=paper))
    return Results(steps=steps, cases=n, from_n=loads.min_judged_n, sizes=sizes), {
        "network-size.png": _figure(sizes)
    }


def _figure(sizes: list[Size]) -> Figure:
    """Draw the direction error over weights and over microseconds."""
    figure, axes = panels(2, 8.8, 4.0, sharey=True)
    drawn = (("random", "C0", "random loads"), ("paper", "C3", "the paper's 180, centred"))
    for panel, quantity in zip(axes, ("weights", "run_us"), strict=True):
        x = [getattr(size, quantity) for size in sizes]
        for name, colour, words in drawn:
            rows = [getattr(size, name) for size in sizes]
            mean, p95 = [row.direction_deg for row in rows], [row.direction_p95_deg for row in rows]
            panel.loglog(x, mean, "o-", color=colour, label=f"{words}, mean")
            panel.loglog(x, p95, "^:", color=colour, label=f"{words}, p95", ms=4)
        panel.grid(alpha=0.3, which="both")
    axes[0].axvline(WEIGHT_LIMIT, color="k", ls="--", lw=1, label=f"{WEIGHT_LIMIT} weights")
    axes[0].set(xlabel="weights", ylabel="direction error [deg]")
    axes[1].set(xlabel="one row, one thread [us]")
    axes[0].legend(fontsize=7)
    return figure


STUDY = Study(name="network-size", title="How many weights", compute=compute)
