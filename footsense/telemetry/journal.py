"""Log messages about the legs: changes of state, with their cause, and results of commands.

A flickering state would fill the journal, so each leg gets a limited number of lines per minute and the rest is
counted; CAN and the metrics show every change.
"""

import logging

from footsense.frames import FAULT_FREE, Cause, CommandKind, Cycle, Result, State

_log = logging.getLogger(__name__)

#: States that a foot without a calibration keeps changing between while it is pressed.
_UNLOGGED_ON_TEST_STAND = frozenset({State.VALID, State.DEGRADED, State.SATURATED, State.OUT_OF_RANGE})

_MAX_LEG_LINES_PER_MINUTE = 10
_MINUTE_NS = 60_000_000_000


class LegStateLogger:
    """Observer that logs each leg's changes of state and cause, and the results of commands.

    Args:
        legs: Names of the legs in the order of the frames' rows.
        on_test_stand: Whether a foot without a calibration is pressed on a test stand, whose changes are not logged.
    """

    def __init__(self, legs: tuple[str, ...], *, on_test_stand: bool = False) -> None:
        self._legs = legs
        self._unlogged = _UNLOGGED_ON_TEST_STAND if on_test_stand else frozenset[State]()
        # The first state of every leg, which is not logged.
        self._last = (bytes([State.STARTING] * len(legs)), bytes(len(legs)))
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
            level = logging.INFO if outcome.result is Result.DONE else logging.WARNING
            command = CommandKind(outcome.command.kind).name.lower()
            result = "done" if outcome.result is Result.DONE else "refused"
            self._log_line(outcome.command.leg, level, f"{command} {result}: {outcome.reason}")

    def close(self) -> None:
        """Log the number of messages suppressed in the last minute."""
        self._start_minute(0)

    def _log_changes(self, states: bytes, causes: bytes) -> None:
        """Log every leg whose state or cause has changed since the last cycle."""
        rows = zip(self._legs, *self._last, states, causes, strict=True)
        for leg, (_, state_before, cause_before, state, cause) in enumerate(rows):
            if (state_before, cause_before) != (state, cause) and state not in self._unlogged:
                now, reason = State(state), Cause(cause).name.lower()
                change = f"{State(state_before).name.lower()} -> {now.name.lower()}"
                change += f" ({reason})" if cause else ""
                if state == state_before:
                    change = f"{now.name.lower()}: {Cause(cause_before).name.lower()} -> {reason}"
                # A valid leg may have a cause too, such as an element that drifts.
                level = logging.WARNING if cause or now not in FAULT_FREE else logging.INFO
                self._log_line(leg, level, change)

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
                _log.warning("leg %s: %d more changes within the minute", self._legs[leg], count)
            self._lines[leg] = self._suppressed[leg] = 0
