"""What the journal says of the legs: a line when a leg's state changes, with its cause, and when a tare ends.

A state that flickers would fill the journal, so each leg gets a limited number of lines per minute and the rest is
counted; the wire and the metrics show every change.
"""

import logging

from footsense.frames import EXPECTED, Cause, CommandKind, Cycle, Result, State

_log = logging.getLogger(__name__)

#: What a foot that is not calibrated yet goes through all the time while it is pressed.
_NO_NEWS_ON_TEST_STAND = frozenset({State.VALID, State.DEGRADED, State.SATURATED, State.OUT_OF_RANGE})

_LINES_PER_MINUTE = 10
_MINUTE_NS = 60_000_000_000


class Journal:
    """An observer that logs.

    Args:
        legs: Names of the legs in the order of the frames' rows.
        on_test_stand: Whether a foot is being measured that contradicts its design, which is no news.
    """

    def __init__(self, legs: tuple[str, ...], *, on_test_stand: bool = False) -> None:
        self._legs = legs
        self._no_news = _NO_NEWS_ON_TEST_STAND if on_test_stand else frozenset[State]()
        # What a leg begins with; to get there is no news.
        self._seen = (bytes([State.STARTING] * len(legs)), bytes(len(legs)))
        self._lines = [0] * len(legs)
        self._suppressed = [0] * len(legs)
        self._minute = 0

    def observe(self, cycle: Cycle) -> None:
        """Log what has changed."""
        forces = cycle.forces
        if forces.t_sent_ns // _MINUTE_NS != self._minute:
            self._next_minute(forces.t_sent_ns // _MINUTE_NS)
        seen = (forces.state.tobytes(), forces.cause.tobytes())
        if seen != self._seen:
            self._changed(*seen)
            self._seen = seen
        for outcome in cycle.outcomes:
            level = logging.INFO if outcome.result is Result.DONE else logging.WARNING
            what = CommandKind(outcome.command.kind).name.lower()
            verdict = "done" if outcome.result is Result.DONE else "refused"
            self._line(outcome.command.leg, level, f"{what} {verdict}: {outcome.reason}")

    def close(self) -> None:
        """Say what was left unsaid."""
        self._next_minute(0)

    def _changed(self, states: bytes, causes: bytes) -> None:
        """Log every leg whose state, or what lies behind it, is another than before."""
        rows = zip(self._legs, *self._seen, states, causes, strict=True)
        for leg, (_, state_before, cause_before, state, cause) in enumerate(rows):
            if (state_before, cause_before) != (state, cause) and state not in self._no_news:
                before, now = State(state_before).name.lower(), State(state)
                why = f" ({Cause(cause).name.lower()})" if cause else ""
                # A leg may be valid, and something be wrong with it all the same.
                level = logging.WARNING if cause or now not in EXPECTED else logging.INFO
                self._line(leg, level, f"{before} -> {now.name.lower()}{why}")

    def _line(self, leg: int, level: int, text: str) -> None:
        if self._lines[leg] >= _LINES_PER_MINUTE:
            self._suppressed[leg] += 1
            return
        self._lines[leg] += 1
        _log.log(level, "leg %s: %s", self._legs[leg], text)

    def _next_minute(self, minute: int) -> None:
        self._minute = minute
        for leg, count in enumerate(self._suppressed):
            if count:
                _log.warning("leg %s: %d more changes within the minute", self._legs[leg], count)
            self._lines[leg] = self._suppressed[leg] = 0
