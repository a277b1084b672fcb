"""CAN frames of the commands to a leg, and of the answers to them.

Both are protected as `crc8` describes. The ids are CANopen's, so that a CANopen tool shows a request and an answer;
their contents are footsense's own.

Source:
    CiA 301, pre-defined connection set.
"""

from typing import Annotated, NamedTuple

from firmware_interface.can.codes import CommandKind, Result
from firmware_interface.can.crc8 import COUNTER_PERIOD, FrameError
from firmware_interface.can.signals import Code, Codec

#: CAN ids are these plus the node id.
COMMAND_ID = 0x200
ANSWER_ID = 0x580

#: Word of each command beside its kind, so that no stray frame is a command.
#: Source: CiA 404 starts an auto-zero by writing "zero" to object 0x6125; the others follow it.
COMMAND_WORDS = {CommandKind.TARE: b"zero", CommandKind.START: b"strt", CommandKind.STOP: b"stop"}

#: Stands for the counter of the command in an answer that no command frame asked for.
UNSOLICITED_COUNTER = COUNTER_PERIOD


class UnknownCommandError(FrameError):
    """A command frame has a valid CRC but an unknown command.

    Attributes:
        kind: Its kind byte.
        counter: Its sequence counter.
    """

    def __init__(self, kind: int, counter: int, word: bytes) -> None:
        super().__init__(f"no command is of kind {kind} with the word {word!r}")
        self.kind = kind
        self.counter = counter


class CommandFrame(NamedTuple):
    """Decoded `Command` frame: command to one leg.

    Attributes:
        node: CAN node id of the leg, 1..8.
        counter: Sequence counter of the frame, 0..14; the answer repeats it.
        kind: The command.
    """

    node: int
    counter: int
    kind: CommandKind


class Answer(NamedTuple):
    """Content of an `Answer` frame: result of a command.

    ::

        byte    0        1            2        3
             +-------+------+-----+------+---+-----+
             | crc8  |result| cnt | kind | 0 | of  |   of: counter of the command, 15: none
             +-------+------+-----+------+---+-----+
                      7..4   3..0         7..4 3..0

    Attributes:
        node: CAN node id of the leg, 1..8.
        counter: Sequence counter of the frame, 0..14.
        result: DONE, or why it was refused.
        command_kind: Kind byte of the command, known or not.
        command_counter: Counter of the command; `UNSOLICITED_COUNTER` for a tare that the service takes by itself.
    """

    node: int
    counter: int
    result: Annotated[Result, Code(12, 4)]
    command_kind: Annotated[int, Code(16, 8)]
    command_counter: Annotated[int, Code(24, 4)]


class _Command(NamedTuple):
    node: int
    counter: int
    kind: Annotated[int, Code(16, 8)]
    word: Annotated[int, Code(32, 32)]


COMMAND = Codec(COMMAND_ID, _Command)
ANSWER = Codec(ANSWER_ID, Answer)


def encode_command(node: int, counter: int, kind: CommandKind) -> bytes:
    """Return the 8 data bytes of a `Command` frame.

    ::

        byte    0        1           2      3      4    5    6    7
             +-------+-----+-----+------+------+-------------------+
             | crc8  |  0  | cnt | kind |  0   |  word, 4 letters  |
             +-------+-----+-----+------+------+-------------------+
                      7..4  3..0

    Example:
        >>> encode_command(1, 0, CommandKind.TARE).hex(" ")
        '98 00 01 00 7a 65 72 6f'
    """
    return COMMAND.encode(_Command(node, counter, kind, int.from_bytes(COMMAND_WORDS[kind], "little")))


def decode_command(can_id: int, data: bytes) -> CommandFrame:
    """Return the content of a `Command` frame, after checking it.

    Raises:
        UnknownCommandError: The crc is right, but kind and word are those of no command.
        FrameError: The id, length, crc or counter is wrong.
    """
    node, counter, code, letters = COMMAND.decode(can_id, data)
    word = letters.to_bytes(4, "little")
    for kind, known in COMMAND_WORDS.items():
        if code == kind and word == known:
            return CommandFrame(node, counter, kind)
    raise UnknownCommandError(code, counter, word)
