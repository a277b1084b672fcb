"""Study `tradeoff`: latency against error of the whole chain, from conversion to the force that a consumer holds."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np

from firmware_interface.wire_timing import LONGEST_FRAME_BITS
from footsense.acquisition.scan_plan import ORDERS
from footsense.benchmarks.latency_vs_error.chain import BUS_HZ, HOST_COST_NS, convert, pace
from footsense.benchmarks.latency_vs_error.grid import OperatingPoint, WalkAndStand, grid_figure
from footsense.benchmarks.latency_vs_error.latency_and_errors import (
    SIGMA_MULTIPLES,
    LatencyAndErrors,
    latency_and_errors,
    settling_ms,
)
from footsense.benchmarks.latency_vs_error.loads import LoadCase, load_cases, measured_truth
from footsense.benchmarks.latency_vs_error.publishing import (
    PublishedForces,
    by_element,
    by_frame,
    extrapolated,
    without_alignment,
)
from footsense.foot.files.network_card import TrainedInputs
from footsense.foot.specimen import Foot
from footsense.lab.studies.networks.network_size import train_sizes
from footsense.lab.studies.page import Figures, Study, StudyContext
from footsense.lab.training.export import OnnxNetwork, onnx_model
from footsense.lab.training.network import Weights


class Size(NamedTuple):
    """Size of the study `tradeoff`: numbers of strides, phases, rates, networks and training steps.

    Attributes:
        strides: Strides of a walk that are counted.
        phases: Phases of a scan at which a foot is pressed.
        rates_sps: Conversions per second.
        averaged: Numbers of scans that are averaged.
        channels: Channels of the networks that are trained.
        cases: Loads in their training.
        training_steps: Steps of their training.
    """

    strides: int
    phases: int
    rates_sps: tuple[int, ...]
    averaged: tuple[int, ...]
    channels: tuple[int, ...]
    cases: int
    training_steps: int


@dataclass(frozen=True, slots=True, kw_only=True)
class MethodResult:
    """Result of one publishing method under one load.

    Attributes:
        method: Name of the method.
        order: Order of the scan.
        errors: Latency and errors.
        settling_ms: Time until the held force stays within a tenth of a step or ramp, median and worst [ms].
    """

    method: str
    order: str
    errors: LatencyAndErrors
    settling_ms: tuple[float, float] | None


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadResult:
    """Results of all publishing methods under one load.

    Attributes:
        title: Heading of its table.
        n_feet: Feet under the load.
        methods: Results of the methods.
    """

    title: str
    n_feet: int
    methods: list[MethodResult]


@dataclass(frozen=True, slots=True, kw_only=True)
class TradeoffResults:
    """Results of the study `tradeoff`: age and error of the forces by load, operating point and network.

    Attributes:
        step_ms: From one conversion to the next at 400 S/s [ms].
        lead_ms: From the middle of a conversion to the sending of its force [ms].
        size: Size of the study.
        loads: Results under each load.
        points: Rates, averaging and publish modes with the shipped network.
        sizes: Networks of other sizes at 400 S/s.
    """

    step_ms: float
    lead_ms: float
    size: Size
    loads: dict[str, LoadResult]
    points: list[OperatingPoint]
    sizes: list[OperatingPoint]


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


def _load_result(load: LoadCase, context: StudyContext, card: TrainedInputs) -> LoadResult:
    """Return the results of every publishing method under one load."""
    foot, truth = Foot(context.response), load.truth
    readings = {
        name: convert(foot, truth.feet, order, 400, truth.end_ns, _SEED) for name, order in ORDERS.items()
    }
    methods = []
    for method, (publish, orders) in _METHODS.items():
        for order in orders:
            published = publish(readings[order], context.network, card)
            settling = None
            if load.starts_ns is not None:
                each_ms = settling_ms(published, truth, load.starts_ns)
                settling = (float(np.median(each_ms)), float(each_ms.max()))
            errors = latency_and_errors(published, truth)
            methods.append(MethodResult(method=method, order=order, errors=errors, settling_ms=settling))
    return LoadResult(title=load.title, n_feet=len(truth.feet), methods=methods)


def _points(
    context: StudyContext, size: Size, card: TrainedInputs
) -> tuple[list[OperatingPoint], list[OperatingPoint]]:
    """Return rates, averaging and publish modes with the shipped network, and networks of other sizes."""
    foot, truth = Foot(context.response), measured_truth(size.strides)
    weights = context.network.card["training"]["weights"]
    feet = {rate: WalkAndStand.at(rate, foot, truth) for rate in size.rates_sps}
    points = []
    for rate in size.rates_sps:
        for n_averaged, publish in (*((n, "frame") for n in size.averaged), (1, "element")):
            points.append(feet[rate].operating_point(context.network, card, n_averaged, publish, weights))
        context.say(f"tradeoff: {rate} S/s")
    sizes = [
        feet[400].operating_point(_onnx_network(trained), card, 1, publish, trained.size)
        for trained in train_sizes(context, size.channels, size.cases, size.training_steps)
        for publish in ("frame", "element")
    ]
    return points, sizes


def _onnx_network(weights: Weights) -> OnnxNetwork:
    """Export trained weights to ONNX, and return the network loaded in ONNX Runtime."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "network.onnx"
        path.write_bytes(onnx_model(weights, {}).SerializeToString())
        return OnnxNetwork(path)


def compute(context: StudyContext) -> tuple[TradeoffResults, Figures]:
    """Publish the forces of all loads in every way, at every operating point."""
    card = context.trained_inputs
    size = QUICK if context.quick else FULL
    loads = {}
    for name, load in load_cases(size.strides, size.phases).items():
        loads[name] = _load_result(load, context, card)
        context.say(f"tradeoff: {name}")
    points, sizes = _points(context, size, card)
    results = TradeoffResults(
        step_ms=pace(400).step_ns * 1e-6,
        lead_ms=pace(400).lead_ns * 1e-6,
        size=size,
        loads=loads,
        points=points,
        sizes=sizes,
    )
    return results, {"tradeoff.png": grid_figure(points, sizes)}


STUDY = Study(
    name="tradeoff",
    title="Latency against error",
    compute=compute,
    names={
        "BUS_HZ": BUS_HZ,
        "FRAME_BITS": LONGEST_FRAME_BITS,
        "HOST_COST_NS": HOST_COST_NS,
        "SIGMA_MULTIPLES": " / ".join(map(str, SIGMA_MULTIPLES)),
    },
)
