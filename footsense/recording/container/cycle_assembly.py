"""Assembly of complete cycles from the MCAP messages of a recording."""

import json
from collections import defaultdict
from dataclasses import dataclass, field
from typing import Any

import msgspec
from mcap.records import Channel, Message

from footsense.frames import CapFrame, Command, CommandResult, ContactFrame, Cycle, Vector
from footsense.recording.container import event_messages, messages
from footsense.recording.container.event_messages import decode_gait, decode_reference
from footsense.ring.cycle_fields import NonNegativeInt64
from footsense.ring.records import LostCycles, NumberedCycle, require_valid


@dataclass(slots=True)
class _CycleMessages:
    """Messages read so far of a cycle that is not complete yet."""

    scan: CapFrame | None = None
    commands: list[Command] = field(default_factory=list)
    outcomes: list[CommandResult] = field(default_factory=list)
    temperature_c: Vector | None = None
    #: Other messages by topic, which their decoders read together.
    other_messages: defaultdict[str, list[bytes]] = field(default_factory=lambda: defaultdict(list))


class CycleAssembly:
    """Assembles cycles from their messages, and detects missing ones.

    Args:
        legs: Name of each row of the frames.

    Attributes:
        n_cycles: Whole cycles so far.
        span_ns: Time from the first to the last of them [ns].
    """

    def __init__(self, legs: tuple[str, ...]) -> None:
        self.n_cycles = 0
        self.span_ns = 0
        self._legs = legs
        self._topics: dict[int, str] = {}
        self._expected = 0
        self._parts = _CycleMessages()
        self._t_first_ns: int | None = None

    def add_record(self, record: Any) -> NumberedCycle | LostCycles | None:  # noqa: ANN401 - the library is not typed
        """Add one MCAP record; return the cycle, or the lost cycles, that it completes, else None."""
        if isinstance(record, Channel):
            self._topics[record.id] = record.topic
        return (
            self._add_message(self._topics[record.channel_id], record)
            if isinstance(record, Message)
            else None
        )

    def _add_message(self, topic: str, message: Message) -> NumberedCycle | LostCycles | None:
        parts = self._parts
        event = json.loads(message.data) if topic == messages.EVENT else {}
        if event.get("event") == "loss":
            self._expected += msgspec.convert(event["n_cycles"], NonNegativeInt64)
        require_valid(message.sequence == self._expected & 0xFFFF_FFFF, "cycles are missing")
        match topic, event.get("event"):
            case messages.EVENT, "loss":
                return LostCycles(self._expected, message.log_time, event["n_cycles"])
            case messages.EVENT, "command":
                parts.commands.append(event_messages.decode_command(event, self._legs))
            case messages.EVENT, "outcome":
                parts.outcomes.append(event_messages.decode_outcome(event, self._legs))
            case messages.EVENT, "temperature":
                parts.temperature_c = event_messages.decode_temperature(event, self._legs)
            case ((messages.REFERENCE | messages.GAIT | messages.GAIT_EVENT), None):
                parts.other_messages[topic].append(message.data)
            case messages.SCAN, None:
                require_valid(parts.scan is None, "forces are missing")
                parts.scan = messages.decode_scan(message.data, self._legs)
            case messages.FORCE, None:
                return self._completed_cycle(messages.decode_force(message.data, self._legs))
        return None

    def _completed_cycle(self, forces: ContactFrame) -> NumberedCycle:
        """Return the cycle that the given force frame completes.

        Raises:
            ValueError: Its scan is missing.
        """
        parts, self._parts = self._parts, _CycleMessages()
        if parts.scan is None:
            raise ValueError("a scan is missing")
        for gait in parts.other_messages[messages.GAIT]:
            events = parts.other_messages[messages.GAIT_EVENT]
            forces = forces._replace(gait=decode_gait(gait, events, self._legs))
        # Every cycle of a test stand's recording has a reference, possibly without samples.
        has_reference = messages.REFERENCE in self._topics.values()
        reference = decode_reference(parts.other_messages[messages.REFERENCE]) if has_reference else None
        cycle = Cycle(
            parts.scan, tuple(parts.commands), forces, tuple(parts.outcomes), reference, parts.temperature_c
        )
        if self._t_first_ns is None:
            self._t_first_ns = forces.t_sent_ns
        self.span_ns = forces.t_sent_ns - self._t_first_ns
        self.n_cycles += 1
        self._expected += 1
        return NumberedCycle(self._expected - 1, cycle)
