"""Commands to the service, each with a counter of its own, and the answers to them."""

from typing import NamedTuple

from firmware_interface.can_codes import NODE_IDS, CommandKind, Result
from firmware_interface.can_events import ANSWER_ID, COMMAND_ID, decode_answer, encode_command
from firmware_interface.crc8 import FrameError, next_counter

__all__ = ["Commands", "Ended"]


class Ended(NamedTuple):
    """A command that was answered.

    Attributes:
        node: CAN node id of the leg, 1..6.
        kind: What was asked for.
        result: DONE, or why it was refused.
        took_ns: From asking to the answer [ns].
    """

    node: int
    kind: CommandKind
    result: Result
    took_ns: int


class Commands:
    """What was asked of each leg and not answered yet. It has no clock of its own.

    An answer counts if it repeats node, kind and counter of a command that is open. A command that nobody answers
    in time is yours to give up, with `overdue`, and to ask again: that is a new command with a new counter.

    Args:
        first_counter: Counter of the first command to each leg, 0..14. The service takes the same command with the
            same counter within one second for a repetition: who may restart faster than that begins elsewhere.

    Example:
        >>> can_id, data = Commands().ask(1, CommandKind.TARE, now_ns=0)
        >>> hex(can_id), data.hex(" ")
        ('0x201', '98 00 01 00 7a 65 72 6f')
    """

    def __init__(self, first_counter: int = 0) -> None:
        self._counters = dict.fromkeys(NODE_IDS.values(), first_counter)
        self._open: dict[tuple[int, CommandKind, int], int] = {}

    def ask(self, node: int, kind: CommandKind, now_ns: int) -> tuple[int, bytes]:
        """Return CAN id and data of a command, which is open from now on.

        Args:
            node: CAN node id of the leg, 1..6.
            kind: What to do.
            now_ns: The time of sending [ns].
        """
        counter = self._counters[node]
        self._counters[node] = next_counter(counter)
        self._open[node, kind, counter] = now_ns
        return COMMAND_ID + node, encode_command(node, counter, kind)

    def feed(self, can_id: int, data: bytes, now_ns: int) -> Ended | None:
        """Return the command that a frame answers; None if it answers none that is open, or is no answer."""
        if can_id - ANSWER_ID not in self._counters:
            return None
        try:
            answer = decode_answer(can_id, data)
            kind = CommandKind(answer.kind)
        except (FrameError, ValueError):
            return None
        asked_ns = self._open.pop((answer.node, kind, answer.asked), None)
        if asked_ns is None:
            return None
        return Ended(answer.node, kind, answer.result, now_ns - asked_ns)

    def overdue(self, now_ns: int, limit_ns: int) -> list[tuple[int, CommandKind]]:
        """Return node and kind of the commands that nobody answered within `limit_ns`, and give them up."""
        late = [key for key, asked_ns in self._open.items() if now_ns - asked_ns > limit_ns]
        for key in late:
            del self._open[key]
        return [(node, kind) for node, kind, _ in late]
