"""What the network sees of feet whose readings are late, lost or wrong, and what becomes of the leg."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from footsense.frames import USABLE, CapFrame, Cause, Reading, State
from tests.support.feet import DESIGN, MAX_AGE_NS, SCAN_NS, SIGMA_N, WINDOW, Feet, unread

STEP_NS = SCAN_NS // 9


def states(feet: Feet, n: int, closure_um: float = 2.0) -> list[State]:
    """Return the states of the first leg over n more scans."""
    return [State(int(feet.feed(feet.scan(closure_um)).state[0])) for _ in range(n)]


def test_the_network_sees_three_readings_with_their_ages() -> None:
    """Closures over the gap, newest first, and the time from the middle of each conversion to the sending."""
    feet = Feet().tared()
    for closure_um in (1.0, 2.0, 4.0):
        scan = feet.scan(closure_um)
        scan.t_ns[:] += np.arange(9) * STEP_NS
        feet.feed(scan, age_ns=SCAN_NS)
    seen = feet.estimator.window
    np.testing.assert_allclose(seen.closure_rel[1], np.repeat([[0.2], [0.1], [0.05]], 9, axis=1), atol=1e-12)
    ages_s = (SCAN_NS - np.arange(9) * STEP_NS + SCAN_NS * np.arange(3)[:, None]) * 1e-9
    np.testing.assert_allclose(seen.age_s, np.tile(ages_s, (2, 1, 1)), rtol=1e-12)
    assert not seen.missing.any()


@pytest.mark.parametrize(
    ("elements", "mask", "n_missing"),
    [((4,), 0b000_010_000, 1), ((3, 5), 0b000_111_000, 3), ((1, 4, 7), 0b010_010_010, 3)],
    ids=str,
)
def test_elements_without_a_history_are_left_out(
    elements: tuple[int, ...], mask: int, n_missing: int
) -> None:
    """DEGRADED without them until each has been read twice in a row; the mask says which."""
    feet = Feet().tared()
    feet.feed(feet.scan(2.0))
    lost = feet.feed(unread(feet.scan(2.0), 0, *elements))
    assert lost.state.tolist() == [State.CONVERTER_FAULT, State.VALID]
    forces = feet.feed(feet.scan(2.0))
    assert forces.state.tolist() == [State.DEGRADED, State.VALID]
    assert (forces.cause[0], forces.fault_mask.tolist()) == (Cause.NONE, [mask, 0])
    np.testing.assert_allclose(forces.force_n, 0.9, rtol=1e-5)
    np.testing.assert_allclose(forces.sigma_n[0], SIGMA_N * (1 + n_missing))
    seen = feet.estimator.window
    assert np.flatnonzero(seen.missing[0]).tolist() == [e for e in range(9) if mask >> e & 1]
    # A reading that was never made has no age of its own.
    np.testing.assert_allclose(seen.age_s[0], np.repeat([[0.0], [0.025], [0.05]], 9, axis=1), atol=1e-12)
    assert states(feet, 2) == [State.VALID] * 2


def test_more_than_a_line_without_a_history_waits() -> None:
    """No set that the network knows: STALE for one scan, without the blame of any element."""
    feet = Feet().tared()
    feet.feed(unread(feet.scan(2.0), 0, 0, 5))
    forces = feet.feed(feet.scan(2.0))
    assert forces.state.tolist() == [State.STALE, State.VALID]
    assert forces.fault_mask.tolist() == [0, 0]
    assert states(feet, 2) == [State.VALID] * 2


@pytest.mark.parametrize("n_scans", [1, 2, 5])
def test_a_leg_that_was_silent_has_a_force_with_its_second_scan(n_scans: int) -> None:
    """ABSENT, once STALE, then VALID, and its last readings before are not mixed with those after."""
    feet = Feet().tared()
    feet.feed(feet.scan(1.0))
    for _ in range(n_scans):
        scan = unread(feet.scan(), 0, reading=Reading.NO_ANSWER)
        assert feet.feed(scan).state.tolist() == [State.ABSENT, State.VALID]
    assert states(feet, 1, 3.0) == [State.STALE]
    assert states(feet, 1, 3.0) == [State.VALID]
    np.testing.assert_allclose(feet.estimator.window.closure_rel[0], 0.15, rtol=1e-9)


@pytest.mark.parametrize("jump_ns", [-2 * SCAN_NS, -(10**12), 1, SCAN_NS, 10**12])
def test_an_element_whose_stamp_jumps_is_left_out(jump_ns: int) -> None:
    """Back in time or into the future, by little or much: the leg goes on without it, and is whole soon after."""
    feet = Feet().tared()
    feet.feed(feet.scan(2.0))
    scan = feet.scan(2.0)
    scan.t_ns[0, 4] += jump_ns
    forces = feet.feed(scan)
    assert forces.state.tolist() == [State.DEGRADED, State.VALID]
    assert forces.fault_mask.tolist() == [1 << 4, 0]
    assert forces.t_ns.tolist() == [feet.sequence * SCAN_NS] * 2
    np.testing.assert_allclose(forces.force_n, 0.9, rtol=1e-5)
    assert states(feet, 3)[-1] == State.VALID


@pytest.mark.parametrize("jump_ns", [-2 * MAX_AGE_NS, 10**9, 10**15])
def test_a_leg_whose_clock_jumps_has_no_force(jump_ns: int) -> None:
    """Neither too old nor of the future, however long it lasts, and none of a mixture once it is right again."""
    feet = Feet().tared()
    feet.feed(feet.scan(2.0))
    for _ in range(4):
        scan = feet.scan(2.0)
        scan.t_ns[0] += jump_ns
        forces = feet.feed(scan)
        assert forces.state.tolist() == [State.STALE, State.VALID]
        assert (forces.age_ns[forces.t_ns > 0] >= 0).all()
    assert states(feet, 2)[-1] == State.VALID


def test_after_start_elements_come_one_by_one() -> None:
    """STARTING while the first readings come in, then a tare, then VALID; the network never sees a hole."""
    feet = Feet(n_legs=1)
    scan = unread(feet.scan(), 0, reading=Reading.OK)
    seen: list[State] = []
    for n in range(9 * (WINDOW + 2)):
        element, now_ns = n % 9, (n + 1) * STEP_NS
        scan.capacitance_pf[0, element], scan.t_ns[0, element] = DESIGN.unloaded_pf, now_ns
        frame = CapFrame(n, scan.t_ns.copy(), scan.capacitance_pf.copy(), scan.reading)
        state = State(int(feet.pipeline.process(frame, now_ns)[0].state[0]))
        if not seen or seen[-1] != state:
            seen.append(state)
    assert seen == [State.STARTING, State.TARING, State.VALID]


def test_a_foot_whose_gaps_all_closed_is_back_with_the_next_scan() -> None:
    """SATURATED without a number; of the readings beyond the range the network sees the end of the trained range."""
    feet = Feet(n_legs=1).tared()
    states(feet, 2, 10.0)
    for _ in range(4):
        scan = feet.scan()
        scan.capacitance_pf[:], scan.reading[:] = np.nan, Reading.OVER_RANGE
        forces = feet.feed(scan)
        assert (forces.state[0], forces.cause[0]) == (State.SATURATED, Cause.OVERLOAD)
        assert np.isnan(forces.force_n).all()
    assert states(feet, 1, 10.0) == [State.VALID]
    seen = feet.estimator.window.closure_rel[0]
    np.testing.assert_allclose(seen, np.repeat([[0.5], [0.8], [0.8]], 9, axis=1))


def test_a_missing_element_is_imputed_in_every_reading() -> None:
    """From the others of the same scan, with the mean of their ages."""
    feet = Feet(n_legs=1).tared()
    for closure_um in (1.0, 1.0, 2.0, 3.0, 4.0):
        scan = feet.scan(closure_um)
        scan.capacitance_pf[0, 7] = 0.5
        scan.t_ns[:] += np.arange(9) * STEP_NS
        forces = feet.feed(scan, age_ns=SCAN_NS)
    assert forces.state[0] == State.DEGRADED
    seen = feet.estimator.window
    np.testing.assert_allclose(seen.closure_rel[0, :, 7], [0.2, 0.15, 0.1], rtol=1e-5)
    np.testing.assert_allclose(seen.age_s[0, :, 7], np.delete(seen.age_s[0], 7, axis=1).mean(axis=1))


#: What may happen to an element in a scan: a reading, a capacitance, and a jump of its stamp.
element_events = st.tuples(
    st.sampled_from([Reading.OK] * 5 + list(Reading)),
    st.sampled_from([DESIGN.unloaded_pf, DESIGN.unloaded_pf * 1.1, 0.0]) | st.floats(),
    st.sampled_from([0, 0, 0, 1, SCAN_NS, -SCAN_NS, -(10**15), 10**15]),
)


@given(st.lists(st.dictionaries(st.integers(0, 17), element_events, max_size=5), min_size=1, max_size=8))
@settings(max_examples=50)
def test_no_run_of_bad_scans_makes_a_number_of_nothing(
    scans: list[dict[int, tuple[Reading, float, int]]],
) -> None:
    """The network sees numbers in their order, a state says whether there is a force, and three good scans end it."""
    feet = Feet().tared()
    for events in scans:
        scan = feet.scan(1.0)
        for place, (reading, capacitance_pf, jump_ns) in events.items():
            at = divmod(place, 9)
            scan.reading[at], scan.capacitance_pf[at] = reading, capacitance_pf
            scan.t_ns[at] += jump_ns
        forces = feet.feed(scan)
        usable = np.isin(forces.state, list(USABLE))
        assert np.isfinite(forces.force_n[usable]).all()
        assert (forces.sigma_n[usable] > 0.0).all()
        assert np.isnan(forces.force_n[~usable]).all()
        assert (forces.age_ns[usable] >= 0).all()
    for _ in range(3):
        forces = feet.feed(feet.scan(1.0))
    assert np.isin(forces.state, list(USABLE)).all()
