"""Loads beyond the range of the paper's foot, scanned element after element: states, causes, and how long they last."""

from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from firmware_interface.chips import fdc1004
from firmware_interface.conversion_order import CONVERSION_ORDERS
from footsense.estimation.network import Network
from footsense.estimation.pipeline import pipeline_of
from footsense.estimation.settings import EstimationLimits, MountedFeet
from footsense.foot.parameters import KNOWN_EXACTLY, ForceUncertainty
from footsense.foot.response_table import FootResponse
from footsense.foot.specimen import Specimen
from footsense.foot.type_folders import foot_type_folder
from footsense.frames import IS_USABLE_STATE, CapFrame, Cause, Reading, State

Vector = NDArray[np.float64]

FOLDER = foot_type_folder("aoyagi-3x3")
STEP_S, SENT_AFTER_S = 2.7167e-3, 3.2345e-3
SCAN_S = 9 * STEP_S
TARED_S = 0.5
NOISE_PF = fdc1004.RATES[400].noise_ff * 1e-3
UP = np.array([0.0, 0.0, 1.0])
#: Directions around the leg of the legs' loads [deg]: one for each leg.
AROUND_DEG = np.array([0.0, 17.0, 45.0, 100.0, 170.0, 225.0, 260.0, 330.0])


class Published(NamedTuple):
    """What was published after each conversion, shape (n, legs, ...), and the elements over the range then."""

    t_s: Vector
    state: NDArray[np.uint8]
    cause: NDArray[np.uint8]
    force_n: Vector
    sigma_n: Vector
    n_over_range: NDArray[np.intp]


@cache
def foot() -> Specimen:
    return Specimen(FootResponse.load(FOLDER / "response.npz"))


def leaning(lean_deg: float) -> Vector:
    """Return the unit forces of the legs that lean so far off the leg, shape (legs, 3)."""
    lean, around = np.radians(lean_deg), np.radians(AROUND_DEG)
    return np.stack(
        [np.sin(lean) * np.cos(around), np.sin(lean) * np.sin(around), np.full(len(around), np.cos(lean))], 1
    )


def published(
    force_n_at: Callable[[Vector], Vector],
    until_s: float,
    damaged: int | None = None,
    unknown: ForceUncertainty = KNOWN_EXACTLY,
) -> Published:
    """Return what the service publishes of feet under forces with an upright normal.

    Args:
        force_n_at: Returns the forces at some times after the tare [s], shape (times, legs, 3).
        until_s: The end [s].
        damaged: Element whose gap is full of water from the time 0 on.
        unknown: What nobody knows of the feet.
    """
    n_legs = len(AROUND_DEG)
    t_s: Vector = np.asarray(STEP_S * np.arange(1.0, round((TARED_S + until_s) / STEP_S)), np.float64)
    force_n = force_n_at(t_s - TARED_S)
    pf = foot().capacitance_pf(np.tile(UP, (force_n.shape[0] * n_legs, 1)), force_n.reshape(-1, 3))
    pf = pf.reshape(len(t_s), n_legs, 9)
    if damaged is not None:
        pf[t_s > TARED_S, :, damaged] = 2.0 * fdc1004.RANGE_END_PF
    pf += NOISE_PF * np.random.default_rng(1).normal(size=pf.shape)
    network = Network(FOLDER / "network.onnx", n_legs)
    pipeline = pipeline_of(
        network,
        MountedFeet.of(network.card.trained_inputs.design, [None] * n_legs, uncertainty=[unknown] * n_legs),
        EstimationLimits(scan_ns=round(SCAN_S * 1e9), range_end_pf=fdc1004.RANGE_END_PF),
        FootResponse.load(FOLDER / "response.npz"),
    )
    read_pf, read_ns = np.full((n_legs, 9), np.nan), np.zeros((n_legs, 9), np.int64)
    reading = np.zeros((n_legs, 9), np.uint8)
    frames, n_over_range = [], []
    for n, now_s in enumerate(t_s.tolist()):
        element = CONVERSION_ORDERS["lo_shu"][n % 9]
        over = pf[n, :, element] >= fdc1004.RANGE_END_PF
        read_pf[:, element] = np.where(over, np.nan, pf[n, :, element])
        reading[:, element] = np.where(over, Reading.OVER_RANGE, Reading.OK)
        read_ns[:, element] = round(now_s * 1e9)
        scan = CapFrame(n, read_ns.copy(), read_pf.copy(), reading.copy())
        frames.append(pipeline.process(scan, round((now_s + SENT_AFTER_S) * 1e9))[0])
        n_over_range.append((reading == Reading.OVER_RANGE).sum(axis=1))
    fields = ("state", "cause", "force_n", "sigma_n")
    arrays = {name: np.array([getattr(frame, name) for frame in frames]) for name in fields}
    sent_s: Vector = np.asarray(t_s - TARED_S + SENT_AFTER_S, np.float64)
    return Published(t_s=sent_s, n_over_range=np.array(n_over_range), **arrays)


