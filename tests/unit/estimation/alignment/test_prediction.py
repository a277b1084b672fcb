"""The filter that predicts nine elements from one reading at a time, against a textbook filter and known motions."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from footsense.acquisition.scan_plan import ORDERS
from footsense.estimation.alignment.element_by_element import ElementByElement
from footsense.estimation.alignment.prediction import _DECAY_S, _DENSITY, _OWN_REL, Prediction
from footsense.estimation.alignment.scan_by_scan import AlignedSample
from footsense.estimation.faults.missing_sets import MISSING_SETS, missing_set_index
from tests.support.feet import SIGMA_N, SumOfClosures

Vector = NDArray[np.float64]

ORDER = ORDERS["lo_shu"]
STEP_NS = 2_700_000
STEP_S = STEP_NS * 1e-9
LEAD_S = 1.2 * STEP_S
NOISE = 1e-4
#: Loads that go together, but not quite: a common press and a tilt each way.
_X, _Y = (np.arange(9) // 3 - 1.0), (np.arange(9) % 3 - 1.0)
MOMENTS = np.ones((9, 9)) + 0.2 * np.outer(_X, _X) + 0.2 * np.outer(_Y, _Y) + 1e-3 * np.eye(9)


def prediction() -> Prediction:
    return Prediction(1, MOMENTS, ORDER, STEP_S, LEAD_S, NOISE)


def run(motion: Vector) -> Vector:
    """Return the positions that the filter tells after each reading of a motion, shape (steps, 9), as it goes on."""
    filter_ = prediction()
    filter_.begin(0, motion[0], 0)
    predicted = []
    for n, truth in enumerate(motion[1:], 1):
        element = np.array([ORDER[n % 9]])
        filter_.observe(np.array([0]), element, truth[element], np.array([n * STEP_NS]), np.zeros(1, np.intp))
        predicted.append(filter_.at(n * STEP_NS)[0])
    return np.array(predicted)


def textbook(motion: Vector) -> Vector:
    """Return the same by a textbook Kalman filter, whose covariance is carried along with the readings."""
    wandering = MOMENTS / np.trace(MOMENTS) + _OWN_REL * np.eye(9)
    kept = np.exp(-STEP_S / _DECAY_S)
    step = np.eye(18)
    step[:9, 9:] = _DECAY_S * (1 - kept) * np.eye(9)
    step[9:, 9:] = kept * np.eye(9)
    noise = _DENSITY * np.kron(np.array([[STEP_S**3 / 3, STEP_S**2 / 2], [STEP_S**2 / 2, STEP_S]]), wandering)
    state = np.concatenate((motion[0], np.zeros(9)))
    covariance = np.kron(np.diag([1.0, 1.0 / STEP_S]), wandering)
    predicted = []
    for n, truth in enumerate(motion[1:], 1):
        element = ORDER[n % 9]
        state, covariance = step @ state, step @ covariance @ step.T + noise
        looks = np.eye(18)[[element]]
        gain = covariance @ looks.T @ np.linalg.inv(looks @ covariance @ looks.T + NOISE**2)
        state = state + gain @ (truth[[element]] - looks @ state)
        # Joseph's form, which stays symmetric and positive whatever is rounded.
        rest = np.eye(18) - gain @ looks
        covariance = rest @ covariance @ rest.T + gain @ gain.T * NOISE**2
        predicted.append(state[:9])
    return np.array(predicted)


def test_it_is_the_textbook_filter_once_that_has_settled() -> None:
    """The fixed gains are those to which a filter with a covariance of its own comes by itself."""
    t_s = np.arange(500) * STEP_S
    motion = np.outer(np.sin(8 * t_s), 1 + 0.2 * _X) + np.outer(0.1 * np.cos(5 * t_s), _Y)
    np.testing.assert_allclose(run(motion)[300:], textbook(motion)[300:], atol=2e-6)


def test_a_constant_load_is_predicted_exactly() -> None:
    """No motion, no error: whatever the distances are."""
    still = np.tile(np.linspace(0.1, 1.4, 9), (60, 1))
    np.testing.assert_allclose(run(still), still[1:], atol=1e-12)


def test_a_load_that_grows_is_followed_by_all_elements() -> None:
    """Readings up to a scan old are a scan's growth behind; their prediction is not, once it has seen the growth."""
    growth: Vector = np.outer(np.maximum(np.arange(90.0) - 30, 0) * 0.01, 1 + 0.2 * _X)
    predicted = run(growth)
    behind = (
        np.array([[growth[n - (n - ORDER.index(e)) % 9, e] for e in range(9)] for n in range(1, 90)])
        - growth[1:]
    )
    error = predicted - growth[1:]
    assert np.abs(error[40:]).max() < 0.1 * np.abs(behind[40:]).max()
    # In the very scan in which it begins, no filter can know; but no worse than without.
    assert np.square(error).sum() < 0.3 * np.square(behind).sum()


