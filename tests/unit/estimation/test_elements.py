"""Residual test: the faulty element is isolated, excluded, and readmitted."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from footsense.estimation.elements import (
    ENOUGH_EVIDENCE,
    SLOW_SHARE,
    UNCERTAIN_RESIDUAL,
    ConsistencyResult,
    ConsistencyTest,
)
from footsense.estimation.missing_elements import MISSING_SETS, Imputation
from footsense.estimation.network import ReadingWindow
from footsense.estimation.settings import RESIDUAL_LIMIT, SMALL_SHARE

SCAN_NS = 25_000_000
#: Scans that contradict until an element is excluded.
SCANS = round(ENOUGH_EVIDENCE)
#: Scans that agree until an element is trusted again, loaded and unloaded each.
AGREEING_SCANS = round(ENOUGH_EVIDENCE / SMALL_SHARE)

#: A foot that only knows how to be pressed and how to be tilted, to within a hundredth.
PATTERNS = np.array([np.ones(9), np.repeat([1.0, 0.0, -1.0], 3), np.tile([1.0, 0.0, -1.0], 3)]) * np.array(
    [[0.3], [0.1], [0.1]]
)
MOMENTS = PATTERNS.T @ PATTERNS + 1e-4 * np.eye(9)

loads = st.tuples(st.floats(0.2, 2.0), st.floats(-1.0, 1.0), st.floats(-1.0, 1.0))


class Leg:
    """One leg, tested scan by scan."""

    def __init__(self) -> None:
        self.consistency = ConsistencyTest(1, Imputation(MOMENTS))
        self.window = ReadingWindow(1, SCAN_NS)
        self.now_ns = 0

    def test(
        self,
        closure_rel: NDArray[np.float64],
        *unread: int,
        motion_rel: float = 0.0,
        overloaded: tuple[int, ...] = (),
    ) -> ConsistencyResult:
        """Test the next scan without some elements, and with some that are closed at least as far as they read."""
        self.now_ns += SCAN_NS
        readings = self.window.add(1.0 - closure_rel[None], np.full((1, 9), self.now_ns))
        readings = readings._replace(second_largest_motion_rel=np.array([motion_rel]))
        unusable = np.isin(np.arange(9), unread)[None]
        is_overloaded = np.isin(np.arange(9), overloaded)[None]
        return self.consistency.test(closure_rel[None], readings, unusable, is_overloaded)

    @classmethod
    def with_stuck_element(cls) -> "Leg":
        """Return a leg whose element 0 was stuck under load, is excluded, and has been at rest since."""
        leg = cls()
        for _ in range(10):
            leg.test(STUCK)
        for _ in range(200):
            assert leg.test(np.zeros(9)).missing[0, 0]
        return leg

    def missing(self, closure_rel: NDArray[np.float64], n: int, element: int = 0) -> list[bool]:
        """Return whether an element is missing in each of the next n scans."""
        return [bool(self.test(closure_rel).missing[0, element]) for _ in range(n)]


def pressed(load: tuple[float, float, float] = (1.0, 0.0, 0.0)) -> NDArray[np.float64]:
    closure_rel: NDArray[np.float64] = np.array(load) @ PATTERNS
    return closure_rel


STUCK = np.where(np.arange(9) == 0, 0.0, pressed())


@given(loads)
def test_a_load_is_consistent(load: tuple[float, float, float]) -> None:
    """Nothing is missing, nothing inconsistent."""
    result = Leg().test(pressed(load))
    assert not result.missing.any()
    assert not result.inconsistency_sigma_rel.any()


@given(loads, st.integers(0, 8), st.sampled_from([-0.6, 0.6, 5.0]))
def test_the_element_that_is_wrong_is_left_out(
    load: tuple[float, float, float], element: int, by: float
) -> None:
    """After some scans, and alone; until then sigma is wider."""
    closure_rel = pressed(load)
    closure_rel[element] += by
    leg = Leg()
    for n in range(6):
        result = leg.test(closure_rel)
        assert np.flatnonzero(result.missing[0]).tolist() == ([element] if n >= SCANS - 1 else [])
        assert (result.inconsistency_sigma_rel[0] > 0.0) == (n < SCANS - 1)
    assert leg.consistency.excluded[0, element]


@pytest.mark.parametrize("line", MISSING_SETS[10:], ids=lambda line: str(np.flatnonzero(line).tolist()))
def test_a_line_that_is_wrong_is_left_out(line: NDArray[np.bool_]) -> None:
    """If no single element explains it."""
    closure_rel = pressed((1.0, 0.2, 0.3))
    closure_rel[line] += [0.5, -0.4, 0.6]
    leg = Leg()
    for _ in range(SCANS - 1):
        leg.test(closure_rel)
    np.testing.assert_array_equal(leg.test(closure_rel).missing[0], line)


@pytest.mark.parametrize(
    ("unread", "wrong", "line"), [(0, 1, (0, 1, 2)), (4, 7, (1, 4, 7)), (8, 6, (6, 7, 8))]
)
def test_a_wrong_element_beside_one_that_cannot_be_read_takes_their_line(
    unread: int, wrong: int, line: tuple[int, ...]
) -> None:
    """No force does without two single elements, so their row or column is left out, and excluded."""
    leg = Leg()
    closure_rel = pressed((1.0, 0.2, 0.3))
    closure_rel[wrong] += 0.6
    closure_rel[unread] = np.nan
    for n in range(5):
        result = leg.test(closure_rel, unread)
        assert np.flatnonzero(result.missing[0]).tolist() == (list(line) if n >= SCANS - 1 else [unread])
    assert leg.consistency.excluded[0, wrong]


def test_a_wrong_element_that_is_in_no_line_with_one_that_cannot_be_read_widens_sigma() -> None:
    """No force does without both: neither is blamed, though a light load would be explained without the wrong one."""
    leg = Leg()
    closure_rel = pressed((0.1, 0.0, 0.0))
    closure_rel[0] += 0.6
    closure_rel[4] = np.nan
    for _ in range(6):
        result = leg.test(closure_rel, 4)
        assert np.flatnonzero(result.missing[0]).tolist() == [4]
        assert result.inconsistency_sigma_rel[0] > 0.5
    assert not leg.consistency.excluded.any()


def test_residuals_without_a_faulty_element_widen_sigma() -> None:
    """A load that steps while the elements are read: nothing is left out, and sigma is wider for a while."""
    closure_rel = pressed()
    closure_rel[[0, 2, 4, 7]] = 0.0
    result = Leg().test(closure_rel)
    assert not result.missing.any()
    assert result.inconsistency_sigma_rel[0] > 0.1


def test_an_element_that_begins_to_stand_still_widens_sigma() -> None:
    """By what it contradicts the others, before that is enough to leave it out."""
    wrong_by = np.linspace(0.0, 0.12, 4)
    leg, sigmas_rel = Leg(), []
    for by in wrong_by:
        closure_rel = pressed()
        closure_rel[0] -= by
        result = leg.test(closure_rel)
        assert not result.missing.any()
        sigmas_rel.append(float(result.inconsistency_sigma_rel[0]))
    assert sigmas_rel[0] == 0.0
    assert np.all(np.diff(sigmas_rel[1:]) > 0.0)
    assert sigmas_rel[-1] > wrong_by[-1]


@pytest.mark.parametrize("load", [0.0, 0.15, 1.0])
def test_a_foot_whose_load_does_not_change_is_sound_again_after_a_thousand_scans(load: float) -> None:
    """An element that read another leg's for a while, on a foot that hangs, barely stands, or stands."""
    leg = Leg()
    steady = pressed((load, 0.0, 0.0))
    foreign = steady.copy()
    foreign[4] += 0.4
    leg.test(steady)
    for _ in range(10):
        leg.test(foreign)
    scans = round(ENOUGH_EVIDENCE / (SMALL_SHARE * SLOW_SHARE))
    assert leg.missing(steady, scans, 4) == [True] * (scans - 1) + [False]