def trapezoid(t_s: Vector, rise_s: float, dwell_s: float, fall_s: float) -> Vector:
    """Return a load that rises from 0 at the time 0 to 1, stays, and falls, shape (times, 1, 1)."""
    share: Vector = np.interp(
        t_s, [0.0, rise_s, rise_s + dwell_s, rise_s + dwell_s + fall_s], [0.0, 1.0, 1.0, 0.0]
    )[:, None, None]
    return share


def is_healthy(found: Published) -> bool:
    """Return whether no leg is called faulty, after the tare: neither by its state, nor by its cause."""
    after = found.t_s > 0.0
    states = {State.VALID, State.DEGRADED, State.OUT_OF_RANGE, State.SATURATED}
    named = set(found.cause[after].ravel().tolist()) <= {Cause.NONE, Cause.OVERLOAD, Cause.NOISY}
    degraded_by = set(found.cause[after][found.state[after] == State.DEGRADED].tolist())
    return named and set(found.state[after].ravel().tolist()) <= states and degraded_by <= {Cause.OVERLOAD}


@pytest.mark.slow
@pytest.mark.parametrize("rise_s", [0.015, 0.1])
@pytest.mark.parametrize(("lean_deg", "least_known_rel"), [(24.0, 1.0), (31.0, 0.5)])
def test_a_push_that_leans_is_overload_and_over_within_a_scan(
    lean_deg: float, least_known_rel: float, rise_s: float
) -> None:
    """1 N on an upright normal closes two gaps: a force goes on, roughly, and no element is faulty."""
    force_n = leaning(lean_deg)
    found = published(lambda t_s: trapezoid(t_s, rise_s, 0.5, 0.05) * force_n, 1.2)
    assert is_healthy(found)
    holds = (found.t_s > rise_s + 2 * SCAN_S) & (found.t_s < rise_s + 0.5)
    overloaded = holds[:, None] & (found.n_over_range > 0)
    assert found.n_over_range.max() == 2
    assert (found.cause[overloaded] == Cause.OVERLOAD).all()
    known = IS_USABLE_STATE[found.state]
    assert known[overloaded].mean() >= least_known_rel
    errors_n = np.linalg.norm(found.force_n - force_n, axis=2)[overloaded & known]
    assert np.median(errors_n) < 0.5
    over = found.t_s > rise_s + 0.55 + SCAN_S + STEP_S
    assert (found.state[over] == State.VALID).all()
    assert np.abs(found.force_n[over]).max() < 0.15
    assert (np.abs(found.force_n[over]) < 4.0 * found.sigma_n[over]).all()


