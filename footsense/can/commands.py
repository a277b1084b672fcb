"""Commands from CAN: which are to be obeyed, and who is answered."""

from collections.abc import Sequence

from firmware_interface import can_events
from firmware_interface.can_codes import Result
from firmware_interface.crc8 import FrameError, next_counter
from firmware_interface.socketcan import pack_frame
from footsense.can.channel import CanChannel
from footsense.frames import CanStatistics, Command, CommandKind, CommandResult
from footsense.ports import Clock

__all__ = ["CanCommands"]

#: The same command with the same counter within this time is a repetition; later, it is a restarted consumer's.
_REPEAT_NS = 1_000_000_000


class _Asker:
    """What was asked of one leg."""

    def __init__(self, row: int, node: int) -> None:
        self.row = row
        self.node = node
        self.answer_counter = 0
        self.last: tuple[CommandKind, int] | None = None  # its counter
        self.last_ns = 0
        # Counters of the open commands of each kind, oldest first.
        self.open: dict[CommandKind, list[int]] = {kind: [] for kind in CommandKind}


class CanCommands:
    """The commands on one channel.

    Args:
        channel: The channel.
        nodes: CAN node id of each leg.
        clock: Times the repetitions.
        stats: Where the refused are counted.
    """

    def __init__(self, channel: CanChannel, nodes: Sequence[int], clock: Clock, stats: CanStatistics) -> None:
        self._channel = channel
        self._clock = clock
        self._stats = stats
        self._askers = [_Asker(row, node) for row, node in enumerate(nodes)]
        self._unasked: dict[int, tuple[Result, CommandKind]] = {}  # by row, the last outcome
        self._of_id = {can_events.COMMAND_ID + asker.node: asker for asker in self._askers}

    def take(self) -> list[Command]:
        """Return the good commands among the frames that have arrived; the others are counted.

        One that asks for nothing known is answered at once. One with a wrong crc or a repeated counter is
        not: it is not certain who sent it, and whether.
        """
        commands = []
        for can_id, data in self._channel.receive():
            asker = self._of_id[can_id]
            try:
                _, counter, kind = can_events.decode_command(can_id, data)
            except can_events.UnknownCommandError as error:
                self._stats.rejected += 1
                self._answer(asker, Result.UNKNOWN, error.kind, error.counter)
                continue
            except FrameError:
                self._stats.rejected += 1
                continue
            now_ns = self._clock.now_ns()
            if (kind, counter) == asker.last and now_ns - asker.last_ns < _REPEAT_NS:
                self._stats.rejected += 1
                continue
            asker.last, asker.last_ns = (kind, counter), now_ns
            if counter not in asker.open[kind]:  # so the list cannot outgrow the counter's range
                asker.open[kind].append(counter)
            commands.append(Command(kind, asker.row))
        return commands

    def answer(self, outcome: CommandResult) -> None:
        """Send a command's result on its leg's answer id, with the counter of the command.

        A tare that is asked for while one runs begins that one anew: both have one end, and each its answer. What
        nobody asked for waits for `unasked`: after a start, all legs are tared at once.
        """
        kind, row = outcome.command
        asker = self._askers[row]
        asked = asker.open[kind]
        n_ended = len(asked) if kind is CommandKind.TARE else 1
        for counter in asked[:n_ended]:
            self._answer(asker, outcome.result, kind, counter)
        if not asked:
            self._unasked[row] = (outcome.result, kind)
        del asked[:n_ended]

    def unasked(self, room: int) -> list[bytes]:
        """Return what the service did by itself and nobody has been told yet, as at most `room` frames."""
        if not self._unasked:
            return []
        return [
            self._encode(self._askers[row], *self._unasked.pop(row), can_events.UNSOLICITED)
            for row in list(self._unasked)[:room]
        ]

    def _answer(self, asker: _Asker, result: int, kind: int, asked: int) -> None:
        self._channel.send(self._encode(asker, result, kind, asked), self._clock.now_ns())

    @staticmethod
    def _encode(asker: _Asker, result: int, kind: int, asked: int) -> bytes:
        data = can_events.encode_answer(asker.node, asker.answer_counter, result, kind, asked)
        asker.answer_counter = next_counter(asker.answer_counter)
        return pack_frame(can_events.ANSWER_ID + asker.node, data)