@given(st.integers(1, 15))
@settings(deadline=None)
def test_a_missing_element_moves_nothing(number: int) -> None:
    """Whatever is read of what is missing, the other elements stay where they were."""
    filter_ = prediction()
    filter_.begin(0, np.zeros(9), 0)
    for n, element in enumerate(np.flatnonzero(MISSING_SETS[number]), 1):
        filter_.observe(
            np.array([0]), np.array([element]), np.array([5.0]), np.array([n * STEP_NS]), np.array([number])
        )
    at = filter_.at(10 * STEP_NS)[0]
    assert (at[~MISSING_SETS[number]] == 0.0).all()


class Leg:
    """One leg read element by element."""

    def __init__(self) -> None:
        self.alignment = ElementByElement(SumOfClosures(), 1, MOMENTS, ORDER, STEP_NS, NOISE)
        self.t_ns = np.zeros((1, 9), np.int64)
        self.values = np.full((1, 9), 1.3)
        self.n = 0

    def read(self, value: float = 1.3, missing: NDArray[np.bool_] | None = None) -> bool:
        """Read the next element; return whether the leg is together."""
        return bool(self._align(value, np.zeros(9, bool) if missing is None else missing).time_aligned[0])

    def predict(self, value: float, missing: NDArray[np.bool_]) -> Vector:
        """Read the next element; return what all are predicted to be, shape (9,)."""
        predicted: Vector = self._align(value, missing).distance_rel[0]
        return predicted

    def _align(self, value: float, missing: NDArray[np.bool_]) -> AlignedSample:
        element = ORDER[self.n % 9]
        self.n += 1
        self.t_ns[0, element], self.values[0, element] = self.n * STEP_NS, value
        return self.alignment.align(self.values.copy(), self.t_ns.copy(), self.n * STEP_NS, missing[None])

    def sigma_n(self) -> Vector:
        closed, none = np.zeros((1, 9)), np.zeros((1, 9), bool)
        sigma_n: Vector = self.alignment.estimate(closed, closed, np.ones(1, bool), none)[1][0]
        return sigma_n


def test_a_leg_is_together_with_nine_readings_and_not_before() -> None:
    """Also after a reading that failed: what was read before it is not mixed with what comes after."""
    leg = Leg()
    assert [leg.read() for _ in range(10)] == [False] * 8 + [True] * 2
    assert not leg.read(np.nan)
    assert [leg.read() for _ in range(9)] == [False] * 8 + [True]


@pytest.mark.parametrize("number", [1, 5, 10, 15])
def test_a_leg_is_together_without_what_is_missing(number: int) -> None:
    """A missing element may read nothing, or anything."""
    leg, missing = Leg(), MISSING_SETS[number]
    together = [leg.read(np.nan if missing[ORDER[n % 9]] else 1.3, missing) for n in range(18)]
    assert all(together[9:])
    assert missing_set_index(missing[None])[0] == number


@pytest.mark.parametrize("number", [0, 1, 5, 10, 15])
def test_a_load_that_grows_is_followed_without_what_is_missing(number: int) -> None:
    """The filter goes on from scan to scan, whatever a leg lacks: no element is a scan's growth behind."""
    leg, missing = Leg(), MISSING_SETS[number]
    for n in range(90):
        truth = 1.3 - 0.002 * n
        predicted = leg.predict(truth, missing)
    assert np.abs(predicted[~missing] - truth).max() < 0.1 * 9 * 0.002


def test_sigma_rises_with_motion_and_falls_with_rest() -> None:
    """At rest it is the network's own and the noise; a jump raises it at once, a scan or two later it is down."""
    leg = Leg()
    for _ in range(90):
        leg.read()
    at_rest_n = leg.sigma_n()
    np.testing.assert_allclose(at_rest_n, SIGMA_N, rtol=0.05)
    leg.read(1.2)
    unread_n = 8 * 0.1  # what the elements that are still to be read make of the jump
    assert (leg.sigma_n() > 0.9 * unread_n).all()
    assert (leg.sigma_n() < 1.5 * unread_n).all()
    for _ in range(200):
        leg.read(1.2)
    np.testing.assert_allclose(leg.sigma_n(), at_rest_n, rtol=0.05)
