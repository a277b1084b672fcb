"""Extreme inputs of the network and of the service's pipeline, for the study `hard-cases`."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import onnx
from onnx import TensorProto, numpy_helper
from onnx.reference import ReferenceEvaluator

from footsense.estimation.network import sensitivity, steady_windows
from footsense.estimation.pipeline import Pipeline
from footsense.estimation.settings import EstimationLimits, MountedFeet, TareLimits
from footsense.foot.files.network_card import INPUTS
from footsense.foot.specimen import Foot
from footsense.frames import ELEMENTS, CapFrame, ContactFrame, Reading, State, Vector
from footsense.lab.evaluation.evaluate_models import NETWORK_FILE
from footsense.lab.former_page import StudyContext
from footsense.lab.training.gait_readings import random_gaits
from footsense.lab.training.gait_windows import windows_of
from footsense.lab.training.load_cases import paper_verification
from footsense.ports import Window

_SCAN_NS, _MAX_AGE_NS, _WINDOW = 25_000_000, 100_000_000, 4
#: Scans after a line breaks until its leg has a force again: two readings in a row make a window.
_SETTLING_SCANS = 3
#: float32 against float64: a twentieth of a bit on CAN at rest, a half in motion [N].
_SINGLE_N, _SINGLE_WALKED_N = 5e-5, 5e-4
#: Random gaits of which a million conversions are tried in both: seed, rounds, gaits of a round, conversions of each.
_SEED, _ROUNDS, _GAITS, _CONVERSIONS = 990_100, 14, 70, 1100


@dataclass(frozen=True, slots=True)
class Case:
    """One extreme input with expected result, measured result, and whether they agree.

    Attributes:
        name: The input.
        expected: The expected result.
        measured: The measured result.
        passed: Whether it is as expected.
    """

    name: str
    expected: str
    measured: str
    passed: bool


def _float64_graph(context: StudyContext) -> ReferenceEvaluator:
    """Return the network's ONNX graph as a float64 numpy evaluator."""
    model = onnx.load(context.models / NETWORK_FILE)
    for stored in model.graph.initializer:
        if stored.data_type == TensorProto.FLOAT:
            stored.CopyFrom(numpy_helper.from_array(numpy_helper.to_array(stored).astype(float), stored.name))
    return ReferenceEvaluator(model)


def _float32_error_n(context: StudyContext, graph: ReferenceEvaluator, window: Window) -> float:
    """Return the largest force difference between float32 and float64 [N]; NaN if a force is no number."""
    inputs = {
        signal.name: np.asarray(part, np.float64).reshape(len(part), signal.width)
        for signal, part in zip(INPUTS, window, strict=True)
    }
    return float(np.abs(context.network.estimate(window).force_n - graph.run(["force_n"], inputs)[0]).max())


def _float32_error_on_gaits_n(context: StudyContext, graph: ReferenceEvaluator) -> tuple[int, float]:
    """Return the number of random gait windows, and the largest float32 force error over them [N]."""
    n, apart_n = 0, 0.0
    for seed in range(1 if context.quick else _ROUNDS):
        gaits = random_gaits(
            context.response,
            _SEED + seed,
            4 if context.quick else _GAITS,
            _CONVERSIONS,
            context.foot_design.loads.max_n,
        )
        windows = windows_of(gaits)
        nothing = np.zeros((len(windows.gait), ELEMENTS), bool)
        window = Window(windows.closure_rel, windows.age_s, nothing)
        n, apart_n = n + len(nothing), np.maximum(apart_n, _float32_error_n(context, graph, window))
    return n, float(apart_n)


def network_cases(context: StudyContext) -> Iterator[Case]:
    """Yield the cases of extreme inputs to the network alone."""
    network, gap_um = context.network, context.response.design.gap_um
    none_n = float(np.abs(network.force_n(np.zeros((1, 9)))).max())
    yield Case("no closure", "0 N, exactly", f"{none_n:g} N", none_n == 0.0)
    tiny = np.full((1, 9), 1e-40)
    tiny_n = float(np.abs(network.force_n(tiny)).max())
    yield Case("closures of 1e-40, subnormal in float32", "below 1 uN", f"{tiny_n:.1e} N", tiny_n < 1e-6)
    broken = np.zeros((1, 9))
    broken[0, 4] = np.nan
    force_n = network.force_n(broken)
    yield Case("one NaN", "no number", str(force_n[0].tolist()), bool(np.isnan(force_n).any()))
    cases = paper_verification(context.response)
    closure_rel = cases.closure_um / gap_um
    graph = _float64_graph(context)
    rested_n = _float32_error_n(context, graph, steady_windows(closure_rel))
    walked, walked_n = _float32_error_on_gaits_n(context, graph)
    for what, apart_n, limit_n in (
        ("180 cases at rest", rested_n, _SINGLE_N),
        (f"{walked} conversions of random gaits", walked_n, _SINGLE_WALKED_N),
    ):
        yield Case(
            f"float32 against float64, {what}",
            f"below {1e3 * limit_n:g} mN",
            f"{1e3 * apart_n:.1e} mN",
            apart_n < limit_n,
        )
    far_n = network.force_n(np.full((1, 9), 10.0))
    yield Case(
        "closures ten gaps wide",
        "a finite number",
        f"{np.linalg.norm(far_n):.0f} N",
        bool(np.isfinite(far_n).all()),
    )


