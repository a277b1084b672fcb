"""Words for the states and causes of legs."""

from firmware_interface.can.codes import USABLE, Cause, State
from footsense.frames import Reading
from footsense.leg_words import CAUSE_WORDS, STATE_AND_CAUSE_OF_READING, STATE_WORDS, LegPhase, phase_of


def test_every_state_has_words_and_forces_come_in_two_phases() -> None:
    assert set(STATE_WORDS) == set(State)
    phases = {state: phase_of(state) for state in State}
    assert {state for state in State if phases[state] in {LegPhase.VALID, LegPhase.DEGRADED}} == USABLE
    assert set(phases.values()) == set(LegPhase)


def test_every_cause_that_is_sent_has_a_meaning_and_a_remedy() -> None:
    without = {cause for cause in Cause if not all(CAUSE_WORDS[cause][:2])}
    assert without == {Cause.NONE, Cause.CANNOT_EXCITE, Cause.CALIBRATION_STALE}


def test_a_reading_of_faulty_chips_gives_no_force() -> None:
    of_one_element = {Reading.OK, Reading.OVER_RANGE, Reading.UNDER_RANGE}
    assert set(STATE_AND_CAUSE_OF_READING) == set(Reading) - of_one_element
    assert not {state for state, _ in STATE_AND_CAUSE_OF_READING.values()} & USABLE
