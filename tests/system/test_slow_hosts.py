"""Robots on slow hosts: chips that are found one after the other, and scans that take longer."""

from msgspec.structs import replace

from footsense.config import DEFAULT, SMALL_BOARD
from footsense.frames import IS_USABLE_STATE, State
from footsense.sim.scene import Ad7147Effects, load_scene
from footsense.validation.fault_trial import simulate_scene


def test_all_legs_of_two_buses_are_tared_soon_with_a_slow_host() -> None:
    """Chips a quarter off, found after 0.13 s: a fifth of a second later each leg has its force."""
    hanging = load_scene("hanging")
    effects = replace(hanging.effects, ad7147=Ad7147Effects(gain_rel=0.25, offset_rel=0.25))
    walk = simulate_scene(replace(hanging, host_cost_us=150.0, effects=effects), DEFAULT, 0.35)
    assert (walk.state[-1] == State.VALID).all()


def test_a_slow_host_takes_no_force_away() -> None:
    """Six legs on one bus of FDC1004, whose scan takes half a scan more at 150 us a transaction."""
    walk = replace(load_scene("measured_walk"), host_cost_us=150.0)
    walked = simulate_scene(walk, SMALL_BOARD, 3.0)
    in_walk = walked.t_sent_ns > 1.5e9
    assert IS_USABLE_STATE[walked.state[in_walk]].mean() > 0.999
