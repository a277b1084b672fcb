"""A leg with open elements: estimated from the others as long as they lie in one row or column."""

import numpy as np
import pytest
from numpy.typing import NDArray

from footsense.estimation.elements import floating_row_crosstalk_pf
from footsense.frames import USABLE, CapFrame, Cause, Reading, State
from tests.support.feet import SCAN_NS, SIGMA_N, WINDOW, Feet
from tests.support.standing import Standing

#: What an element reads whose line is open [pF].
OPEN_PF = 0.8


def opened(*elements: int) -> NDArray[np.bool_]:
    """Return the mask of one leg, shape (1, 9)."""
    mask = np.zeros((1, 9), bool)
    mask[0, list(elements)] = True
    return mask


def test_only_a_whole_row_floats() -> None:
    """Each column of the rows that are left gets what the lost row reads there; a single open element adds none."""
    capacitance_pf = np.arange(9.0)[None] + 1.0
    added = floating_row_crosstalk_pf(capacitance_pf, opened(3, 4, 5))
    np.testing.assert_array_equal(added, [[4.0, 5.0, 6.0, 0.0, 0.0, 0.0, 4.0, 5.0, 6.0]])
    capacitance_pf[0, 4] = np.nan  # under the converter's range
    added = floating_row_crosstalk_pf(capacitance_pf, opened(3, 4, 5))
    np.testing.assert_array_equal(added, [[4.0, 0.0, 6.0, 0.0, 0.0, 0.0, 4.0, 0.0, 6.0]])
    capacitance_pf[0, 4] = 5.0
    for elements in ((), (4,), (3, 4), (2, 5, 8)):
        np.testing.assert_array_equal(floating_row_crosstalk_pf(capacitance_pf, opened(*elements)), 0.0)


def break_line(scan: CapFrame, leg: int, broken: list[int], open_pf: float = OPEN_PF, first: int = 0) -> None:
    """Open elements of a leg, as far as they are read after the element `first`; a row that floats adds to the rest."""
    after = np.arange(9) >= first
    scan.capacitance_pf[leg, [element for element in broken if after[element]]] = open_pf
    if broken in ([0, 1, 2], [3, 4, 5], [6, 7, 8]):
        scan.capacitance_pf[leg, after & ~np.isin(np.arange(9), broken)] += open_pf


@pytest.mark.parametrize(
    ("broken", "open_pf", "stray_pf", "n_missing", "cause"),
    [
        ([4], OPEN_PF, 0.0, 1, Cause.ELEMENT_OPEN),
        ([3, 4, 5], OPEN_PF, 0.0, 3, Cause.ROW_OPEN),
        ([3, 4, 5], OPEN_PF, 1.5, 3, Cause.ROW_OPEN),
        ([2, 5, 8], 0.0, 0.0, 3, Cause.COLUMN_OPEN),
        ([0, 2], 0.0, 1.5, 3, Cause.ELEMENT_OPEN),
    ],
    ids=str,
)
def test_a_broken_line_is_estimated_from_the_others(
    broken: list[int], open_pf: float, stray_pf: float, n_missing: int, cause: Cause
) -> None:
    """DEGRADED with the force of what remains and the network's own sigma; mask and cause name what is open."""
    feet = Feet(stray_pf=stray_pf).tared()
    for number in range(5):
        scan = feet.scan(5.0)
        break_line(scan, 1, broken, open_pf)
        forces = feet.feed(scan)
        assert forces.fault_mask.tolist() == [0, sum(1 << element for element in broken)]
        assert forces.state.tolist() == [State.VALID, State.STALE if number < 2 else State.DEGRADED]
    assert forces.cause.tolist() == [Cause.NONE, cause]
    np.testing.assert_allclose(forces.force_n, 9 * 0.25, rtol=1e-5)
    np.testing.assert_allclose(forces.sigma_n[0], SIGMA_N)
    np.testing.assert_allclose(forces.sigma_n[1], SIGMA_N * (1 + n_missing))


@pytest.mark.parametrize(
    ("broken", "cause"),
    [
        ([0, 4], Cause.ELEMENT_OPEN),
        ([1, 3], Cause.ELEMENT_OPEN),
        ([0, 4, 8], Cause.ELEMENT_OPEN),
        ([0, 1, 2, 3], Cause.ROW_OPEN),
    ],
    ids=str,
)
def test_more_than_a_line_is_an_element_fault(broken: list[int], cause: Cause) -> None:
    """No value; the mask names what is open, and a line is told by all three of its elements."""
    feet = Feet().tared()
    scan = feet.scan(2.0)
    scan.capacitance_pf[1, broken] = 0.8
    forces = feet.feed(scan)
    assert forces.state.tolist() == [State.VALID, State.ELEMENT_FAULT]
    assert forces.cause.tolist() == [Cause.NONE, cause]
    assert forces.fault_mask.tolist() == [0, sum(1 << element for element in broken)]
    assert np.isnan(forces.force_n[1]).all()
    assert np.isnan(forces.sigma_n[1]).all()


