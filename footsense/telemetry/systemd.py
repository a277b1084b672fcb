"""The legs for systemd: lines of the log, readiness, watchdog, and a status text.

A flickering state would fill the journal, so each leg gets a limited number of lines per minute and the rest is
counted; CAN and the metrics show every change.

A notification is one datagram to the socket that systemd names in the environment; without that variable, as in a
terminal, nothing is sent. What cannot be delivered is dropped: the loop does not wait for its supervisor.

Source:
    sd_notify(3), sd_watchdog_enabled(3).
"""

import logging
import os
import socket
from collections.abc import Mapping
from contextlib import suppress

from footsense.frames import FAULT_FREE, Cause, CommandKind, Cycle, Flag, Result, State
from footsense.leg_words import word_of
from footsense.ports import Observer

_log = logging.getLogger(__name__)

#: States that a foot without a calibration keeps changing between while it is pressed.
_UNLOGGED_ON_TEST_STAND = frozenset({State.VALID, State.DEGRADED, State.SATURATED, State.OUT_OF_RANGE})

_MAX_LEG_LINES_PER_MINUTE = 10
_MINUTE_NS = 60_000_000_000
_STATUS_PERIOD_NS = 10_000_000_000


class LegStateLogger:
    """Observer that logs each leg's changes of state and cause, and the results of commands.

    Faults and their ends are warnings, the steps between them and those of a healthy start are not.

    Args:
        legs: Names of the legs in the order of the frames' rows.
        on_test_stand: Whether a foot without a calibration is pressed on a test stand, whose changes are not logged.
    """

    def __init__(self, legs: tuple[str, ...], *, on_test_stand: bool = False) -> None:
        self._legs = legs
        self._unlogged = _UNLOGGED_ON_TEST_STAND if on_test_stand else frozenset[State]()
        # The first state of every leg, which is not logged.
        self._last = (bytes([State.STARTING] * len(legs)), bytes(len(legs)))
        self._has_fault = [False] * len(legs)
        self._lines = [0] * len(legs)
        self._suppressed = [0] * len(legs)
        self._minute = 0

    def observe(self, cycle: Cycle) -> None:
        """Log the changes of state and cause and the command results of a cycle."""
        forces = cycle.forces
        if forces.t_sent_ns // _MINUTE_NS != self._minute:
            self._start_minute(forces.t_sent_ns // _MINUTE_NS)
        present = (forces.state.tobytes(), forces.cause.tobytes())
        if present != self._last:
            self._log_changes(*present)
            self._last = present
        for outcome in cycle.ended_commands:
            command = CommandKind(outcome.command.kind).name.lower()
            is_done = outcome.result is Result.DONE
            text = outcome.reason if is_done else f"{command} refused: {outcome.reason}"
            self._log_line(outcome.command.leg, logging.INFO if is_done else logging.WARNING, text)

    def close(self) -> None:
        """Log the number of messages suppressed in the last minute."""
        self._start_minute(0)

    def _log_changes(self, states: bytes, causes: bytes) -> None:
        """Log every leg whose state or cause has changed since the last cycle."""
        rows = zip(self._legs, *self._last, states, causes, strict=True)
        for leg, (_, state_before, cause_before, state, cause) in enumerate(rows):
            if (state_before, cause_before) != (state, cause) and state not in self._unlogged:
                now, reason = State(state), word_of(Cause(cause))
                change = f"{word_of(State(state_before))} -> {word_of(now)}"
                change += f" ({reason})" if cause else ""
                if state == state_before:
                    change = f"{word_of(now)}: {word_of(Cause(cause_before))} -> {reason}"
                # A valid leg may have a cause too, such as an element that drifts.
                is_fault = bool(cause) or now not in FAULT_FREE
                is_end = self._has_fault[leg] and now is State.VALID and not cause
                self._has_fault[leg] = is_fault or (self._has_fault[leg] and not is_end)
                self._log_line(leg, logging.WARNING if is_fault or is_end else logging.INFO, change)

    def _log_line(self, leg: int, level: int, text: str) -> None:
        """Log one message about a leg, unless its limit per minute is reached."""
        if self._lines[leg] >= _MAX_LEG_LINES_PER_MINUTE:
            self._suppressed[leg] += 1
            return
        self._lines[leg] += 1
        _log.log(level, "leg %s: %s", self._legs[leg], text)

    def _start_minute(self, minute: int) -> None:
        """Log how many messages were suppressed, and start counting a new minute."""
        self._minute = minute
        for leg, count in enumerate(self._suppressed):
            if count:
                _log.warning(
                    "leg %s: its state changed %d times more within the minute", self._legs[leg], count
                )
            self._lines[leg] = self._suppressed[leg] = 0


def notification_period_ns(environment: Mapping[str, str] = os.environ) -> int:
    """Return the time between two signs of life [ns]: half of systemd's watchdog timeout; 10 s without a watchdog."""
    is_ours = environment.get("WATCHDOG_PID", str(os.getpid())) == str(os.getpid())  # or of a parent's parent
    timeout_us = environment.get("WATCHDOG_USEC", "")
    if not is_ours or not timeout_us.isdecimal() or int(timeout_us) == 0:
        return _STATUS_PERIOD_NS
    return int(timeout_us) * 1000 // 2


class SystemdNotifier(Observer):
    """Observer that notifies systemd of readiness, life and status; does nothing without systemd.

    Args:
        legs: Name of the leg in each row of the frames.
        environment: Environment with `NOTIFY_SOCKET`: a path, or an abstract socket's name behind an `@`.

    Timing:
        One system call a message, some microseconds; never waits.
    """

    def __init__(self, legs: tuple[str, ...], environment: Mapping[str, str] = os.environ) -> None:
        self._legs = legs
        self._period_ns = notification_period_ns(environment)
        self._said_ns: int | None = None
        address = environment.get("NOTIFY_SOCKET", "")
        self._socket: socket.socket | None = None
        if address.startswith(("/", "@")):
            # Not connected: after systemd has been re-executed, another socket stands at the same address.
            self._address = "\0" + address[1:] if address.startswith("@") else address
            self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC)
            self._socket.setblocking(False)

    def observe(self, cycle: Cycle) -> None:
        """Notify readiness at the first cycle, then signs of life, each with the status."""
        now_ns = cycle.forces.t_sent_ns
        if self._said_ns is None or now_ns - self._said_ns >= self._period_ns:
            sign = "READY" if self._said_ns is None else "WATCHDOG"
            self._said_ns = now_ns
            self.send(**{sign: "1"}, STATUS=self._status_line(cycle))

    def send(self, **assignments: str) -> None:
        """Send assignments such as `READY="1"` as one message; newlines in values become blanks."""
        if self._socket is not None:
            lines = (f"{name}={' '.join(value.split())}" for name, value in assignments.items())
            # Fails while systemd is re-executed or its queue is full; the next message will do.
            with suppress(OSError):
                self._socket.sendto("\n".join(lines).encode(), self._address)

    def close(self) -> None:
        """Notify that the service is stopping; later messages are dropped."""
        self.send(STOPPING="1")
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _status_line(self, cycle: Cycle) -> str:
        """Return the status text: the state of each leg."""
        states = zip(self._legs, cycle.forces.state.tolist(), strict=True)
        status = ", ".join(f"{leg} {word_of(State(state))}" for leg, state in states)
        degraded = any(flags & Flag.DEGRADED_TIMING for flags in cycle.forces.flags.tolist())
        return f"degraded timing; {status}" if degraded else status