class _LegPipeline:
    """Estimation pipeline of one leg with the released network, tared on an unloaded foot."""

    def __init__(self, context: StudyContext) -> None:
        design = context.response.design
        calibration = context.trained_inputs
        self._pipeline = Pipeline(
            context.network,
            calibration,
            MountedFeet.as_designed(design, 1),
            EstimationLimits(
                tare=TareLimits(window_scans=_WINDOW, noise_limit_ff=5.0, unloaded_limit_rel=0.03),
                least_contact_n=0.03,
                scan_ns=_SCAN_NS,
                max_age_ns=_MAX_AGE_NS,
            ),
            sensitivity(context.network, 1, calibration.moments),
        )
        self._sequence = 0
        for _ in range(_WINDOW):
            self.feed(np.full(9, design.unloaded_pf))

    def feed(self, capacitance_pf: Vector, reading: int = Reading.OK, age_ns: int = 0) -> ContactFrame:
        """Return the estimate after one scan; a reading other than OK applies to the middle element."""
        self._sequence += 1
        t_ns = self._sequence * _SCAN_NS
        readings, values = np.zeros((1, 9), np.uint8), capacitance_pf[None].copy()
        readings[0, 4] = reading
        values[readings != Reading.OK] = np.nan
        scan = CapFrame(self._sequence, np.full((1, 9), t_ns), values, readings)
        return self._pipeline.process(scan, t_ns + age_ns)[0]


def _leg_state_case(
    name: str,
    state: State,
    context: StudyContext,
    capacitance_pf: Vector,
    reading: int = Reading.OK,
    age_ns: int = 0,
) -> Case:
    """Return the case of constant capacitances [pF]: leg state after settling, against the expected one."""
    leg = _LegPipeline(context)
    for _ in range(_SETTLING_SCANS):
        leg.feed(capacitance_pf, reading)
    frame = leg.feed(capacitance_pf, reading, age_ns)
    found = State(int(frame.state[0]))
    force_n, sigma_n = float(frame.force_n[0, 2]), float(frame.sigma_n[0, 2])
    has_value = state in {State.VALID, State.DEGRADED}
    said = f"fz = {force_n:.3f} N, sigma {1e3 * sigma_n:.1f} mN" if np.isfinite(force_n) else "no force"
    passed = found is state and bool(np.isfinite(force_n)) is has_value
    return Case(name, state.name, f"{found.name}, {said}", passed)


def pipeline_cases(context: StudyContext) -> Iterator[Case]:
    """Yield the cases of broken lines and of loads beyond the training range, with leg state and force."""
    design = context.response.design
    up = np.array([[0.0, 0.0, 1.0]])
    pressed_pf = Foot(context.response).capacitance_pf(up, up)[0]
    open_pf = 0.05 * pressed_pf
    middle_pf, row_pf, two_pf = (
        np.where(np.isin(np.arange(9), elements), open_pf, pressed_pf)
        for elements in ([4], [3, 4, 5], [0, 4])
    )
    # A row without its line floats: every column sees it beside the row that is selected.
    row_pf += np.where(np.arange(9) // 3 == 1, 0.0, np.tile(open_pf[3:6], 3))
    shut_um, pulled_um = np.full(9, 0.97 * design.gap_um), np.full(9, -0.3 * design.gap_um)
    one_shut_um = np.where(np.arange(9) == 0, shut_um, 2.0)
    yield _leg_state_case("1 N upright", State.VALID, context, pressed_pf)
    yield _leg_state_case("one element open", State.DEGRADED, context, middle_pf)
    yield _leg_state_case("one row gone", State.DEGRADED, context, row_pf)
    yield _leg_state_case("open on two lines", State.ELEMENT_FAULT, context, two_pf)
    shorted = "one element shorted, beyond the converter"
    yield _leg_state_case(shorted, State.SATURATED, context, pressed_pf, Reading.OVER_RANGE)
    # No load closes one corner alone: something is in its gap, and the force comes from the others.
    one_shut_pf, shut_pf, pulled_pf = map(design.capacitance_pf, (one_shut_um, shut_um, pulled_um))
    yield _leg_state_case("one gap closed to 97 %", State.DEGRADED, context, one_shut_pf)
    yield _leg_state_case("all gaps closed to 97 %", State.SATURATED, context, shut_pf)
    yield _leg_state_case("pulled off by 30 % of the gap", State.OUT_OF_RANGE, context, pulled_pf)
    yield _leg_state_case("no answer", State.ABSENT, context, pressed_pf, Reading.NO_ANSWER)
    yield _leg_state_case("older than the limit", State.STALE, context, pressed_pf, age_ns=_MAX_AGE_NS + 1)