@pytest.mark.parametrize(
    ("elements", "closure_um", "state"),
    [
        ([2], -2.0, State.OUT_OF_RANGE),
        ([0, 1, 2], 19.5, State.DEGRADED),
        ([0, 1, 2, 6], 17.0, State.SATURATED),
    ],
    ids=str,
)
def test_the_elements_that_remain_are_judged_as_ever(
    elements: list[int], closure_um: float, state: State
) -> None:
    """A degraded leg is no excuse for a load beyond the training or the gap."""
    feet = Feet().tared()
    closures = np.zeros((2, 9))
    closures[0, elements] = closure_um
    for _ in range(3):
        scan = feet.scan(closures)
        break_line(scan, 0, [3, 4, 5])
        forces = feet.feed(scan)
    assert forces.state.tolist() == [state, State.VALID]


def test_an_unused_element_of_a_broken_line_has_no_say() -> None:
    """Two of a row are open: what the third reads changes neither state nor force."""
    feet = Feet().tared()
    for closure_um in (5.0, 5.0, 5.0, 17.0, 19.9):
        closures = np.full((2, 9), 5.0)
        closures[0, 1] = closure_um
        scan = feet.scan(closures)
        break_line(scan, 0, [0, 2])
        forces = feet.feed(scan)
    assert forces.state[0] == State.DEGRADED
    np.testing.assert_allclose(forces.force_n[0], 9 * 0.25, rtol=1e-5)


@pytest.mark.parametrize(
    ("broken", "first"),
    [([5], 0), ([5], 8), ([3, 4, 5], 0), ([3, 4, 5], 4), ([3, 4, 5], 6), ([0, 3, 6], 5)],
    ids=str,
)
def test_a_line_that_comes_and_goes_is_no_load(broken: list[int], first: int) -> None:
    """No force until all elements have two readings of one kind, then the right one.

    One scan cannot know: the one in which a row breaks after its own elements, but before others, were read.
    """
    feet = Feet(n_legs=1).tared()
    states = []
    for number in range(14):
        scan = feet.scan(5.0)
        scan.t_ns[:] += np.arange(9) * SCAN_NS // 9
        if number == 4:
            break_line(scan, 0, broken, first=first)
        if 4 < number < 8:
            break_line(scan, 0, broken)
        forces = feet.feed(scan, age_ns=SCAN_NS)
        states.append(State(int(forces.state[0])))
        unseen = number == 4 and first > max(broken)
        if number > 1 and states[-1] in USABLE and not unseen:
            np.testing.assert_allclose(forces.force_n[0], 9 * 0.25, rtol=1e-5)
    assert states[7] == State.DEGRADED
    assert states[8:] == [State.STALE] * 2 + [State.VALID] * 4


def over_range(feet: Feet, closure_um: float, *elements: int) -> CapFrame:
    """Return a scan in which some elements of the first leg are beyond the converter's range."""
    scan = feet.scan(closure_um)
    scan.capacitance_pf[0, elements], scan.reading[0, elements] = np.nan, Reading.OVER_RANGE
    return scan


@pytest.mark.parametrize("elements", [(4,), (0, 8), (0, 1, 2), (2, 3, 7)], ids=str)
def test_up_to_three_elements_of_a_pressed_foot_may_be_over_the_range(elements: tuple[int, ...]) -> None:
    """DEGRADED for as long as it lasts, with the network's force and sigma of the end of the range."""
    feet = Feet().tared()
    for _ in range(8):
        forces = feet.feed(over_range(feet, 15.9, *elements))
        assert forces.state.tolist() == [State.DEGRADED, State.VALID]
        assert forces.cause.tolist() == [Cause.OVERLOAD, Cause.NONE]
        assert forces.fault_mask.tolist() == [sum(1 << element for element in elements), 0]
    np.testing.assert_array_equal(feet.estimator.window.closure_rel[0, 0, list(elements)], 0.8)
    np.testing.assert_allclose(forces.force_n[0], 9 * 0.795, rtol=0.01)
    np.testing.assert_allclose(forces.sigma_n[0], SIGMA_N)
    assert feet.feed(feet.scan(15.0)).state.tolist() == [State.VALID, State.VALID]


