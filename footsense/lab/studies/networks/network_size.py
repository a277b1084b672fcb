"""Study `network-size`: what more weights buy, and what they cost."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import partial
from timeit import Timer

import numpy as np
import onnxruntime
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from footsense.lab.evaluation.evaluate import Errors, errors
from footsense.lab.studies.page import Page, Workbench, table
from footsense.lab.training.export import onnx_model
from footsense.lab.training.load_cases import Cases, measured_closure_rel, paper_verification, wide
from footsense.lab.training.network import Weights
from footsense.lab.training.train import Protocol, predict, train

#: Channels of each hidden layer, eight units each; 14 are shipped.
CHANNELS, QUICK_CHANNELS = (2, 4, 6, 8, 11, 14, 18, 24), (4, 8)
#: Steps of training, far fewer than the shipped network's, the same for every size.
STEPS, QUICK_STEPS, BATCH = 4000, 1000, 256
#: Random loads that are learnt from and asked, and their seeds.
CASES, QUICK_CASES, LEARNT_SEED, ASKED_SEED = 20_000, 2000, 11, 12
#: More weights than this the project does not want.
WEIGHT_LIMIT = 2000
#: Runs in one timing, and timings, of which the fastest counts: whatever else runs only adds.
RUNS, TIMINGS = 200, 25

_FIGURE = "network-size.png"


@dataclass(frozen=True, slots=True, kw_only=True)
class Result:
    """What one size costs and is worth.

    Attributes:
        channels: Channels of each hidden layer.
        weights: Numbers that training finds.
        run_us: One row through ONNX Runtime on one thread [us].
        wide: Errors on held-out random loads with noise.
        paper: Errors on the paper's verification cases with noise.
    """

    channels: int
    weights: int
    run_us: float
    wide: Errors
    paper: Errors


def run_us(models: list[bytes]) -> list[float]:
    """Return what one row takes through each ONNX file on one thread [us], in turns, the fastest timing of each.

    Args:
        models: The files' bytes.
    """
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    timers = []
    for model in models:
        session = onnxruntime.InferenceSession(model, options, ["CPUExecutionProvider"])
        row = {
            offered.name: np.zeros([n if isinstance(n, int) else 1 for n in offered.shape], np.float32)
            for offered in session.get_inputs()
        }
        timers.append(Timer(partial(session.run, None, row)))
    fastest = np.min([[timer.timeit(RUNS) for timer in timers] for _ in range(TIMINGS)], axis=0)
    return [1e6 * float(seconds) / RUNS for seconds in fastest]


def learn_sizes(bench: Workbench, channels: Sequence[int], cases: int, steps: int) -> list[Weights]:
    """Return networks with so many channels each, taught by the same steps on the same random loads."""
    learnt = wide(bench.response, bench.sole.loads, cases, LEARNT_SEED)
    trained = []
    for c in channels:
        trained.append(train(learnt, bench.response.design, Protocol(channels=c, steps=steps, batch=BATCH)))
        bench.say(f"{trained[-1].size} weights have learnt")
    return trained


def _errors(weights: Weights, cases: Cases, seen_rel: NDArray[np.float64]) -> Errors:
    """Return the errors of a network on measured closures of cases."""
    force_n, _ = predict(weights, seen_rel)
    return errors(cases.force_n, force_n)


def _decorate(axes: Axes, values: list[float], results: list[Result]) -> None:
    """Draw direction errors over a cost, and where the limit of the weights lies."""
    for name, colour, what in (
        ("wide", "C0", "random loads"),
        ("paper", "C3", "the paper's 180, centred"),
    ):
        mean = [getattr(result, name).direction_deg for result in results]
        high = [getattr(result, name).direction_p95_deg for result in results]
        axes.loglog(values, mean, "o-", color=colour, label=f"{what}, mean")
        axes.loglog(values, high, "^:", color=colour, label=f"{what}, p95", ms=4)
    axes.grid(alpha=0.3, which="both")


def _figure(results: list[Result]) -> Figure:
    """Return the direction error against weights and against microseconds."""
    figure = Figure(figsize=(8.8, 4.0), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True)
    _decorate(left, [float(result.weights) for result in results], results)
    _decorate(right, [result.run_us for result in results], results)
    left.axvline(WEIGHT_LIMIT, color="k", ls="--", lw=1, label=f"{WEIGHT_LIMIT} weights")
    left.set(xlabel="weights", ylabel="direction error [deg]")
    right.set(xlabel="one row, one thread [us]")
    left.legend(fontsize=7)
    return figure


def _beside(other: Result, chosen: Result) -> str:
    """Say what another size errs and takes, compared with the chosen one."""
    error, time = other.wide.direction_deg / chosen.wide.direction_deg, other.run_us / chosen.run_us
    return f"With {other.weights} weights it errs {error:.2f} times as much in {time:.2f} of the time."


def page(bench: Workbench) -> Page:
    """Return the page."""
    quick, response, loads = bench.quick, bench.response, bench.sole.loads
    channels, steps, n = (QUICK_CHANNELS, QUICK_STEPS, QUICK_CASES) if quick else (CHANNELS, STEPS, CASES)
    held_out = wide(response, loads, n // 4, ASKED_SEED)
    felt = np.linalg.norm(held_out.force_n, axis=1) >= loads.judged_from_n
    asked = Cases(held_out.force_n[felt], held_out.closure_um[felt])
    paper = paper_verification(response)
    rng = np.random.default_rng(ASKED_SEED)
    seen, paper_seen = (
        measured_closure_rel(response.design, cases.closure_um, rng) for cases in (asked, paper)
    )
    trained = learn_sizes(bench, channels, n, steps)
    times_us = run_us([onnx_model(weights, {}).SerializeToString() for weights in trained])
    results = [
        Result(
            channels=weights.channels,
            weights=weights.size,
            run_us=time_us,
            wide=_errors(weights, asked, seen),
            paper=_errors(weights, paper, paper_seen),
        )
        for weights, time_us in zip(trained, times_us, strict=True)
    ]
    rows = [
        [
            f"{result.weights}",
            f"{result.channels}",
            f"{result.run_us:.1f}",
            f"{result.wide.direction_deg:.3f} / {result.wide.direction_p95_deg:.3f}",
            f"{result.wide.magnitude_gf:.3f} / {result.wide.magnitude_p95_gf:.3f}",
            f"{result.paper.direction_deg:.3f} / {result.paper.direction_p95_deg:.3f}",
            f"{result.paper.magnitude_gf:.3f} / {result.paper.magnitude_p95_gf:.3f}",
        ]
        for result in results
    ]
    header = ["weights", "channels", "one row [us]", "random: direction [deg]", "magnitude [gf]"]
    chosen = max((r for r in results if r.weights <= WEIGHT_LIMIT), key=lambda r: r.weights)
    beside = " ".join(_beside(other, chosen) for other in (results[0], results[-1]) if other is not chosen)
    body = f"""
{"**Quick run: two sizes, few steps. The figures are not those of the study.**" if quick else ""}

The same foot, the same {n} random loads, the same {steps} steps of {BATCH} cases (the shipped network learns
much longer; what counts here is the comparison): how much does each size err, and how long does it take? Errors are
mean / p95 with the converter's noise, on {len(asked.force_n)} held-out loads from {loads.judged_from_n:g} N and on the
paper's 180. Time is one row through ONNX Runtime on one thread, the fastest of {TIMINGS} timings of {RUNS} runs.
A mean above its p95 is the work of a few directions near the diagonals (page `limit`).

{table([*header, "paper: direction [deg]", "magnitude [gf]"], rows)}

![]({_FIGURE})

Time hardly grows with the size, error falls all the way: so the largest size within {WEIGHT_LIMIT} weights is the one
shipped. It has {chosen.weights} and errs here by {chosen.wide.direction_deg:.3f} deg on the random loads in
{chosen.run_us:.1f} us. {beside}
"""
    values = {"quick": quick, "steps": steps, "cases": n, "sizes": [asdict(result) for result in results]}
    return Page(
        name="network-size",
        title="How many weights",
        body=body,
        figures={_FIGURE: _figure(results)},
        values=values,
    )