def test_a_gap_is_not_time_in_which_an_element_agreed() -> None:
    """Ten seconds without a scan count nothing."""
    leg = Leg.with_stuck_element()
    leg.now_ns += 10_000_000_000
    assert leg.missing(pressed(), AGREEING_SCANS) == [True] * (AGREEING_SCANS - 1) + [False]


def test_an_element_that_is_wrong_again_is_left_out_again_for_as_long() -> None:
    """The second time as the first, once it stands still: nothing that it had agreed before counts."""
    leg = Leg.with_stuck_element()
    assert leg.missing(pressed(), AGREEING_SCANS)[-1] is False
    assert leg.missing(STUCK, 10) == [False] * 2 + [True] * 8
    assert all(leg.missing(np.zeros(9), 200))
    assert leg.missing(pressed(), AGREEING_SCANS) == [True] * (AGREEING_SCANS - 1) + [False]


def test_one_scan_that_disagrees_takes_back_four_that_agreed() -> None:
    """All but one of the scans, one that contradicts, and five more until the element is trusted; and four in swing."""
    leg = Leg.with_stuck_element()
    leg.missing(pressed(), AGREEING_SCANS - 1)
    leg.test(STUCK)
    assert all(leg.missing(pressed(), 5))
    assert leg.missing(np.zeros(9), 4) == [True] * 3 + [False]


