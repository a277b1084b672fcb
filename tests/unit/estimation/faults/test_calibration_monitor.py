"""A foot that ages is detected while the robot walks; nothing else raises the alarm."""

import math

import numpy as np
import pytest

from footsense.estimation.faults.calibration_monitor import (
    ELEMENTS_LIMIT,
    ELEMENTS_SLACK,
    LOAD_LIMIT,
    LOAD_SLACK,
    REFERENCE_STRIDES,
    SAMPLING_PERIOD_NS,
    SUM_LIMIT,
    SUM_SLACK,
    CalibrationMonitor,
    calibration_change_rel,
)
from footsense.frames import Vector

PERIOD_NS = 800_000_000
SAMPLES = PERIOD_NS // SAMPLING_PERIOD_NS
TRIPOD = np.array([0, 1, 0, 1, 0, 1])
USUAL_N = np.array([0.5, 0.4, 0.5, 0.45, 0.55, 0.5])


class Walking:
    """Six legs in a tripod gait, stride by stride, without chips."""

    def __init__(self, body_weight_n: float | None = None) -> None:
        self.monitor = CalibrationMonitor(6, body_weight_n)
        self._t_ns = 1_000_000_000

    def stride(
        self,
        reads_rel: Vector | float = 1.0,
        residual_rel: Vector | float = 0.06,
        stays: bool | None = None,  # noqa: FBT001
    ) -> list[int]:
        """Walk one stride with forces scaled from the first ones; return the legs with an alarm.

        A stride is tested at the touchdown after it: the result is that of the strides before.

        Args:
            reads_rel: Forces over the first ones [1].
            residual_rel: Residuals over the closures [1].
            stays: Whether the last leg is in contact for the whole stride; None: it steps as the others do.
        """
        forces_n = np.broadcast_to(USUAL_N * reads_rel, 6)
        residual2 = np.broadcast_to(np.square(residual_rel), 6)
        for sample in range(SAMPLES):
            phase = (sample / SAMPLES + TRIPOD / 2) % 1.0
            down = phase < 0.6
            load_n = np.where(down, forces_n / 0.6, 0.0)
            squares = np.where(down, (residual2, np.ones(6)), 0.0).T
            down[-1] = down[-1] if stays is None else stays
            self.monitor.observe(load_n, down, squares, self._t_ns)
            self._t_ns += SAMPLING_PERIOD_NS
        return np.flatnonzero(self.monitor.stale).tolist()

    def learn(self) -> None:
        """Walk until it is known what is usual; the first touchdown is no stride yet."""
        for _ in range(REFERENCE_STRIDES + 1):
            assert self.stride() == []

    def until_found(self, reads_rel: Vector | float = 1.0, residual_rel: Vector | float = 0.06) -> int:
        """Return the strides until an alarm."""
        for n in range(1, 40):
            if self.stride(reads_rel, residual_rel):
                return n
        pytest.fail("nothing was found in 40 strides")


def one_leg(leg: int, value: float, others: float = 1.0) -> Vector:
    values = np.full(6, others)
    values[leg] = value
    return values


@pytest.mark.parametrize("reads_rel", [1.15, 0.85])
def test_a_foot_whose_stiffness_has_changed_is_named(reads_rel: float) -> None:
    """15 % more or less than before are found in the 10 strides of the table, and on that leg alone."""
    walking = Walking()
    walking.learn()
    assert walking.until_found(one_leg(4, reads_rel)) <= 10 + 1
    assert walking.stride(one_leg(4, reads_rel)) == [4]
    n_back = next(n for n in range(1, 40) if not walking.stride())
    assert n_back == math.ceil(LOAD_LIMIT / LOAD_SLACK) + 1


def test_two_feet_of_six_are_both_named() -> None:
    """Two that became softer leave a majority to compare with."""
    walking = Walking()
    walking.learn()
    both = one_leg(1, 1.15) * one_leg(5, 1.15)
    walking.until_found(both)
    assert walking.stride(both) == [1, 5]


def test_elements_that_contradict_each_other_more_are_found() -> None:
    """The forces may add up as before: sigma no longer covers their errors."""
    walking = Walking()
    walking.learn()
    apart = one_leg(2, 0.12, others=0.06)
    assert walking.until_found(residual_rel=apart) <= 8 + 1
    assert walking.stride(residual_rel=apart) == [2]