def test_with_four_elements_over_the_range_there_is_no_force_for_as_long() -> None:
    feet = Feet().tared()
    for n, state in ((4, State.SATURATED), (3, State.DEGRADED), (9, State.SATURATED), (0, State.VALID)):
        forces = feet.feed(over_range(feet, 15.9, *range(n)))
        assert forces.state.tolist() == [state, State.VALID]
        assert forces.cause[0] == (Cause.OVERLOAD if n else Cause.NONE)
        assert np.isnan(forces.force_n[0]).all() == (state == State.SATURATED)


@pytest.mark.parametrize("closure_um", [16.1, 18.0, 19.5])
def test_a_closure_above_those_of_the_training_is_overload(closure_um: float) -> None:
    """Whether the gap is closed or not: the network gets the largest closure of its training."""
    feet = Feet().tared()
    closures = np.full((2, 9), 15.0)
    closures[0, 4] = closure_um
    forces = feet.feed(feet.scan(closures))
    assert (forces.state[0], forces.cause[0]) == (State.DEGRADED, Cause.OVERLOAD)
    assert feet.estimator.window.closure_rel[0, 0, 4] == 0.8


def test_an_element_over_the_range_of_a_free_foot_is_shorted() -> None:
    """Once that has lasted: the force is that of the others. Until then sigma is wide. A tare does without it, too."""
    feet = Feet().tared()
    for scan in range(9):
        forces = feet.feed(over_range(feet, 5.0, 4))
        if scan < 2:
            assert (forces.state[0], forces.cause[0]) == (State.DEGRADED, Cause.OVERLOAD)
            assert (forces.sigma_n[0] > 0.2 * forces.force_n[0]).all()
    assert forces.state.tolist() == [State.DEGRADED, State.VALID]
    assert (forces.cause[0], forces.fault_mask[0]) == (Cause.ELEMENT_SHORTED, 1 << 4)
    np.testing.assert_allclose(forces.force_n[0], 9 * 0.25, rtol=1e-5)
    fresh = Feet()
    for _ in range(WINDOW + 4):
        forces = fresh.feed(over_range(fresh, 0.0, 4))
    assert forces.state.tolist() == [State.DEGRADED, State.VALID]


@pytest.mark.parametrize(
    ("readings", "state", "cause"),
    [
        ([Reading.DELAYED], State.STALE, Cause.DELAYED),
        ([Reading.DELAYED, Reading.CORRUPT], State.CONVERTER_FAULT, Cause.CORRUPT),
        ([Reading.CORRUPT, Reading.BUS_STUCK], State.ABSENT, Cause.BUS_STUCK),
        ([Reading.WRONG_CHIP], State.ABSENT, Cause.WRONG_CHIP),
        ([Reading.NOT_READY, Reading.NO_ANSWER], State.ABSENT, Cause.NO_ANSWER),
    ],
)
def test_the_most_severe_reading_gives_state_and_cause(
    readings: list[Reading], state: State, cause: Cause
) -> None:
    """A corrupt answer is less severe than a chip that does not answer, and open elements are less than either."""
    feet = Feet().tared()
    scan = feet.scan(3.0)
    scan.capacitance_pf[0, 8] = OPEN_PF
    scan.capacitance_pf[0, : len(readings)] = np.nan
    scan.reading[0, : len(readings)] = readings
    forces = feet.feed(scan)
    assert (forces.state.tolist(), forces.cause.tolist()) == ([state, State.VALID], [cause, Cause.NONE])
    assert forces.fault_mask.tolist() == [sum(1 << e for e in (*range(len(readings)), 8)), 0]
    assert np.isnan([forces.force_n[0], forces.sigma_n[0]]).all()
    assert np.isfinite(forces.force_n[1]).all()


def test_an_element_that_drifts_apart_is_a_cause() -> None:
    """Though it is followed and the force is valid; a drift that all elements have is none."""
    feet = Standing(2).tared()
    for drift_ff in np.arange(0.0, 26.0):
        drifts_ff = np.full((2, 9), drift_ff)
        drifts_ff[1, 1:] = 0.0
        for _ in range(100):
            feet.feed(0.0, drifts_ff, passed_s=0.1)
    assert feet.tracker.unloaded.cause.tolist() == [Cause.NONE, Cause.ELEMENT_DRIFTS]
