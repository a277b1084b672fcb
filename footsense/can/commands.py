"""Commands received on CAN: checks of which are executed, and the answers to them."""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field

from firmware_interface.can.codes import Result
from firmware_interface.can.commands import (
    ANSWER,
    COMMAND,
    COMMAND_ID,
    UNSOLICITED_COUNTER,
    Answer,
)
from firmware_interface.can.crc8 import FrameError, next_counter
from footsense.can.channel import CanChannel
from footsense.frames import Command, CommandKind, CommandResult
from footsense.ports import Clock

#: The same command with the same counter within this time is a repetition; later, it comes from a restarted consumer.
_REPETITION_WITHIN_NS = 1_000_000_000
#: Most commands to a leg within a second; further ones are counted and not answered.
_MAX_COMMANDS_PER_SECOND = 10
_SECOND_NS = 1_000_000_000


@dataclass(slots=True)
class _LegCommands:
    """State of one leg's commands: the last one, the rate limit, and those without an answer yet."""

    row: int
    node: int
    answer_counter: int = 0
    last_command: tuple[CommandKind, int] | None = None  # kind and counter
    last_command_ns: int = 0
    current_second: int = -1  # in which `n_commands_in_second` arrived
    n_commands_in_second: int = 0
    #: Counters of the commands without an answer of each kind, oldest first.
    pending_counters: defaultdict[CommandKind, list[int]] = field(default_factory=lambda: defaultdict(list))

    def count_and_accept(self, t_ns: int) -> bool:
        """Count a received command, and return whether it is within the limit of commands per second."""
        current_second = t_ns // _SECOND_NS
        self.n_commands_in_second = (
            self.n_commands_in_second + 1 if current_second == self.current_second else 1
        )
        self.current_second = current_second
        return self.n_commands_in_second <= _MAX_COMMANDS_PER_SECOND

    def answer_frame(self, result: int, kind: int, command_counter: int) -> bytes:
        """Return an answer as `struct can_frame`, and advance the answer counter."""
        counter, self.answer_counter = self.answer_counter, next_counter(self.answer_counter)
        return ANSWER.pack(Answer(self.node, counter, Result(result), kind, command_counter))


class CanCommands:
    """Decodes the commands to the legs of one CAN interface, and sends the answers.

    Args:
        channel: The channel.
        nodes: CAN node id of each leg.
        clock: Times the repetitions.

    Attributes:
        unsolicited: Results without a command of a consumer that were not sent yet, by row: the tare after a start.
    """

    def __init__(self, channel: CanChannel, nodes: Sequence[int], clock: Clock) -> None:
        self._channel = channel
        self._clock = clock
        self._legs = [_LegCommands(row, node) for row, node in enumerate(nodes)]
        self._of_id = {COMMAND_ID + leg.node: leg for leg in self._legs}
        self.unsolicited: dict[int, tuple[Result, CommandKind]] = {}

    def decode(self, frames: Sequence[tuple[int, bytes]]) -> list[Command]:
        """Return the valid commands among received frames; count the others as rejected, and answer unknown ones.

        An unknown command is answered at once. A wrong crc, a repeated counter, or more commands than ten a second are
        not: the sender, or whether it sent at all, is uncertain.

        Args:
            frames: CAN id and data of each frame, oldest first.
        """
        commands = []
        for can_id, data in frames:
            leg = self._of_id[can_id]
            now_ns = self._clock.now_ns()
            try:
                frame = COMMAND.decode(can_id, data)
            except FrameError:
                continue
            if not frame.is_known:
                if leg.count_and_accept(now_ns):
                    self._answer(leg, Result.UNKNOWN, frame.kind, frame.counter)
                continue
            kind, counter = CommandKind(frame.kind), frame.counter
            if (kind, counter) == leg.last_command and now_ns - leg.last_command_ns < _REPETITION_WITHIN_NS:
                continue
            if not leg.count_and_accept(now_ns):
                continue
            leg.last_command, leg.last_command_ns = (kind, counter), now_ns
            if counter not in leg.pending_counters[kind]:  # so the list cannot outgrow the counter's range
                leg.pending_counters[kind].append(counter)
            commands.append(Command(kind, leg.row))
        stats = self._channel.stats
        stats.received_commands += len(frames)
        stats.rejected_commands += len(frames) - len(commands)
        return commands

    def answer(self, outcome: CommandResult) -> None:
        """Send a command's result under its leg's answer id, with the command's counter.

        A tare command during a tare restarts it: both end together, and each is answered. A result without a command
        of a consumer waits in `unsolicited`: after a start, all legs are tared at once.
        """
        kind, row = outcome.command
        leg = self._legs[row]
        pending_counters = leg.pending_counters[kind]
        n_ended = len(pending_counters) if kind is CommandKind.TARE else 1
        for counter in pending_counters[:n_ended]:
            self._answer(leg, outcome.result, kind, counter)
        if not pending_counters:
            self.unsolicited[row] = (outcome.result, kind)
        del pending_counters[:n_ended]

    def pop_unsolicited_frames(self, max_frames: int) -> list[bytes]:
        """Return the frames of at most `max_frames` results that no command asked for, and remove these results."""
        return [
            self._legs[row].answer_frame(*self.unsolicited.pop(row), UNSOLICITED_COUNTER)
            for row in list(self.unsolicited)[:max_frames]
        ]

    def _answer(self, leg: _LegCommands, result: int, kind: int, command_counter: int) -> None:
        """Send one answer of a leg."""
        self._channel.send([leg.answer_frame(result, kind, command_counter)], self._clock.now_ns())
