"""Events of a robot as text for the page: gait events, state changes, command results, lost cycles."""

from collections.abc import Sequence

import msgspec

from footsense.frames import (
    FAULT_FREE,
    Cause,
    CommandKind,
    Cycle,
    Flag,
    GaitEventKind,
    Result,
    State,
)
from footsense.leg_words import word_of


class Event(msgspec.Struct, frozen=True):
    """Event of a leg or of the service, as text, with time and severity.

    Attributes:
        t_ns: When it happened, in the time of the frames [ns].
        leg: Row of its leg in the frames; None for the robot as a whole.
        kind: Its kind, one word.
        severity: `info`, `good`, `warning` or `fault`.
        text: The event in words, without the leg.
    """

    t_ns: int
    leg: int | None
    kind: str
    severity: str
    text: str


_GAIT_TEXTS = {
    GaitEventKind.TOUCHDOWN: ("touchdown", "info", "touchdown"),
    GaitEventKind.LIFT_OFF: ("lift-off", "info", "lift-off"),
    GaitEventKind.SLIP: ("slip", "warning", "slips"),
    GaitEventKind.SLIP_END: ("slip", "info", "sticks again"),
}


class EventDetector:
    """Derives the events from successive cycles.

    Args:
        n_legs: Rows of the frames.
    """

    def __init__(self, n_legs: int) -> None:
        self._n_legs = n_legs
        self._present = b"", b"", b""

    def new_events(self, cycle: Cycle) -> list[Event]:
        """Return the events of the next cycle."""
        forces = cycle.forces
        now_ns = forces.t_sent_ns
        events = []
        if forces.gait is not None:
            for event in forces.gait.events:
                kind, level, text = _GAIT_TEXTS[GaitEventKind(event.kind)]
                text += f" (\u00b1{event.sigma_s * 1e3:.1f} ms)" if event.sigma_s > 0 else ""
                events.append(Event(event.t_ns, event.leg, kind, level, text))
        present = forces.state.tobytes(), forces.cause.tobytes(), forces.flags.tobytes()
        if present != self._present:
            events += self._state_changes(now_ns, present)
            self._present = present
        for outcome in cycle.ended_commands:
            command = CommandKind(outcome.command.kind).name.lower()
            is_done = outcome.result is Result.DONE
            text = f"{command} {'done' if is_done else 'refused'}: {outcome.reason}"
            events.append(
                Event(now_ns, outcome.command.leg, "command", "good" if is_done else "warning", text)
            )
        return events

    def _state_changes(self, now_ns: int, present: Sequence[bytes]) -> list[Event]:
        """Return the changes of leg states, causes and timing flags; none in the first cycle."""
        if not self._present[0]:
            return []
        events = []
        for leg in range(self._n_legs):
            state, cause = State(present[0][leg]), Cause(present[1][leg])
            before = State(self._present[0][leg]), Cause(self._present[1][leg])
            if (state, cause) != before:
                level = "good" if state is State.VALID else "info" if state in FAULT_FREE else "fault"
                if state is State.DEGRADED or (cause and level != "fault"):
                    level = "warning"
                text = word_of(state) + (f": {word_of(cause)}" if cause else "")
                events.append(Event(now_ns, leg, "state", level, text))
        degraded, was_degraded = (
            any(flag & Flag.DEGRADED_TIMING for flag in flags) for flags in (present[2], self._present[2])
        )
        if degraded != was_degraded:
            level, text = ("warning", "timing degraded") if degraded else ("good", "timing as requested")
            events.append(Event(now_ns, None, "timing", level, text))
        return events
