"""Study `tradeoff`: latency against error of the whole chain, from conversion to the force that a consumer holds."""

import json
from collections.abc import Callable
from dataclasses import asdict
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from footsense.benchmarks.latency_vs_error.chain import (
    ORDERS,
    PublishedForces,
    by_element,
    by_frame,
    convert,
    extrapolated,
    pace,
    without_alignment,
)
from footsense.benchmarks.latency_vs_error.errors import latency_and_errors, settling_ms
from footsense.benchmarks.latency_vs_error.grid import OperatingPoint, WalkAndStand, grid_figure
from footsense.benchmarks.latency_vs_error.loads import LoadCase, load_cases, measured_truth
from footsense.benchmarks.latency_vs_error.tables import FIGURE, MethodResult, Results, Size, body
from footsense.foot.network_card import TrainedInputs, read_card
from footsense.foot.specimen import Foot
from footsense.lab.studies.networks.network_size import train_sizes
from footsense.lab.studies.page import Page, StudyContext
from footsense.lab.training.export import OnnxNetwork, onnx_model
from footsense.lab.training.network import Weights

FULL = Size(
    strides=4,
    phases=6,
    rates_sps=(400, 200, 100),
    averaged=(1, 2, 4, 8),
    channels=(2, 8),
    cases=10_000,
    training_steps=2000,
)
QUICK = Size(
    strides=1, phases=2, rates_sps=(400,), averaged=(1, 2), channels=(4,), cases=2000, training_steps=1000
)

_SEED = 3

#: Publishing methods by name, with the orders of the scan in which they are tried.
_METHODS: dict[str, tuple[Callable[..., PublishedForces], tuple[str, ...]]] = {
    "frame": (by_frame, ("raster", "lo_shu")),
    "element": (by_element, ("raster", "lo_shu")),
    "frame, skew left in": (without_alignment, ("raster", "lo_shu")),
    "element, by lines": (partial(extrapolated, degree=1), ("lo_shu",)),
    "element, by parabolas": (partial(extrapolated, degree=2), ("lo_shu",)),
}


def _results(load: LoadCase, bench: StudyContext, card: TrainedInputs) -> Results:
    """Return the results of every publishing method under one load."""
    foot, truth = Foot(bench.response), load.truth
    readings = {
        name: convert(foot, truth.feet, order, 400, truth.end_ns, _SEED) for name, order in ORDERS.items()
    }
    results = {}
    for method, (publish, orders) in _METHODS.items():
        for order in orders:
            published = publish(readings[order], bench.network, card)
            settling = None
            if load.begins_ns is not None:
                each_ms = settling_ms(published, truth, load.begins_ns)
                settling = (float(np.median(each_ms)), float(each_ms.max()))
            errors = latency_and_errors(published, truth)
            results[method, order] = MethodResult(
                method=method, order=order, errors=errors, settling_ms=settling
            )
    return results


def _points(
    bench: StudyContext, size: Size, card: TrainedInputs
) -> tuple[list[OperatingPoint], list[OperatingPoint]]:
    """Return rates, averaging and publish modes with the shipped network, and networks of other sizes."""
    foot, truth = Foot(bench.response), measured_truth(size.strides)
    weights = bench.network.card["training"]["weights"]
    feet = {rate: WalkAndStand.at(rate, foot, truth) for rate in size.rates_sps}
    points = []
    for rate in size.rates_sps:
        for n_averaged, publish in (*((n, "frame") for n in size.averaged), (1, "element")):
            points.append(feet[rate].operating_point(bench.network, card, n_averaged, publish, weights))
        bench.say(f"tradeoff: {rate} S/s")
    sizes = [
        feet[400].operating_point(_onnx_network(trained), card, 1, publish, trained.size)
        for trained in train_sizes(bench, size.channels, size.cases, size.training_steps)
        for publish in ("frame", "element")
    ]
    return points, sizes


def _onnx_network(weights: Weights) -> OnnxNetwork:
    """Return a trained network as ONNX Runtime computes it."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "network.onnx"
        path.write_bytes(onnx_model(weights, {}).SerializeToString())
        return OnnxNetwork(path)


def page(bench: StudyContext) -> Page:
    """Run the study on the released network, or its quick form."""
    card = read_card(json.dumps(bench.network.card), str(bench.models)).trained_inputs
    size = QUICK if bench.quick else FULL
    loads = load_cases(size.strides, size.phases)
    results: dict[str, Results] = {}
    for name, load in loads.items():
        results[name] = _results(load, bench, card)
        bench.say(f"tradeoff: {name}")
    points, sizes = _points(bench, size, card)
    values = {
        "step_ms": pace(400).step_ns * 1e-6,
        "lead_ms": pace(400).lead_ns * 1e-6,
        "loads": {name: [asdict(result) for result in of.values()] for name, of in results.items()},
        "points": [asdict(point) for point in points],
        "sizes": [asdict(point) for point in sizes],
    }
    return Page(
        name="tradeoff",
        title="Latency against error",
        body=body(size, loads, results, points, sizes),
        figures={FIGURE: grid_figure(points, sizes)},
        values=values,
    )
