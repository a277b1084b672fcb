"""From scan to force: what is published, and the state of every leg for which nothing may be."""

import numpy as np
import pytest

from footsense.foot.parameters import ForceUncertainty
from footsense.frames import Cause, Command, CommandKind, Flag, Reading, Result, State
from footsense.ports import LoadEstimate, Window
from tests.support.feet import DESIGN, MAX_AGE_NS, MAX_FORCE_N, SIGMA_N, WINDOW, Feet, SumOfClosures, unread


def test_a_frame_of_other_legs_is_refused() -> None:
    """One leg in place of two would pass for both of them."""
    feet = Feet()
    scan = feet.scan()
    one = scan._replace(t_ns=scan.t_ns[:1], capacitance_pf=scan.capacitance_pf[:1], reading=scan.reading[:1])
    with pytest.raises(ValueError, match="2, 9"):
        feet.feed(one)


@pytest.mark.parametrize("stray_pf", [0.0, 1.0])
def test_the_force_is_the_network_s_of_normalised_closures(stray_pf: float) -> None:
    """5 um on all elements are 0.25 of the gap, also with a known stray."""
    feet = Feet(stray_pf=stray_pf).tared()
    forces = feet.feed(feet.scan(5.0))
    np.testing.assert_allclose(forces.force_n, 9 * 0.25, rtol=1e-9)
    np.testing.assert_array_equal(forces.sigma_n[0], SIGMA_N)
    assert (forces.flags == Flag.SIMULATED | Flag.CONTACT).all()


def test_an_old_measurement_is_stale() -> None:
    """The age limit counts from the oldest element to the sending."""
    feet = Feet().tared()
    assert feet.feed(feet.scan(), age_ns=MAX_AGE_NS).state[0] == State.VALID
    late = feet.feed(feet.scan(), age_ns=MAX_AGE_NS + 1)
    assert (late.state[0], late.cause[0]) == (State.STALE, Cause.DELAYED)


def test_a_tare_under_load_is_refused_with_numbers_and_tried_again_at_start() -> None:
    """NO_BASELINE while it fails, the reason once, and success as soon as the foot is free."""
    feet = Feet(n_legs=1)
    for _ in range(3 * WINDOW):
        forces = feet.feed(feet.scan(3.0))
    assert forces.state.tolist() == [State.NO_BASELINE]
    [(leg, result, reason)] = feet.outcomes
    assert (leg, result) == (0, Result.LOADED)
    assert "not unloaded: element 0 reads 6.081 pF, +12.9% from the 5.387 pF" in reason
    for _ in range(WINDOW):
        forces = feet.feed(feet.scan())
    assert forces.state.tolist() == [State.VALID]


def test_a_tare_of_a_moving_foot_is_refused() -> None:
    """Movement beyond the noise limit within the window is not quiet."""
    feet = Feet(n_legs=1)
    for closure_um in np.linspace(0, 0.2, WINDOW):
        feet.feed(feet.scan(float(closure_um)))
    [(_, result, reason)] = feet.outcomes
    assert result is Result.NOT_QUIET
    assert "fF rms" in reason


def test_many_small_tares_do_not_lead_into_a_load() -> None:
    """Each is judged against the free foot, not against the one before."""
    feet = Feet(n_legs=1)
    for step in range(20):
        feet.pipeline.execute(Command(CommandKind.TARE, 0))
        for _ in range(WINDOW):
            feet.feed(feet.scan(0.06 * step))
    results = [result for _, result, _ in feet.outcomes]
    assert set(results[:4]) == {Result.DONE}
    assert results[-1] is Result.LOADED
    assert (feet.pipeline.baseline_pf < 1.01 * DESIGN.unloaded_pf).all()


def test_a_tare_makes_no_jump_in_the_force() -> None:
    """A drift that is tared away on a foot at rest is gone at once, without a slope that was never there."""
    feet = Feet(n_legs=1).tared()
    for _ in range(3):
        feet.feed(feet.scan(0.05))
    assert feet.pipeline.execute(Command(CommandKind.TARE, 0)) is None
    for _ in range(WINDOW + 3):
        forces = feet.feed(feet.scan(0.05))
        expected_rel = 0.0 if feet.outcomes else 9 * 0.0025
        np.testing.assert_allclose(forces.force_n, expected_rel, atol=1e-9)


def test_a_leg_that_was_away_is_tared_anew() -> None:
    """It may carry another foot now: after a quarter of a second the old baseline is discarded."""
    feet = Feet().tared()
    for n_silent in (9, 10):
        for _ in range(n_silent):
            scan = unread(feet.scan(), 0, reading=Reading.NO_ANSWER)
            assert feet.feed(scan).state[0] == State.ABSENT
        states = [State(int(feet.feed(feet.scan(3.0)).state[0])) for _ in range(WINDOW + 1)]
        if n_silent == 9:
            assert states == [State.STALE] + [State.VALID] * WINDOW
        else:
            starting = [State.STARTING] + [State.TARING] * (WINDOW - 2)
            assert states == starting + [State.NO_BASELINE] * 2


