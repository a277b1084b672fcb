"""What systemd and its reader are told: lines of the journal, readiness, watchdog, and the status line."""

import logging
import os
import socket
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from footsense.frames import Cause, Command, CommandKind, CommandResult, Cycle, Flag, Result, State
from footsense.telemetry.systemd import LegStateLogger, SystemdNotifier, notification_period_ns
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
    """It says what was, what is, and why; the end of a fault is told as its beginning, a state that stays is not."""
    caplog.set_level(logging.INFO)
    journal = LegStateLogger(LEGS)
    for cause in (Cause.NO_ANSWER, Cause.NO_ANSWER, Cause.BUS_STUCK):
        journal.observe(at(1, State.ABSENT, cause))
    journal.observe(at(1, State.STARTING))
    for _ in range(2):
        for state in (State.TARING, State.VALID):
            journal.observe(at(1, state))
    assert lines(caplog) == [
        "WARNING leg lm: starting -> absent (no answer)",
        "WARNING leg lm: absent: no answer -> bus stuck",
        "INFO leg lm: absent -> starting",
        "INFO leg lm: starting -> taring",
        "WARNING leg lm: taring -> valid",
        "INFO leg lm: valid -> taring",
        "INFO leg lm: taring -> valid",
    ]


def test_a_refused_command_is_a_warning_and_an_executed_one_is_not(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)
    journal, stop = LegStateLogger(LEGS), Command(CommandKind.STOP, 1)
    for outcome in (
        CommandResult(stop, Result.DONE, "stopped by command"),
        CommandResult(stop, Result.LOADED, "the foot is in contact"),
    ):
        journal.observe(at(1, State.VALID)._replace(ended_commands=(outcome,)))
    assert lines(caplog)[-2:] == [
        "INFO leg lm: stopped by command",
        "WARNING leg lm: stop refused: the foot is in contact",
    ]


def test_a_foot_on_a_bench_contradicts_its_design_in_silence(caplog: pytest.LogCaptureFixture) -> None:
    """That its elements do not fit is why it is there; that it does not answer is told."""
    caplog.set_level(logging.INFO)
    journal = LegStateLogger(LEGS, on_test_stand=True)
    journal.observe(at(0.0, State.VALID))
    journal.observe(at(0.1, State.DEGRADED, Cause.ELEMENT_DRIFTS))
    assert not lines(caplog)
    journal.observe(at(0.2, State.ABSENT, Cause.NO_ANSWER))
    assert lines(caplog) == ["WARNING leg lm: degraded -> absent (no answer)"]


def test_a_leg_that_flickers_fills_no_journal(caplog: pytest.LogCaptureFixture) -> None:
    """Ten lines a minute, and then how many there would have been."""
    journal = LegStateLogger(LEGS)
    for n in range(30):
        journal.observe(at(1, State.STALE if n % 2 else State.ELEMENT_FAULT))
    journal.observe(at(61, State.STALE))
    journal.close()
    assert len(lines(caplog)) == 11
    assert lines(caplog)[-1] == "WARNING leg lm: its state changed 20 times more within the minute"


@pytest.fixture(params=["path", "abstract"])
def systemd(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[tuple[socket.socket, str]]:
    """A socket that listens as systemd does, and the name that it gives to the service."""
    name = str(tmp_path / "notify") if request.param == "path" else f"@footsense-test-{os.getpid()}"
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    listener.bind(name.replace("@", "\0", 1) if name.startswith("@") else name)
    listener.setblocking(False)
    yield listener, name
    listener.close()


def test_each_message_arrives_as_one_datagram(systemd: tuple[socket.socket, str]) -> None:
    """Ready and alive with a status, stopping; a line break cannot forge an assignment."""
    listener, name = systemd
    notifier = SystemdNotifier(LEGS, {"NOTIFY_SOCKET": name, "WATCHDOG_USEC": "2000000"})
    for t_s in (1.0, 1.9, 2.0):
        notifier.observe(at(t_s, State.ABSENT, flags=Flag.DEGRADED_TIMING if t_s == 2.0 else 0))
    notifier.send(STATUS="six legs\nMAINPID=1")
    notifier.close()
    notifier.send(WATCHDOG="1")
    legs = b"lf valid, lm absent, lr valid, rf valid, rm valid, rr valid"
    assert [listener.recv(256) for _ in range(4)] == [
        b"READY=1\nSTATUS=" + legs,
        b"WATCHDOG=1\nSTATUS=degraded timing; " + legs,
        b"STATUS=six legs MAINPID=1",
        b"STOPPING=1",
    ]
    with pytest.raises(BlockingIOError):
        listener.recv(256)


@pytest.mark.parametrize("environment", [{}, {"NOTIFY_SOCKET": ""}, {"NOTIFY_SOCKET": "/nowhere/notify"}])
def test_without_a_listener_nothing_happens(environment: dict[str, str]) -> None:
    """In a terminal, or while systemd is away, the service goes on."""
    notifier = SystemdNotifier(("lf",), environment)
    notifier.send(READY="1")
    notifier.send(WATCHDOG="1")
    notifier.close()


def test_a_full_queue_does_not_stop_the_loop(systemd: tuple[socket.socket, str]) -> None:
    """A systemd that does not read costs messages, not time."""
    _, name = systemd
    notifier = SystemdNotifier(("lf",), {"NOTIFY_SOCKET": name})
    for _ in range(2000):
        notifier.send(WATCHDOG="1")
    notifier.close()


@pytest.mark.parametrize(
    ("environment", "period_ns"),
    [
        ({}, 10 * SECOND_NS),
        ({"WATCHDOG_USEC": "2000000"}, SECOND_NS),
        ({"WATCHDOG_USEC": "2000000", "WATCHDOG_PID": str(os.getpid())}, SECOND_NS),
        ({"WATCHDOG_USEC": "2000000", "WATCHDOG_PID": "1"}, 10 * SECOND_NS),
        ({"WATCHDOG_USEC": "0"}, 10 * SECOND_NS),
        ({"WATCHDOG_USEC": "soon"}, 10 * SECOND_NS),
    ],
)
def test_the_watchdog_is_fed_at_half_its_time(environment: dict[str, str], period_ns: int) -> None:
    """Only a watchdog that is meant for this process counts."""
    assert notification_period_ns(environment) == period_ns
