"""A leg with open elements: estimated from the others as long as they lie in one row or column."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from footsense.core.quality import missing_elements
from footsense.frames import State
from tests.unit.feet import SCAN_NS, SIGMA_N, Feet

#: What an element reads whose line is open [pF]; the last two are what is left of one when a stray is subtracted.
OPEN_PF = [0.8, 0.0, -0.3]

LINES = [{3 * n + k for k in range(3)} for n in range(3)] + [{3 * k + n for k in range(3)} for n in range(3)]


def opened(*elements: int) -> NDArray[np.bool_]:
    """Return the mask of one leg, shape (1, 9)."""
    mask = np.zeros((1, 9), bool)
    mask[0, list(elements)] = True
    return mask


@given(st.sets(st.integers(0, 8)))
def test_what_is_missing_is_one_element_or_a_line(elements: set[int]) -> None:
    """Nothing for none; one stays one; two or three in a line make the line; the rest is beyond the network."""
    missing = set(np.flatnonzero(missing_elements(opened(*elements))[0]).tolist())
    lines = [line for line in LINES if elements <= line]
    if len(elements) < 2:
        assert missing == elements
    else:
        assert missing == (lines[0] if lines else set())


def test_legs_are_judged_apart() -> None:
    """What is open on one says nothing of another."""
    both = np.concatenate([opened(1, 7), opened(0, 4), opened(), opened(8)])
    expected = np.concatenate([opened(1, 4, 7), opened(), opened(), opened(8)])
    np.testing.assert_array_equal(missing_elements(both), expected)


@pytest.mark.parametrize("open_pf", OPEN_PF)
@pytest.mark.parametrize(
    ("broken", "n_missing"), [([4], 1), ([3, 4, 5], 3), ([2, 5, 8], 3), ([0, 2], 3)], ids=str
)
def test_a_broken_line_is_estimated_from_the_others(
    broken: list[int], n_missing: int, open_pf: float
) -> None:
    """From the first scan on: DEGRADED, the force of what remains, the network's own sigma; the mask names the open."""
    feet = Feet().tared()
    feet.feed(feet.scan(5.0))
    feet.feed(feet.scan(5.0))
    for _ in range(4):
        scan = feet.scan(5.0)
        scan.capacitance_pf[1, broken] = open_pf
        forces = feet.feed(scan)
        assert forces.state.tolist() == [State.VALID, State.DEGRADED]
        assert forces.fault_mask.tolist() == [0, sum(1 << element for element in broken)]
        np.testing.assert_allclose(forces.force_n, 9 * 0.25, rtol=1e-5)
        np.testing.assert_allclose(forces.sigma_n[0], SIGMA_N)
        np.testing.assert_allclose(forces.sigma_n[1], SIGMA_N * (1 + n_missing))


@pytest.mark.parametrize("broken", [[0, 4], [1, 3], [0, 1, 2, 3], list(range(9))], ids=str)
def test_more_than_a_line_is_an_element_fault(broken: list[int]) -> None:
    """No value, and the mask names what is open."""
    feet = Feet().tared()
    scan = feet.scan(2.0)
    scan.capacitance_pf[1, broken] = 0.8
    forces = feet.feed(scan)
    assert forces.state.tolist() == [State.VALID, State.ELEMENT_FAULT]
    assert forces.fault_mask.tolist() == [0, sum(1 << element for element in broken)]
    assert np.isnan(forces.force_n[1]).all()
    assert np.isnan(forces.sigma_n[1]).all()


@pytest.mark.parametrize(
    ("closure_um", "state"), [(17.0, State.OUT_OF_RANGE), (19.5, State.SATURATED), (-2.0, State.OUT_OF_RANGE)]
)
def test_the_elements_that_remain_are_judged_as_ever(closure_um: float, state: State) -> None:
    """A degraded leg is no excuse for a load beyond the training or the gap."""
    feet = Feet().tared()
    closures = np.zeros((2, 9))
    closures[0, 2] = closure_um
    scan = feet.scan(closures)
    scan.capacitance_pf[0, 3:6] = 0.8
    assert feet.feed(scan).state.tolist() == [state, State.VALID]


def test_an_unused_element_of_a_broken_line_has_no_say() -> None:
    """Two of a row are open: what the third reads changes neither state nor force."""
    feet = Feet().tared()
    for closure_um in (5.0, 17.0, 19.9):
        closures = np.full((2, 9), 5.0)
        closures[0, 1] = closure_um
        scan = feet.scan(closures)
        scan.capacitance_pf[0, [0, 2]] = 0.8
        forces = feet.feed(scan)
        assert forces.state[0] == State.DEGRADED
        np.testing.assert_allclose(forces.force_n[0], 9 * 0.25, rtol=1e-5)


def test_an_element_that_returns_is_no_load() -> None:
    """STALE for the scan in which it has no reading before to be moved along, then the force as it was."""
    feet = Feet().tared()
    states = []
    for number in range(12):
        scan = feet.scan(5.0)
        scan.t_ns[:] += np.arange(9) * SCAN_NS // 9
        if 4 <= number < 7:
            scan.capacitance_pf[0, 5] = 0.8
        forces = feet.feed(scan, age_ns=SCAN_NS)
        states.append(State(int(forces.state[0])))
        if number > 1 and states[-1] != State.STALE:
            np.testing.assert_allclose(forces.force_n[0], 9 * 0.25, rtol=1e-5)
    assert states[4:7] == [State.DEGRADED] * 3
    assert states[7:] == [State.STALE] + [State.VALID] * 4