@pytest.mark.parametrize("held", [0, 1])
def test_a_held_bus_keeps_the_baseline_of_its_leg_alone(held: int) -> None:
    """Half a second: the leg on the held bus is as before, the other that gave no answer is tared anew."""
    feet = Feet().tared()
    for _ in range(20):
        scan = unread(feet.scan(), held, reading=Reading.BUS_STUCK)
        feet.feed(unread(scan, 1 - held, reading=Reading.NO_ANSWER))
    states = [feet.feed(feet.scan(3.0)).state.tolist() for _ in range(WINDOW)]
    assert [state[held] for state in states] == [State.STALE] + [State.VALID] * (WINDOW - 1)
    assert {state[1 - held] for state in states} <= {State.STARTING, State.TARING, State.NO_BASELINE}


def test_a_new_foot_is_not_mistrusted_for_the_old_one() -> None:
    """An element that contradicted the others counts again once the leg has been away for long enough."""
    feet = Feet(n_legs=1).tared()
    stuck_um = np.full((1, 9), 5.0)
    stuck_um[0, 4] = 0.0
    for _ in range(3 * WINDOW):
        forces = feet.feed(feet.scan(stuck_um))
    assert (forces.state.tolist(), forces.fault_mask.tolist()) == ([State.DEGRADED], [1 << 4])
    for _ in range(11):
        feet.feed(unread(feet.scan(), 0, reading=Reading.NO_ANSWER))
    for _ in range(2 * WINDOW):
        forces = feet.feed(feet.scan())
    assert [(result, reason) for _, result, reason in feet.outcomes][-1][0] is Result.DONE
    assert (forces.state.tolist(), forces.fault_mask.tolist()) == ([State.VALID], [0])


@pytest.mark.parametrize(
    ("closure_um", "states"),
    [
        (11.0, [State.VALID, State.VALID, State.VALID]),
        (12.0, [State.SATURATED, State.VALID, State.VALID]),
        (15.6, [State.SATURATED, State.VALID, State.VALID]),
        (16.4, [State.SATURATED, State.SATURATED, State.VALID]),
        (23.0, [State.SATURATED, State.SATURATED, State.SATURATED]),
    ],
)
def test_a_foot_s_own_gap_says_when_it_is_shut(closure_um: float, states: list[State]) -> None:
    """A narrow gap closes early, a wide one is read as far as the network was trained; a gain is divided out before."""
    gap_um = np.repeat([[12.0], [24.0], [24.0]], 9, axis=1)
    gain_rel = np.repeat([[1.0], [1.0], [1.25]], 9, axis=1)
    feet = Feet(3, gap_um=gap_um, gain_rel=gain_rel).tared()
    forces = feet.feed(feet.scan(closure_um))
    assert forces.state.tolist() == states
    valid = forces.state == State.VALID
    real_rel = closure_um / DESIGN.gap_um / gain_rel[valid, 0]
    np.testing.assert_allclose(forces.force_n[valid, 2], 9.0 * real_rel)


@pytest.mark.parametrize("what", ["force", "sigma"])
@pytest.mark.parametrize("number", [np.nan, np.inf, 1.01 * MAX_FORCE_N])
def test_a_force_that_the_network_was_not_trained_for_is_none(what: str, number: float) -> None:
    """A force beyond the training or a sigma of that size is OUT_OF_RANGE: on CAN, in the tally, in the recording."""

    class Hole(SumOfClosures):
        broken = False

        def estimate(self, window: Window) -> LoadEstimate:
            load = super().estimate(window)
            if self.broken:
                (load.force_n if what == "force" else load.sigma_n)[0, 1] = number
            return load

    hole = Hole()
    feet = Feet(estimator=hole).tared()
    hole.broken = True
    forces = feet.feed(feet.scan(2.0))
    assert forces.state.tolist() == [State.OUT_OF_RANGE, State.VALID]
    assert np.isnan(forces.force_n[0]).all()
    assert np.isnan(forces.sigma_n[0]).all()
    assert np.isfinite(forces.force_n[1]).all()


@pytest.mark.parametrize("strength", [1.0, 5.0])
def test_a_contradiction_of_a_moment_widens_sigma_alone(strength: float) -> None:
    """As an impact that one element sees: the state stays, and the force, with a sigma of up to half of the largest."""

    class Strong(SumOfClosures):
        def estimate(self, window: Window) -> LoadEstimate:
            load = super().estimate(window)
            return load._replace(force_n=strength * load.force_n)

    feet = Feet(n_legs=1, estimator=Strong()).tared()
    hit = feet.feed(feet.scan(np.where(np.arange(9) == 4, 15.0, 0.0)[None]))
    assert (hit.sigma_n > hit.force_n).all()
    assert (hit.sigma_n == 0.5 * MAX_FORCE_N).all() == (strength > 1.0)
    for forces in (hit, feet.feed(feet.scan())):
        assert (forces.state.tolist(), forces.cause.tolist()) == ([State.VALID], [Cause.NONE])