def test_a_drift_that_a_load_hides_is_not_trusted() -> None:
    """Under load more is tolerated; the element still stands beside its place in the air."""
    leg = Leg()
    free, loaded = np.zeros(9), pressed()
    free[8] = loaded[8] = 2 * RESIDUAL_LIMIT
    loaded[8] += 0.3
    for _ in range(10):
        leg.test(free)
    for _ in range(100):
        leg.test(loaded)
    for _ in range(3):
        leg.test(free)
    for _ in range(100):
        assert leg.test(loaded).missing[0, 8]


@pytest.mark.parametrize("load", [0.0, 1.0])
@pytest.mark.parametrize("per_scan", [2e-4, -1e-3])
def test_an_element_that_moves_alone_is_left_out(load: float, per_scan: float) -> None:
    """Under a load that hides it as well, long before it contradicts the others, and until it is back."""
    leg = Leg()
    closure_rel = pressed((load, 0.0, 0.0))
    leg.test(closure_rel)
    n = 0
    while not leg.test(closure_rel).missing[0, 4]:
        closure_rel[4] += per_scan
        n += 1
    scans_of_evidence = ENOUGH_EVIDENCE / SLOW_SHARE
    assert n * abs(per_scan) <= UNCERTAIN_RESIDUAL + (scans_of_evidence + 2) * abs(per_scan)
    assert n >= scans_of_evidence or abs(n * per_scan) > RESIDUAL_LIMIT
    assert all(leg.missing(closure_rel, 100, 4))
    scans = round(ENOUGH_EVIDENCE / (SMALL_SHARE * SLOW_SHARE))
    assert not leg.missing(pressed((load, 0.0, 0.0)), scans, 4)[-1]


@settings(max_examples=10)
@given(loads, loads, st.integers(2, 100))
def test_a_load_that_moves_slowly_and_rests_moves_no_element_alone(
    before: tuple[float, float, float], after: tuple[float, float, float], scans: int
) -> None:
    """From one load to another, and a rest there."""
    leg = Leg()
    way = pressed(after) - pressed(before)
    for share in np.concatenate((np.linspace(0.0, 1.0, scans), np.ones(round(1.0 / SLOW_SHARE) * SCANS))):
        leg.test(pressed(before) + share * way)
    assert not leg.consistency.excluded.any()


def test_a_leg_without_a_reading_is_not_tested_and_a_new_foot_is_trusted() -> None:
    """A NaN that is not missing says nothing about the others; a reset readmits all."""
    leg = Leg()
    wrong = pressed()
    wrong[3] = -1.0
    for _ in range(10):
        leg.test(wrong)
    leg.consistency.reset(np.array([True]))
    assert not leg.test(wrong).missing.any()
    holed = pressed()
    holed[5] = np.nan
    result = leg.test(holed)
    assert not result.missing.any()
    assert not result.inconsistency_sigma_rel.any()
    assert not leg.consistency.excluded.any()


def test_a_frame_without_a_new_reading_is_no_evidence() -> None:
    """Neither for an element nor against it: a conversion of another element brings one as well."""
    leg = Leg.with_stuck_element()
    leg.test(pressed())
    for _ in range(2 * AGREEING_SCANS):
        leg.now_ns -= SCAN_NS  # the same time stamps
        assert leg.test(pressed()).missing[0, 0]


def test_a_stuck_element_is_called_so_until_it_is_trusted() -> None:
    """Also while it follows the load again."""
    leg = Leg()
    for load in np.tile(np.linspace(0.2, 1.0, 5), 4):
        closure_rel = pressed((load, 0.0, 0.0))
        closure_rel[0] = 0.0
        leg.test(closure_rel)
    assert leg.consistency.stuck[0, 0]
    for load in np.linspace(0.2, 1.0, 5):
        assert leg.test(pressed((load, 0.0, 0.0))).missing[0, 0]
        assert leg.consistency.stuck[0, 0]


def test_what_motion_explains_is_no_fault() -> None:
    """A residual up to the change between two readings takes no element out, and widens no sigma; one beyond does."""
    closure_rel = pressed()
    closure_rel[4] += 0.3
    result = Leg().test(closure_rel, motion_rel=0.3)
    assert not result.missing.any()
    assert not result.inconsistency_sigma_rel.any()
    assert Leg().test(closure_rel, motion_rel=0.05).inconsistency_sigma_rel.any()


def test_motion_neither_clears_a_suspicion_nor_feeds_it() -> None:
    """A stuck element that a quick load hides for a while is excluded after as many scans as without it."""
    leg = Leg()
    for _ in range(SCANS - 1):
        leg.test(STUCK)
    for _ in range(8):
        assert not leg.test(STUCK, motion_rel=0.5).missing.any()
    assert not leg.consistency.excluded.any()
    leg.test(STUCK)
    assert np.flatnonzero(leg.consistency.excluded[0]).tolist() == [0]


