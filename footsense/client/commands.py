"""Send commands to the service over CAN with a sequence counter, and match the answers."""

from typing import NamedTuple

from firmware_interface.can.codes import NODE_IDS, CommandKind, Result
from firmware_interface.can.commands import ANSWER, ANSWER_ID, COMMAND_ID, encode_command
from firmware_interface.can.crc8 import FrameError, next_counter


class CommandAnswer(NamedTuple):
    """Answer of the service to a command: result and response time.

    Attributes:
        node: CAN node id of the leg, 1..8.
        kind: The command.
        result: DONE, or why it was refused.
        response_time_ns: From the command to the answer [ns].
    """

    node: int
    kind: CommandKind
    result: Result
    response_time_ns: int


class PendingCommands:
    """Commands to each leg that have not been answered yet.

    An answer counts if it repeats node, kind and counter of a pending command. A command without an answer may be sent
    again, as a new command with a new counter. Times are the caller's.

    Args:
        first_counter: Counter of the first command to each leg, 0..14. The service ignores the same command with the
            same counter within one second as a repetition: a client that may restart faster starts elsewhere.

    Example:
        >>> can_id, data = PendingCommands().encode(1, CommandKind.TARE, now_ns=0)
        >>> hex(can_id), data.hex(" ")
        ('0x111', '67 00 01 00 7a 65 72 6f')
    """

    def __init__(self, first_counter: int = 0) -> None:
        self._counters = dict.fromkeys(NODE_IDS.values(), first_counter)
        self._sent_ns: dict[tuple[int, CommandKind, int], int] = {}

    def encode(self, node: int, kind: CommandKind, now_ns: int) -> tuple[int, bytes]:
        """Return CAN id and data of a new command, and store it as pending.

        Args:
            node: CAN node id of the leg, 1..8.
            kind: The command.
            now_ns: The time of sending [ns].
        """
        counter = self._counters[node]
        self._counters[node] = next_counter(counter)
        self._sent_ns[node, kind, counter] = now_ns
        return COMMAND_ID + node, encode_command(node, counter, kind)

    def feed(self, can_id: int, data: bytes, now_ns: int) -> CommandAnswer | None:
        """Process any CAN frame; if it answers a pending command, return the result, else None.

        Args:
            can_id: Its 11-bit id.
            data: Its bytes.
            now_ns: Time of arrival [ns].
        """
        if can_id - ANSWER_ID not in self._counters:
            return None
        try:
            answer = ANSWER.decode(can_id, data)
            kind = CommandKind(answer.command_kind)
        except (FrameError, ValueError):
            return None
        sent_ns = self._sent_ns.pop((answer.node, kind, answer.command_counter), None)
        if sent_ns is None:
            return None
        return CommandAnswer(answer.node, kind, answer.result, now_ns - sent_ns)
