"""CAN frames of the commands to a leg, and of the answers to them.

Both are protected as `crc8` describes.
"""

from typing import Annotated, NamedTuple

from firmware_interface.can.codes import CommandKind, Result
from firmware_interface.can.crc8 import COUNTER_PERIOD
from firmware_interface.can.signals import Code, Codec

#: CAN ids are these plus the node id.
COMMAND_ID = 0x110
ANSWER_ID = 0x140

#: Word of each command beside its kind, so that no stray frame is a command.
#: Source: CiA 404 starts an auto-zero by writing "zero" to object 0x6125; the others follow it.
COMMAND_WORDS: dict[int, int] = {
    kind: int.from_bytes(word, "little")
    for kind, word in zip(CommandKind, (b"zero", b"strt", b"stop"), strict=True)
}

#: Stands for the counter of the command in an answer that no command frame asked for.
UNSOLICITED_COUNTER = COUNTER_PERIOD


class CommandFrame(NamedTuple):
    """Content of a `Command` frame (8 bytes): command to one leg.

    ::

        byte    0        1           2      3      4    5    6    7
             +-------+-----+-----+------+------+-------------------+
             | crc8  |  0  | cnt | kind |  0   |  word, 4 letters  |
             +-------+-----+-----+------+------+-------------------+
                      7..4  3..0

    Attributes:
        node: CAN node id of the leg, 1..8.
        counter: Sequence counter of the frame, 0..14; the answer repeats it.
        kind: Kind byte of the command, known or not.
        word: Its word, as a little-endian number.
    """

    node: int
    counter: int
    kind: Annotated[int, Code(16, 8)]
    word: Annotated[int, Code(32, 32)]

    @property
    def is_known(self) -> bool:
        """Whether kind and word are those of a command."""
        return COMMAND_WORDS.get(self.kind) == self.word


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


COMMAND = Codec(COMMAND_ID, CommandFrame)
ANSWER = Codec(ANSWER_ID, Answer)


def encode_command(node: int, counter: int, kind: CommandKind) -> bytes:
    """Return the data bytes of a `Command` frame.

    Example:
        >>> encode_command(1, 0, CommandKind.TARE).hex(" ")
        '67 00 01 00 7a 65 72 6f'
    """
    return COMMAND.encode(CommandFrame(node, counter, kind, COMMAND_WORDS[kind]))
