"""What column sums say of elements, and which legs may be read column by column."""

import numpy as np
import pytest
from numpy.typing import NDArray

from footsense.estimation.ganged import APART_PF, LONGEST_NS, SETTLED_NS, Ganged, unknown_rel
from footsense.frames import CapFrame, Reading
from tests.support.feet import ALIKE, DESIGN, SumOfClosures

STEP_NS = 2_700_000
ORDER = (5, 0, 7, 6, 4, 2, 1, 8, 3)
STRAY_PF = 0.5
CAPDAC_PF = np.array([0.2, 0.25, 0.3])
BASELINE_PF = np.full((1, 9), DESIGN.rest_pf)
ONE = np.ones(1, bool)
NONE = np.zeros(1, bool)


class Leg:
    """One leg whose elements are read one after the other, or its columns, as `ganged` says when a frame has been seen.

    Attributes:
        closure_um: How far its elements are closed [um], shape (9,).
    """

    def __init__(self) -> None:
        self.ganged = Ganged(1, ALIKE, DESIGN, 9 * STEP_NS, np.array([0.5, 0.2, 0.1]))
        self.closure_um = np.zeros(9)
        self.capdac_pf = CAPDAC_PF
        self.n = 0
        self.t_ns = np.zeros((1, 9), np.int64)
        self.pf = np.full((1, 9), np.nan)
        self.reading = np.zeros((1, 9), np.uint8)
        self.seen = self.read(9)

    def read(self, n: int = 1, *, aloft: bool = True, free: bool = True) -> CapFrame:
        for _ in range(n):
            self.n += 1
            element = ORDER[self.n % 9]
            elements_pf = DESIGN.capacitance_pf(self.closure_um) + STRAY_PF
            wanted = bool(self.ganged.wanted[0])
            column = element % 3
            column_pf = elements_pf[column::3].sum() + self.capdac_pf[column]
            self.pf[0, element] = column_pf if wanted else elements_pf[element]
            self.reading[0, element] = Reading.GANGED if wanted else Reading.OK
            self.t_ns[0, element] = self.n * STEP_NS
            scan = CapFrame(self.n, self.t_ns.copy(), self.pf.copy(), self.reading.copy())
            self.seen = self.ganged.stand_in(scan, BASELINE_PF, np.full((1, 9), STRAY_PF))
            self.ganged.decide(ONE & aloft, ONE, ONE & free, self.n * STEP_NS)
        return self.seen

    def until(self, *, wanted: bool, limit: int = 2000) -> int:
        """Read until the leg is to be ganged, or no longer; return how many conversions that took."""
        for n in range(limit):
            if bool(self.ganged.wanted[0]) is wanted:
                return n
            self.read()
        raise AssertionError(f"still {'not ' if wanted else ''}ganged after {limit} conversions")

    def taught(self) -> "Leg":
        """Return the leg when it is ganged for the second time, which confirms what the first time has learnt."""
        self.until(wanted=True)
        self.until(wanted=False)
        self.until(wanted=True)
        return self

    def closures_um(self) -> NDArray[np.float64]:
        closure_um: NDArray[np.float64] = DESIGN.closure_um(
            self.seen.capacitance_pf - STRAY_PF, np.array([DESIGN.rest_pf])
        )[0]
        return closure_um


def test_a_leg_is_ganged_when_it_has_been_in_the_air_for_a_while() -> None:
    """A tenth of a second in which the zero followed; and with nothing to learn from, for two seconds at most."""
    leg = Leg()
    assert leg.until(wanted=True) * STEP_NS == pytest.approx(SETTLED_NS, abs=12 * STEP_NS)
    leg.until(wanted=False)
    leg.until(wanted=True)
    assert leg.until(wanted=False) * STEP_NS == pytest.approx(LONGEST_NS, abs=2 * STEP_NS)


def test_the_first_time_teaches_the_offset_and_tells_nothing() -> None:
    """Three columns are read, the elements stay what and when they were, and the leg goes back."""
    leg = Leg()
    leg.until(wanted=True)
    before = leg.seen
    assert leg.until(wanted=False) <= 5
    np.testing.assert_array_equal(leg.seen.capacitance_pf, before.capacitance_pf)
    np.testing.assert_array_equal(leg.seen.t_ns, before.t_ns)
    assert (leg.seen.reading == Reading.OK).all()


def test_sums_are_closures_of_small_loads() -> None:
    """Pressed evenly by 0.2 um, all nine read that within a twentieth as soon as three columns are read."""
    leg = Leg().taught()
    leg.read(9)
    np.testing.assert_allclose(leg.closures_um(), 0.0, atol=1e-6)
    leg.closure_um = np.full(9, 0.2)
    leg.read(4)
    np.testing.assert_allclose(leg.closures_um(), 0.2, rtol=0.05)
    assert (leg.seen.reading == Reading.OK).all()


