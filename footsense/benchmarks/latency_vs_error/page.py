"""Study `tradeoff`: speed against error over the whole chain, from the conversion to what a consumer holds."""

import json
from collections.abc import Callable
from dataclasses import asdict
from functools import partial

import numpy as np

from footsense.benchmarks.latency_vs_error.chain import (
    ORDERS,
    Published,
    along,
    as_read,
    by_element,
    by_frame,
    convert,
    pace,
)
from footsense.benchmarks.latency_vs_error.errors import judge, settled_ms
from footsense.benchmarks.latency_vs_error.grid import Bench, Point, as_runtime, grid_figure
from footsense.benchmarks.latency_vs_error.loads import Scene, measured_truth, scenes
from footsense.benchmarks.latency_vs_error.tables import FIGURE, Row, Tried, body
from footsense.foot.network_card import TrainedInputs, read_card
from footsense.foot.specimen import Foot
from footsense.lab.studies.networks.network_size import learn_sizes
from footsense.lab.studies.page import Page, Workbench

FULL = Tried(
    strides=4,
    phases=6,
    rates_sps=(400, 200, 100),
    averaged=(1, 2, 4, 8),
    channels=(2, 8),
    cases=10_000,
    training_steps=2000,
)
QUICK = Tried(
    strides=1, phases=2, rates_sps=(400,), averaged=(1, 2), channels=(4,), cases=2000, training_steps=1000
)

_SEED = 3


#: Ways to publish, by name: what makes forces, and in which orders of the scan it is tried.
_WAYS: dict[str, tuple[Callable[..., Published], tuple[str, ...]]] = {
    "frame": (by_frame, ("raster", "lo_shu")),
    "element": (by_element, ("raster", "lo_shu")),
    "frame, skew left in": (as_read, ("raster", "lo_shu")),
    "element, by lines": (partial(along, degree=1), ("lo_shu",)),
    "element, by parabolas": (partial(along, degree=2), ("lo_shu",)),
}


def rows_of(scene: Scene, bench: Workbench, card: TrainedInputs) -> list[Row]:
    """Return every way to publish on one load."""
    foot = Foot(bench.response)
    until_ns = scene.truth.end_ns
    readings = {
        name: convert(foot, scene.truth.feet, order, 400, until_ns, _SEED) for name, order in ORDERS.items()
    }
    found = []
    for way, (publish, orders) in _WAYS.items():
        for order in orders:
            published = publish(readings[order], bench.network, card)
            settled = None
            if scene.begins_ns is not None:
                each_ms = settled_ms(published, scene.truth, scene.begins_ns)
                settled = (float(np.median(each_ms)), float(each_ms.max()))
            errors = judge(published, scene.truth)
            found.append(Row(way=way, order=order, errors=errors, settled_ms=settled))
    return found


def _points(bench: Workbench, tried: Tried, card: TrainedInputs) -> tuple[list[Point], list[Point]]:
    """Return rates, averaging and publish modes with the shipped network, and networks of other sizes."""
    grid = Bench(Foot(bench.response), measured_truth(tried.strides))
    shipped = bench.network.card["training"]["weights"]
    points = []
    for rate in tried.rates_sps:
        points += [grid.point(bench.network, card, rate, n, "frame", shipped) for n in tried.averaged]
        points.append(grid.point(bench.network, card, rate, 1, "element", shipped))
        bench.say(f"tradeoff: {rate} S/s")
    sizes = []
    for weights in learn_sizes(bench, tried.channels, tried.cases, tried.training_steps):
        network = as_runtime(weights)
        sizes += [grid.point(network, card, 400, 1, way, weights.size) for way in ("frame", "element")]
    return points, sizes


def page(bench: Workbench) -> Page:
    """Return the page."""
    card = read_card(json.dumps(bench.network.card), str(bench.models)).trained_inputs
    rows: dict[str, list[Row]] = {}
    tried = QUICK if bench.quick else FULL
    loads = scenes(tried.strides, tried.phases)
    for name, scene in loads.items():
        rows[name] = rows_of(scene, bench, card)
        bench.say(f"tradeoff: {name}")
    points, sizes = _points(bench, tried, card)
    values = {
        "step_ms": pace(400).step_ns * 1e-6,
        "lead_ms": pace(400).lead_ns * 1e-6,
        "loads": {name: [asdict(row) for row in found] for name, found in rows.items()},
        "points": [asdict(point) for point in points],
        "sizes": [asdict(point) for point in sizes],
    }
    return Page(
        name="tradeoff",
        title="Speed against error",
        body=body(tried, loads, rows, points, sizes),
        figures={FIGURE: grid_figure(points, sizes)},
        values=values,
    )