def test_an_element_that_is_closed_is_as_uncertain_as_its_gap() -> None:
    """Of a foot that is known exactly it adds nothing, and nothing to a leg without one."""
    force_n = leaning(24.0) * np.linspace(0.3, 1.0, len(AROUND_DEG))[:, None]
    exact, made = (
        published(lambda t_s: trapezoid(t_s, 0.1, 0.1, 0.1) * force_n, 0.2, unknown=unknown)
        for unknown in (KNOWN_EXACTLY, ForceUncertainty(0.0, 0.0, 0.1))
    )
    np.testing.assert_array_equal(made.force_n, exact.force_n)
    overloaded = (exact.cause == Cause.OVERLOAD) & IS_USABLE_STATE[exact.state]
    assert 20 < overloaded.sum() < 0.5 * overloaded.size
    grown_n2 = made.sigma_n**2 - exact.sigma_n**2
    assert (grown_n2[overloaded, :2] > 0.1**2).all()
    np.testing.assert_array_equal(grown_n2[IS_USABLE_STATE[exact.state] & (exact.cause == Cause.NONE)], 0.0)


@pytest.mark.parametrize("lean_deg", [0.0, 12.0, 30.0])
@pytest.mark.parametrize("start_s", STEP_S * np.arange(0.0, 9.0, 1.7))
def test_an_impact_is_no_fault(start_s: float, lean_deg: float) -> None:
    """1.5 N that rise within 5 ms and fall as fast, whichever elements are read meanwhile: gone with its readings."""
    force_n = 1.5 * leaning(lean_deg)
    found = published(lambda t_s: trapezoid(t_s - 0.1 - start_s, 0.005, 0.0, 0.005) * force_n, 0.35)
    assert is_healthy(found)
    assert (found.state[found.t_s > 0.1 + start_s + 0.01 + 3 * SCAN_S + STEP_S] == State.VALID).all()


@pytest.mark.slow
@pytest.mark.parametrize("turn_s", [0.003, 0.01, 0.03])
def test_a_fast_slide_is_no_fault(turn_s: float) -> None:
    """Friction that turns round under a load, from 0.5 of it forward to 0.5 of it backward."""
    there, back = leaning(26.6), leaning(-26.6)

    def force_n_at(t_s: Vector) -> Vector:
        turned = np.interp(t_s, [0.3, 0.3 + turn_s], [0.0, 1.0])[:, None, None]
        return 0.7 * trapezoid(t_s, 0.05, 0.6, 0.05) * ((1.0 - turned) * there + turned * back)

    assert is_healthy(published(force_n_at, 1.0))


@pytest.mark.slow
def test_far_beyond_the_range_the_force_comes_back_within_a_scan() -> None:
    """20 N on the foot for 1 N close more gaps than three: SATURATED, and a scan later VALID."""
    found = published(lambda t_s: 20.0 * trapezoid(t_s, 0.02, 0.2, 0.02) * leaning(5.0), 0.5)
    assert is_healthy(found)
    pressed = (found.t_s > 0.02 + SCAN_S) & (found.t_s < 0.2)
    assert (found.state[pressed] == State.SATURATED).all()
    assert (found.cause[pressed] == Cause.OVERLOAD).all()
    assert np.isnan(found.force_n[pressed]).all()
    assert (found.state[found.t_s > 0.24 + SCAN_S + STEP_S] == State.VALID).all()


@pytest.mark.parametrize("element", [0, 4, 5])
def test_a_gap_full_of_water_is_named_within_a_tenth_of_a_second(element: int) -> None:
    """Overload by its reading, then a shorted element, as the others predict far less: the force is theirs."""
    found = published(lambda t_s: 0.5 * trapezoid(t_s - 0.2, 0.1, 0.3, 0.1) * leaning(10.0), 0.7, element)
    suspected = (found.t_s > SCAN_S) & (found.t_s < 2 * SCAN_S)
    assert (found.cause[suspected] == Cause.OVERLOAD).all()
    assert not (found.state[suspected] == State.VALID).any()
    named = found.t_s > 3 * SCAN_S + STEP_S
    assert (found.cause[named] == Cause.ELEMENT_SHORTED).all()
    assert (found.state[named] == State.DEGRADED).all()
    error_n = np.abs(found.force_n - 0.5 * leaning(10.0))[(found.t_s > 0.35) & (found.t_s < 0.5)]
    assert np.median(error_n) < 0.05