def test_an_element_is_not_readmitted_for_what_motion_hides() -> None:
    """Time in which only the motion makes it consistent does not count."""
    leg = Leg.with_stuck_element()
    for _ in range(3 * AGREEING_SCANS):
        assert leg.test(STUCK, motion_rel=0.5).missing[0, 0]


@pytest.mark.parametrize("elements", [(4,), (0, 1, 2), (1, 5, 6)], ids=str)
def test_an_overloaded_element_is_closed_at_least_as_far_as_it_reads(elements: tuple[int, ...]) -> None:
    """It may read less than the others predict, for however long, and predicts no other."""
    closure_rel = pressed((4.0, 0.3, -0.2))
    closure_rel[list(elements)] = 0.8
    assert Leg().test(closure_rel).inconsistency_sigma_rel[0] > 0.0
    leg = Leg()
    for _ in range(8):
        result = leg.test(closure_rel, overloaded=elements)
        assert not result.missing.any()
        assert not result.inconsistency_sigma_rel.any()


@pytest.mark.parametrize("beside", [(), (8,), (6, 8)], ids=str)
def test_an_overloaded_element_far_above_its_prediction_is_left_out(beside: tuple[int, ...]) -> None:
    """As one that contradicts the others; until then sigma is wider."""
    closure_rel = pressed((1.0, 0.2, 0.0))
    closure_rel[4] = 0.8
    leg, shown = Leg(), []
    for _ in range(SCANS + 1):
        result = leg.test(closure_rel, overloaded=(4, *beside))
        shown.append((np.flatnonzero(result.missing[0]).tolist(), result.inconsistency_sigma_rel[0] > 0.1))
    assert shown == [([], True)] * (SCANS - 1) + [([4], False)] * 2
    assert leg.consistency.excluded[0, 4]


def test_too_many_overloaded_elements_tell_nothing_of_the_others() -> None:
    """There is no force; the evidence stays what it was."""
    leg = Leg()
    for _ in range(SCANS - 1):
        leg.test(STUCK)
    for _ in range(3):
        assert not leg.test(STUCK, overloaded=(1, 2, 4, 5)).missing.any()
    assert leg.test(STUCK).missing[0, 0]


def test_what_an_impact_leaves_in_two_elements_is_no_fault() -> None:
    """They read it once each, the others before and after: no element is left out, and sigma is wider for a scan."""
    window, consistency = ReadingWindow(1, SCAN_NS), ConsistencyTest(1, Imputation(MOMENTS))
    plate_distance_rel, t_ns = np.ones((1, 9)), np.zeros((1, 9), np.int64)
    none = np.zeros((1, 9), bool)
    sigmas_rel = []
    for n in range(72):
        element, now_ns = n % 9, (n + 1) * SCAN_NS // 9
        hit_rel = {27: 0.6, 28: 0.2}.get(n, 0.0)
        plate_distance_rel[0, element], t_ns[0, element] = 1.0 - hit_rel, now_ns
        readings = window.add(plate_distance_rel, t_ns)
        result = consistency.test(1.0 - readings.plate_distance_rel[0], readings, none, none)
        assert not result.missing.any()
        sigmas_rel.append(float(result.inconsistency_sigma_rel[0]))
    assert min(sigmas_rel[27:36]) > 0.1
    assert not any(sigmas_rel[:27] + sigmas_rel[37:])


@pytest.mark.slow
@given(
    st.sampled_from([(5, 0, 7, 6, 4, 2, 1, 8, 3), tuple(range(9))]),
    st.floats(0.005, 1.0),
    st.floats(0.05, 2.0),
    st.tuples(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0)),
)
@settings(max_examples=30)
def test_a_sound_foot_in_motion_is_never_blamed(
    order: tuple[int, ...], rise_s: float, size: float, tilt: tuple[float, float]
) -> None:
    """Nine elements read one after the other while a load comes, stays and goes: none is excluded, however fast."""
    window, consistency = ReadingWindow(1, SCAN_NS), ConsistencyTest(1, Imputation(MOMENTS))
    plate_distance_rel, t_ns = np.ones((1, 9)), np.zeros((1, 9), np.int64)
    none = np.zeros((1, 9), bool)
    for n in range(round(9 * (2 * rise_s + 0.5) / (SCAN_NS * 1e-9))):
        element, now_ns = order[n % 9], (n + 1) * SCAN_NS // 9
        since_s = now_ns * 1e-9 - 0.1
        share = np.clip(min(since_s, 2 * rise_s + 0.2 - since_s) / rise_s, 0.0, 1.0)
        closure_rel = share * np.array([size, size * tilt[0], size * tilt[1]]) @ PATTERNS
        plate_distance_rel[0, element], t_ns[0, element] = 1.0 - closure_rel[element], now_ns
        readings = window.add(plate_distance_rel, t_ns)
        consistency.test(1.0 - readings.plate_distance_rel[0], readings, none, none)
        assert not consistency.excluded.any()