def test_the_first_conversion_after_a_touch_tells_of_it() -> None:
    """One newest column moves all nine: the elements of a foot go together."""
    leg = Leg().taught()
    leg.read(9)
    leg.closure_um = np.full(9, 0.2)
    leg.read()
    assert leg.closures_um().mean() > 0.12


def test_one_conversion_is_one_new_stamp() -> None:
    """What follows takes each conversion once, and nothing is older than what belongs together."""
    leg = Leg().taught()
    leg.read(20)
    for _ in range(20):
        before_ns = leg.seen.t_ns.copy()
        leg.read()
        assert (leg.seen.t_ns > before_ns).sum() == 1
        assert leg.seen.t_ns.max() - leg.seen.t_ns.min() <= 1.2 * 9 * STEP_NS


def test_back_on_elements_each_is_itself_as_soon_as_it_is_read() -> None:
    """A stand-in stays until then, with the stamp of the last sum."""
    leg = Leg().taught()
    leg.read(9)
    leg.closure_um = np.linspace(0.1, 0.9, 9)
    leg.read(free=False)
    last_ns = leg.seen.t_ns.max()
    for n in range(1, 9):
        leg.read(aloft=False, free=False)
        read = leg.seen.t_ns[0] > last_ns
        assert read.sum() == n
        np.testing.assert_allclose(leg.closures_um()[read], leg.closure_um[read], rtol=1e-9)
        assert (leg.seen.t_ns[0, ~read] == last_ns).all()
    leg.read(aloft=False, free=False)
    assert not leg.ganged.standing_in.any()


def test_contact_or_hovering_takes_the_leg_back() -> None:
    """At once when it is no longer free; after some conversions when it only hovers."""
    leg = Leg().taught()
    leg.read(aloft=False)
    assert leg.ganged.wanted.all()
    leg.read(12, aloft=False)
    assert not leg.ganged.wanted.any()
    leg = Leg().taught()
    leg.read(free=False)
    assert not leg.ganged.wanted.any()


def test_an_offset_that_was_learnt_on_the_ground_is_never_believed() -> None:
    """The elements have seen the foot on the ground after the lesson: it has to be given again."""
    leg = Leg()
    leg.until(wanted=True)
    leg.until(wanted=False)
    leg.read(3, aloft=False, free=False)
    leg.until(wanted=True)
    assert leg.until(wanted=False) <= 5


def test_an_offset_that_has_jumped_takes_the_leg_back() -> None:
    """Little by little it is followed; farther at once is another lesson."""
    leg = Leg().taught()
    leg.capdac_pf = CAPDAC_PF + 0.8 * APART_PF
    leg.until(wanted=False)
    leg.until(wanted=True)
    leg.read(9)
    np.testing.assert_allclose(leg.closures_um(), 0.0, atol=1e-6)
    leg.until(wanted=False)
    leg.capdac_pf = CAPDAC_PF + 3 * APART_PF
    leg.until(wanted=True)
    assert leg.until(wanted=False) <= 5


def test_sigma_has_what_three_sums_leave_open_and_only_while_they_stand_in() -> None:
    """Relative to the force."""
    leg = Leg().taught()
    force_n, sigma_n = np.array([[0.0, 0.0, 2.0]]), np.array([[0.0, 0.0, 0.3]])
    np.testing.assert_array_equal(leg.ganged.widen(sigma_n, force_n), sigma_n)
    leg.read()
    np.testing.assert_allclose(leg.ganged.widen(sigma_n, force_n), [[1.0, 0.4, np.hypot(0.3, 0.2)]])


class RowsApart(SumOfClosures):
    """An estimator whose every force is what the foremost row has over the rearmost one."""

    def estimate(
        self, closure_rel: NDArray[np.float64], missing: NDArray[np.bool_]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        apart = closure_rel[:, :3].sum(axis=1) - closure_rel[:, 6:].sum(axis=1)
        return np.repeat(apart[:, None], 3, axis=1), np.ones((len(closure_rel), 3))


def test_sums_of_columns_tell_a_sum_and_nothing_of_rows() -> None:
    """What is left open of one is nothing, of the other all: three equal components of one force."""
    np.testing.assert_allclose(unknown_rel(SumOfClosures(), 2, np.eye(9)), 0.0, atol=1e-6)
    np.testing.assert_allclose(unknown_rel(RowsApart(), 2, np.eye(9)), 3**-0.5)