def limp(leg: int, share: float) -> Vector:
    """A leg that carries less, which the two others of its tripod carry instead."""
    moved_n = USUAL_N.copy()
    mates = np.flatnonzero((TRIPOD[leg] == TRIPOD) & (np.arange(6) != leg))
    moved_n[mates] += (1 - share) * USUAL_N[leg] / 2
    moved_n[leg] *= share
    share_rel: Vector = moved_n / USUAL_N
    return share_rel


@pytest.mark.parametrize(
    "reads_rel",
    [
        pytest.param(1 / (1 + 20 * 4.4e-3), id="20 K warmer"),
        pytest.param(1 / (1 - 20 * 4.4e-3), id="20 K colder"),
        pytest.param(1.1, id="a payload of a tenth"),
        pytest.param(limp(1, 0.6), id="a limp"),
        pytest.param(np.array([0.7, 1.0, 1.3] * 2), id="downhill"),
    ],
)
def test_what_is_no_ageing_is_not_taken_for_it(reads_rel: Vector | float) -> None:
    """A load that only moved, and what changes all legs alike up to the slack, is none, however long."""
    walking = Walking()
    walking.learn()
    assert all(walking.stride(reads_rel) == [] for _ in range(100))


def test_a_sum_that_is_not_the_body_s_weight_concerns_all_legs() -> None:
    """Known from the first strides on if the weight is; which foot is wrong it cannot tell."""
    walking = Walking(body_weight_n=USUAL_N.sum() / 1.201)
    assert walking.stride() == walking.stride() == []
    assert walking.until_found() <= 10
    assert walking.stride() == list(range(6))
    assert all(Walking(body_weight_n=USUAL_N.sum() / 1.1).stride() == [] for _ in range(3))


def test_strides_without_every_force_are_not_judged() -> None:
    """With a leg that gives no force the sum is not known, and a stand is no stride."""
    walking = Walking()
    walking.learn()
    wrong = one_leg(0, 1.5)
    wrong[3] = math.nan
    assert all(walking.stride(wrong) == [] for _ in range(30))


@pytest.mark.parametrize("stays", [True, False])
def test_a_leg_that_never_lifts_or_never_touches_does_not_walk(stays: bool) -> None:  # noqa: FBT001
    """Half more than the weight is an alarm of a walk, and of no stride in which one leg stands or hangs."""
    walking = Walking(body_weight_n=USUAL_N.sum() / 1.5)
    assert all(walking.stride(stays=stays) == [] for _ in range(20))
    assert walking.until_found() <= 5


def test_a_test_stand_is_no_walk() -> None:
    """One foot on a test stand has no other feet to be compared with, and costs no time."""
    assert CalibrationMonitor(1).due_ns > 10**18


def test_walks_that_scatter_by_a_tenth_raise_no_false_alarm() -> None:
    """Five thousand strides, each load drawn anew: the table promises one alarm of a leg in thirty million."""
    rng = np.random.default_rng(5)
    usual_n = USUAL_N * (1 + 0.1 * rng.standard_normal((REFERENCE_STRIDES, 6))).mean(axis=0)
    sums = np.zeros((2, 6))
    worst = 0.0
    for load_n in USUAL_N * (1 + 0.1 * rng.standard_normal((5_000, 6))):
        change = calibration_change_rel(load_n, usual_n)
        sums = np.maximum(sums + np.stack([change, -change]) - LOAD_SLACK, 0.0)
        worst = max(worst, float(sums.max()))
    assert worst < 0.75 * LOAD_LIMIT


@pytest.mark.parametrize(
    ("slack", "limit", "scatter", "strides"),
    [
        (LOAD_SLACK, LOAD_LIMIT, 0.06, 3e7),
        (SUM_SLACK, SUM_LIMIT, 0.1, 4e7),
        (ELEMENTS_SLACK, ELEMENTS_LIMIT, 0.3, 1e7),
    ],
)
def test_the_rates_of_the_table_follow_from_slack_and_limit(
    slack: float, limit: float, scatter: float, strides: float
) -> None:
    """Siegmund's formula, with the slack less by what was learnt wrongly."""
    d, b = (slack - scatter / 5) / scatter, limit / scatter + 1.166
    between = (math.exp(2 * d * b) - 1 - 2 * d * b) / (2 * d * d)
    assert strides <= between < 2 * strides
