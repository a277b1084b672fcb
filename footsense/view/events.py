"""Events of a robot as text for the page: gait events, state changes, command results, lost cycles."""

from collections import deque
from collections.abc import Sequence
from itertools import islice

import msgspec

from footsense.frames import (
    FAULT_FREE,
    Cause,
    CommandKind,
    ContactFrame,
    Cycle,
    Flag,
    GaitEventKind,
    Result,
    State,
)
from footsense.leg_words import word_of


class ViewedEvent(msgspec.Struct, frozen=True):
    """Event of a leg or of the service, as the page shows it.

    Attributes:
        t: Time since the first cycle [s].
        leg: Name of its leg; None for the robot as a whole.
        kind: Its kind, one word.
        level: `info`, `good`, `warning` or `fault`.
        text: The event in words, without the leg.
    """

    t: float
    leg: str | None
    kind: str
    level: str
    text: str


_GAIT_TEXTS = {
    GaitEventKind.TOUCHDOWN: ("touchdown", "info", "touchdown"),
    GaitEventKind.LIFT_OFF: ("lift-off", "info", "lift-off"),
    GaitEventKind.SLIP: ("slip", "warning", "slips"),
    GaitEventKind.SLIP_END: ("slip", "info", "sticks again"),
}


class EventLog:
    """Derives the events from successive cycles, and keeps the last ones.

    Args:
        legs: Name of the leg in each row of the frames.
        max_kept: Events that are kept at most.

    Attributes:
        n: Events so far.
    """

    def __init__(self, legs: Sequence[str], max_kept: int) -> None:
        self._legs = legs
        self._kept: deque[ViewedEvent] = deque(maxlen=max_kept)
        self._before: ContactFrame | None = None
        self._first_ns: int | None = None
        self.n = 0

    def time_s(self, t_ns: int) -> float:
        """Return a time of the frames [ns] as time since the first cycle [s]; the first call is that of this cycle."""
        if self._first_ns is None:
            self._first_ns = t_ns
        return (t_ns - self._first_ns) * 1e-9

    def since(self, number: int) -> list[ViewedEvent]:
        """Return the kept events from a number on."""
        if number >= self.n:
            return []
        return list(islice(self._kept, max(0, len(self._kept) - self.n + number), None))

    def add(self, t_ns: int, leg: int | None, kind: str, level: str, text: str) -> None:
        """Add an event.

        Args:
            t_ns: When it happened, in the time of the frames [ns].
            leg: Row of its leg; None for the robot as a whole.
            kind: Its kind, one word.
            level: `info`, `good`, `warning` or `fault`.
            text: The event in words, without the leg.
        """
        name = None if leg is None else self._legs[leg]
        self._kept.append(ViewedEvent(self.time_s(t_ns), name, kind, level, text))
        self.n += 1

    def add_cycle(self, cycle: Cycle) -> None:
        """Add the events of the next cycle."""
        forces = cycle.forces
        for event in forces.gait.events if forces.gait is not None else ():
            kind, level, text = _GAIT_TEXTS[GaitEventKind(event.kind)]
            text += f" (\u00b1{event.sigma_s * 1e3:.1f} ms)" if event.sigma_s > 0 else ""
            self.add(event.t_ns, event.leg, kind, level, text)
        if self._before is not None:
            self._add_changes(self._before, forces)
        self._before = forces
        for outcome in cycle.ended_commands:
            command = CommandKind(outcome.command.kind).name.lower()
            level, result = ("good", "done") if outcome.result is Result.DONE else ("warning", "refused")
            text = f"{command} {result}: {outcome.reason}"
            self.add(forces.t_sent_ns, outcome.command.leg, "command", level, text)

    def _add_changes(self, before: ContactFrame, forces: ContactFrame) -> None:
        """Add the changes of leg states, causes and timing flags."""
        changed = (forces.state != before.state) | (forces.cause != before.cause)
        for leg in changed.nonzero()[0].tolist():
            state, cause = State(int(forces.state[leg])), Cause(int(forces.cause[leg]))
            level = "good" if state is State.VALID else "info" if state in FAULT_FREE else "fault"
            if state is State.DEGRADED or (cause and level != "fault"):
                level = "warning"
            text = word_of(state) + (f": {word_of(cause)}" if cause else "")
            self.add(forces.t_sent_ns, leg, "state", level, text)
        degraded, was_degraded = (
            bool((frame.flags & Flag.DEGRADED_TIMING).any()) for frame in (forces, before)
        )
        if degraded != was_degraded:
            level, text = ("warning", "timing degraded") if degraded else ("good", "timing as requested")
            self.add(forces.t_sent_ns, None, "timing", level, text)
