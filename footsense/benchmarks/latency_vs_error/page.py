"""Study `tradeoff`: latency against error, from the conversion to the force that a consumer has received."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from firmware_interface.conversion_order import CONVERSION_ORDERS
from firmware_interface.wire_timing import LONGEST_FRAME_BITS
from footsense.benchmarks.latency_vs_error.chain import (
    BUS_HZ,
    HOST_COST_NS,
    conversion_timing,
    simulate_conversions,
)
from footsense.benchmarks.latency_vs_error.grid import (
    CONVERSIONS_PER_PUBLISHED_FORCE,
    OperatingPointResult,
    measure_operating_points,
    operating_points_figure,
)
from footsense.benchmarks.latency_vs_error.latency_and_errors import (
    SIGMA_MULTIPLES,
    LatencyAndErrors,
    latency_and_errors,
    settling_ms,
)
from footsense.benchmarks.latency_vs_error.loads import TradeoffLoad, load_cases, measured_walk_truth
from footsense.benchmarks.latency_vs_error.publishing import estimate_forces
from footsense.foot.specimen import Foot
from footsense.lab.former_page import Plots, Study, StudyContext

#: Publishing methods that the text of the page compares.
EVERY, SKEWED = "every conversion", "newest readings as they are"
LINES, PARABOLAS = "extrapolated by lines", "extrapolated by parabolas"


class StudySize(NamedTuple):
    """Size of the study `tradeoff`: numbers of strides and scan phases, conversion rates.

    Attributes:
        strides: Strides of a walk that are counted.
        scan_phases: Phases of a scan at which a foot is pressed.
        rates_sps: Conversions per second.
    """

    strides: int
    scan_phases: int
    rates_sps: tuple[int, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class MethodResult:
    """Latency and errors of one publishing method under one load.

    Attributes:
        method: Name of the method.
        scan_order: Order of the scan.
        errors: Latency and errors.
        settling_median_max_ms: Time until the held force stays within a tenth of a step or ramp, median and worst [ms].
    """

    method: str
    scan_order: str
    errors: LatencyAndErrors
    settling_median_max_ms: tuple[float, float] | None


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadResult:
    """Latency and errors of all publishing methods under one load.

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
    """Results of the study `tradeoff`: age and error of the forces, by load case and by operating point.

    Attributes:
        conversion_period_ms: From one conversion to the next at 400 S/s [ms].
        send_delay_ms: From the middle of a conversion to the sending of its force [ms].
        size: Size of the study.
        loads: Results under each load.
        points: Rates of conversions and of publishing.
    """

    conversion_period_ms: float
    send_delay_ms: float
    size: StudySize
    loads: dict[str, LoadResult]
    points: list[OperatingPointResult]


FULL_SIZE = StudySize(strides=4, scan_phases=6, rates_sps=(400, 200, 100))
QUICK_SIZE = StudySize(strides=1, scan_phases=2, rates_sps=(400,))

_SEED = 3

#: Publishing methods by name: degree of the extrapolation, conversions for each force, and orders of the scan.
_METHODS: dict[str, tuple[int | None, int, tuple[str, ...]]] = {
    EVERY: (None, 1, ("raster", "lo_shu")),
    **{f"every {n}th": (None, n, ("lo_shu",)) for n in CONVERSIONS_PER_PUBLISHED_FORCE[1:]},
    SKEWED: (0, 1, ("raster", "lo_shu")),
    LINES: (1, 1, ("lo_shu",)),
    PARABOLAS: (2, 1, ("lo_shu",)),
}


def _load_result(load: TradeoffLoad, context: StudyContext) -> LoadResult:
    """Return latency and errors of every publishing method under one load case."""
    foot, truth = Foot(context.response), load.truth
    readings = {
        name: simulate_conversions(foot, truth.feet, order, 400, truth.evaluation_end_ns, _SEED)
        for name, order in CONVERSION_ORDERS.items()
    }
    methods = []
    for method, (degree, every, orders) in _METHODS.items():
        for order in orders:
            published = estimate_forces(
                readings[order], context.network, context.trained_inputs, degree
            ).every_nth(every)
            settling = None
            if load.load_starts_ns is not None:
                each_ms = settling_ms(published, truth, load.load_starts_ns)
                settling = (float(np.median(each_ms)), float(each_ms.max()))
            errors = latency_and_errors(published, truth)
            methods.append(
                MethodResult(method=method, scan_order=order, errors=errors, settling_median_max_ms=settling)
            )
    return LoadResult(title=load.title, n_feet=len(truth.feet), methods=methods)


def compute(context: StudyContext) -> tuple[TradeoffResults, Plots]:
    """Run the study `tradeoff`; return its results and figures."""
    size = QUICK_SIZE if context.quick else FULL_SIZE
    loads = {}
    for name, load in load_cases(size.strides, size.scan_phases).items():
        loads[name] = _load_result(load, context)
        context.report_progress(f"tradeoff: {name}")
    truth, points = measured_walk_truth(size.strides), []
    for rate_sps in size.rates_sps:
        points += measure_operating_points(rate_sps, truth, context)
        context.report_progress(f"tradeoff: {rate_sps} S/s")
    results = TradeoffResults(
        conversion_period_ms=conversion_timing(400).step_ns * 1e-6,
        send_delay_ms=conversion_timing(400).send_delay_ns * 1e-6,
        size=size,
        loads=loads,
        points=points,
    )
    return results, {"tradeoff.png": operating_points_figure(points)}


STUDY = Study(
    name="tradeoff",
    title="Latency against error",
    compute=compute,
    template_names={
        "BUS_HZ": BUS_HZ,
        "FRAME_BITS": LONGEST_FRAME_BITS,
        "HOST_COST_NS": HOST_COST_NS,
        "SIGMA_MULTIPLES": " / ".join(map(str, SIGMA_MULTIPLES)),
    },
)