def test_an_implausible_reading_in_swing_makes_no_contact() -> None:
    """One element that is read while its line breaks: the force is sent with a sigma of its size, and is no touch."""
    feet = Feet(n_legs=1).tared()
    closure_um = np.zeros((1, 9))
    closure_um[0, 4] = 6.0
    forces = feet.feed(feet.scan(closure_um))
    assert forces.force_n[0, 2] == pytest.approx(0.3)
    assert forces.sigma_n[0, 2] > forces.force_n[0, 2]
    assert forces.flags.tolist() == [Flag.SIMULATED]
    assert feet.feed(feet.scan(5.0)).flags.tolist() == [Flag.SIMULATED | Flag.CONTACT]


def test_what_a_breaking_line_adds_to_the_others_is_no_load() -> None:
    """A floating row raises every reading until all of its elements are known to be open: not even its mean is one."""
    feet = Feet(n_legs=1).tared()
    for _ in range(2):
        scan = feet.scan(2.0)
        scan.capacitance_pf[0, 8] = 0.3
        forces = feet.feed(scan)
        assert (forces.state.tolist(), forces.flags.tolist()) == ([State.STALE], [Flag.SIMULATED])


def test_a_refused_command_keeps_the_baseline_and_says_so() -> None:
    """The old baseline stays in use, the frames carry the flag until a tare succeeds."""
    feet = Feet().tared()
    feet.pipeline.execute(Command(CommandKind.TARE, 1))
    for _ in range(WINDOW):
        forces = feet.feed(feet.scan(3.0))
    assert [(leg, result) for leg, result, _ in feet.outcomes] == [(1, Result.LOADED)]
    assert forces.state.tolist() == [State.VALID, State.VALID]
    in_contact = Flag.SIMULATED | Flag.CONTACT
    assert forces.flags.tolist() == [in_contact, in_contact | Flag.TARE_REFUSED]
    feet.feed(feet.scan(0.02))
    feet.pipeline.execute(Command(CommandKind.TARE, 1))
    for _ in range(WINDOW):
        forces = feet.feed(feet.scan(0.02))
    assert forces.flags.tolist() == [Flag.SIMULATED] * 2
    np.testing.assert_allclose(forces.force_n[1], 0, atol=1e-9)


def test_an_element_that_was_missing_at_the_tare_gets_its_baseline_in_swing() -> None:
    """The leg starts DEGRADED without it, and is VALID soon after it is back."""
    feet = Feet(n_legs=1)
    states = []
    for number in range(40):
        scan = feet.scan()
        if number < 10:
            scan.capacitance_pf[0, 4] = 0.3
        states.append(State(int(feet.feed(scan).state[0])))
    assert [result for _, result, _ in feet.outcomes] == [Result.DONE]
    assert feet.outcomes[0][2].endswith("without elements 4")
    assert states[:5] == [State.STARTING] * 2 + [State.TARING] * 2 + [State.DEGRADED]
    assert states[-1] is State.VALID


def test_stop_and_start_are_executed_at_once() -> None:
    """STOPPED has no value; after START the force is back."""
    feet = Feet().tared()
    outcome = feet.pipeline.execute(Command(CommandKind.STOP, 0))
    assert outcome is not None
    assert outcome.result is Result.DONE
    assert feet.feed(feet.scan()).state.tolist() == [State.STOPPED, State.VALID]
    feet.pipeline.execute(Command(CommandKind.START, 0))
    assert feet.feed(feet.scan()).state.tolist() == [State.VALID, State.VALID]


def test_readings_below_those_of_the_free_foot_are_in_sigma_at_once() -> None:
    """A foot can be pressed, not pulled: 0.4 um less on all elements are 0.18 N that no load makes."""
    feet = Feet().tared()
    pulled = np.zeros((2, 9))
    pulled[0] = -0.4
    forces = feet.feed(feet.scan(pulled))
    assert (forces.sigma_n[0] >= 0.17).all()
    np.testing.assert_array_equal(forces.sigma_n[1], SIGMA_N)


def test_what_nobody_knows_of_a_foot_is_in_sigma_along_its_force_and_across_it() -> None:
    """In proportion to the force, times 1.3, as a foot errs alike in all of them; in the air it is nothing."""
    unknown = (ForceUncertainty(0.2, 0.2), ForceUncertainty(0.3, 0.0))
    feet = Feet(uncertainty=unknown).tared()
    forces = feet.feed(feet.scan(2.0))
    size_n = np.linalg.norm(forces.force_n, axis=1)
    # Both forces lean equally from all axes.
    np.testing.assert_allclose(forces.sigma_n[0], np.hypot(SIGMA_N, 1.3 * 0.2 * size_n[0]))
    np.testing.assert_allclose(forces.sigma_n[1], np.hypot(SIGMA_N, 1.3 * 0.3 * forces.force_n[1]))
    free = Feet(uncertainty=unknown).tared()
    np.testing.assert_allclose(free.feed(free.scan()).sigma_n, np.tile(SIGMA_N, (2, 1)))
