"""Two buses with AD7147 that are out of step, as their chips have to be found one after the other."""

from msgspec.structs import replace

from footsense.config import DEFAULT
from footsense.frames import State
from footsense.sim.scene import Ad7147Effects, load_scene
from footsense.validation.fault_trial import simulate_scene


def test_all_legs_of_two_buses_are_tared_soon_with_a_slow_host() -> None:
    """Chips a quarter off, found after 0.13 s: a fifth of a second later each leg has its force."""
    hanging = load_scene("hanging")
    effects = replace(hanging.effects, ad7147=Ad7147Effects(gain_rel=0.25, offset_rel=0.25))
    walk = simulate_scene(replace(hanging, host_cost_us=150.0, effects=effects), DEFAULT, 0.35)
    assert (walk.state[-1] == State.VALID).all()
