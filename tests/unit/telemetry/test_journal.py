"""What a person reads of the legs: lines of the journal, and the status line of systemd."""

import logging

import numpy as np
import pytest

from footsense.frames import Cause, Cycle, Flag, State
from footsense.telemetry.journal import LegStateLogger
from footsense.telemetry.systemd import SystemdNotifier
from tests.support.cycles import LEGS, plain_cycle

SECOND_NS = 1_000_000_000


def at(t_s: float, state: State, cause: Cause = Cause.NONE, flags: int = 0) -> Cycle:
    """Return a cycle in which all legs are valid but the second."""
    states, causes = [State.VALID, state, *[State.VALID] * 4], np.zeros(6, np.uint8)
    causes[1] = cause
    return plain_cycle(round(t_s * SECOND_NS), states, cause=causes, flags=np.full(6, flags, np.uint8))


def lines(caplog: pytest.LogCaptureFixture) -> list[str]:
    return [
        f"{record.levelname} {record.getMessage()}"
        for record in caplog.records
        if "lm" in record.getMessage()
    ]


def test_a_change_of_state_or_cause_is_one_line(caplog: pytest.LogCaptureFixture) -> None:
    """It says what was, what is, and why; a state that stays says nothing."""
    caplog.set_level(logging.INFO)
    journal = LegStateLogger(LEGS)
    for cause in (Cause.NO_ANSWER, Cause.NO_ANSWER, Cause.BUS_STUCK):
        journal.observe(at(1, State.ABSENT, cause))
    journal.observe(at(1, State.STARTING))
    assert lines(caplog) == [
        "WARNING leg lm: starting -> absent (no_answer)",
        "WARNING leg lm: absent: no_answer -> bus_stuck",
        "INFO leg lm: absent -> starting",
    ]


def test_a_foot_on_a_bench_contradicts_its_design_in_silence(caplog: pytest.LogCaptureFixture) -> None:
    """That its elements do not fit is why it is there; that it does not answer is told."""
    caplog.set_level(logging.INFO)
    journal = LegStateLogger(LEGS, on_test_stand=True)
    journal.observe(at(0.0, State.VALID))
    journal.observe(at(0.1, State.DEGRADED, Cause.ELEMENT_DRIFTS))
    assert not lines(caplog)
    journal.observe(at(0.2, State.ABSENT, Cause.NO_ANSWER))
    assert lines(caplog) == ["WARNING leg lm: degraded -> absent (no_answer)"]


def test_a_leg_that_flickers_fills_no_journal(caplog: pytest.LogCaptureFixture) -> None:
    """Ten lines a minute, and then how many there would have been."""
    journal = LegStateLogger(LEGS)
    for n in range(30):
        journal.observe(at(1, State.STALE if n % 2 else State.ELEMENT_FAULT))
    journal.observe(at(61, State.STALE))
    journal.close()
    assert len(lines(caplog)) == 11
    assert lines(caplog)[-1] == "WARNING leg lm: 20 more changes within the minute"


class Told(SystemdNotifier):
    """An observer that keeps what systemd would be told."""

    def __init__(self) -> None:
        super().__init__(LEGS, {})
        self.said: list[str] = []

    def send(self, **assignments: str) -> None:
        self.said.append("\n".join(f"{name}={value}" for name, value in assignments.items()))


@pytest.mark.parametrize(
    ("flags", "begins"), [(0, "lf valid"), (Flag.DEGRADED_TIMING, "degraded timing; lf valid")]
)
def test_the_status_line_says_what_was_not_granted(flags: int, begins: str) -> None:
    """`systemctl status` shows it without a look at CAN or the metrics."""
    told = Told()
    told.observe(at(1, State.ABSENT, flags=flags))
    assert told.said == [f"READY=1\nSTATUS={begins}, lm absent, lr valid, rf valid, rm valid, rr valid"]
