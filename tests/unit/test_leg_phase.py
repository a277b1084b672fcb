"""Phases of the legs' states."""

from firmware_interface.can.codes import USABLE, State
from footsense.leg_phase import LegPhase, phase_of


def test_every_state_has_a_phase_and_forces_come_in_two_of_them() -> None:
    """A new state has to be put somewhere."""
    phases = {state: phase_of(state) for state in State}
    assert {state for state in State if phases[state] in {LegPhase.VALID, LegPhase.DEGRADED}} == USABLE
    assert set(phases.values()) == set(LegPhase)
