"""The CAN frames of events: fault report, command, answer, heartbeat.

All but the heartbeat are protected as `crc8` describes. The ids are CANopen's, so that a CANopen tool shows an
emergency, a request, an answer and a heartbeat; the contents of the first three are footsense's own. The file is long
for the drawing of each frame beside its two functions.

Source:
    CiA 301, pre-defined connection set and heartbeat protocol.
"""

import struct
from typing import NamedTuple

from firmware_interface.can_codes import Cause, CommandKind, NmtState, Result, State
from firmware_interface.can_decoding import enum_member, node_of, unpack_protected
from firmware_interface.crc8 import COUNTER_PERIOD, FrameError, protect

#: CAN ids are these plus the node id.
FAULT_ID = 0x080
COMMAND_ID = 0x200
ANSWER_ID = 0x580
HEARTBEAT_ID = 0x700

#: Word of each command beside its kind, so that no stray frame is a command.
#: Source: CiA 404 starts an auto-zero by writing "zero" to object 0x6125; the others follow it.
WORDS = {CommandKind.TARE: b"zero", CommandKind.START: b"strt", CommandKind.STOP: b"stop"}

#: Stands for the counter of the command in an answer that no command frame asked for.
UNSOLICITED = COUNTER_PERIOD


class UnknownCommandError(FrameError):
    """A frame with a valid crc and no known command.

    Attributes:
        kind: Its kind byte.
        counter: Its sequence counter.
    """

    def __init__(self, kind: int, counter: int, word: bytes) -> None:
        super().__init__(f"no command is of kind {kind} with the word {word!r}")
        self.kind = kind
        self.counter = counter


class Fault(NamedTuple):
    """Content of a fault report: the state of a leg, its element mask or its cause has changed.

    Attributes:
        node: CAN node id of the leg, 1..6.
        counter: Sequence counter of the frame, 0..14.
        state: State from now on.
        previous: State until now.
        fault_mask: Bit e set where element e is not usable, 9 bits.
        cause: Cause of the state, as far as it is known.
    """

    node: int
    counter: int
    state: State
    previous: State
    fault_mask: int
    cause: Cause


class Command(NamedTuple):
    """Content of a command to one leg.

    Attributes:
        node: CAN node id of the leg, 1..6.
        counter: Sequence counter of the frame, 0..14; the answer repeats it.
        kind: The command.
    """

    node: int
    counter: int
    kind: CommandKind


class Answer(NamedTuple):
    """Content of an answer: the result of a command.

    Attributes:
        node: CAN node id of the leg, 1..6.
        counter: Sequence counter of the frame, 0..14.
        result: DONE, or why it was refused.
        kind: Kind byte of the command, known or not.
        command_counter: Counter of the command; `UNSOLICITED` for a tare that the service takes by itself.
    """

    node: int
    counter: int
    result: Result
    kind: int
    command_counter: int


class Heartbeat(NamedTuple):
    """Content of a heartbeat frame: node, node state and timing flag.

    Attributes:
        node: CAN node id of the leg, 1..6.
        state: State of the node.
        degraded_timing: Whether the service runs without the scheduling that it asked for.
    """

    node: int
    state: NmtState
    degraded_timing: bool


_FAULT = struct.Struct("<BBHB")
_COMMAND = struct.Struct("<BBB4s")
_ANSWER = struct.Struct("<BBB")
_DEGRADED_TIMING = 0x80


def encode_fault(node: int, counter: int, state: int, previous: int, fault_mask: int, cause: int) -> bytes:
    """Return the 6 data bytes of `Fault`.

    ::

        byte    0        1           2         3    4      5
             +-------+-----+-----+------+---+---------+-------+
             | crc8  |state| cnt |  0   |old|  mask   | cause |   mask: bits 0..8, the others 0
             +-------+-----+-----+------+---+---------+-------+
                      7..4  3..0  7..4   3..0

    Example:
        >>> encode_fault(2, 7, State.DEGRADED, State.VALID, 0b1_0000_0001, Cause.ELEMENT_OPEN).hex(" ")
        'ff a7 01 01 01 07'
    """
    return protect(FAULT_ID + node, _FAULT.pack(state << 4 | counter, previous, fault_mask & 0x1FF, cause))


def decode_fault(can_id: int, data: bytes) -> Fault:
    """Return the content of a `Fault` frame.

    Raises:
        FrameError: The id, length, crc, counter, a state or the cause is wrong.
    """
    node, counter, (head, previous, fault_mask, code) = unpack_protected(can_id, data, FAULT_ID, _FAULT)
    state, before = enum_member(State, head >> 4), enum_member(State, previous & 0xF)
    return Fault(node, counter, state, before, fault_mask & 0x1FF, enum_member(Cause, code))


def encode_command(node: int, counter: int, kind: CommandKind) -> bytes:
    """Return the 8 data bytes of `Command`.

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
    return protect(COMMAND_ID + node, _COMMAND.pack(counter, kind, 0, WORDS[kind]))


def decode_command(can_id: int, data: bytes) -> Command:
    """Return the content of a `Command` frame.

    Raises:
        UnknownCommandError: The crc is right, but kind and word are those of no command.
        FrameError: The id, length, crc or counter is wrong.
    """
    node, counter, (_, code, _, word) = unpack_protected(can_id, data, COMMAND_ID, _COMMAND)
    for kind, known in WORDS.items():
        if code == kind and word == known:
            return Command(node, counter, kind)
    raise UnknownCommandError(code, counter, word)


def encode_answer(node: int, counter: int, result: int, kind: int, command_counter: int) -> bytes:
    """Return the 4 data bytes of `Answer`.

    ::

        byte    0        1            2        3
             +-------+------+-----+------+---+-----+
             | crc8  |result| cnt | kind | 0 |command_counter|   command_counter: counter of the command, 15: none
             +-------+------+-----+------+---+-----+
                      7..4   3..0         7..4 3..0

    Example:
        >>> encode_answer(1, 3, Result.LOADED, CommandKind.TARE, 0).hex(" ")
        '6a 23 01 00'
    """
    return protect(ANSWER_ID + node, _ANSWER.pack(result << 4 | counter, kind, command_counter))


def decode_answer(can_id: int, data: bytes) -> Answer:
    """Return the content of an `Answer` frame.

    Raises:
        FrameError: The id, length, crc, counter or result is wrong.
    """
    node, counter, (head, kind, command_counter) = unpack_protected(can_id, data, ANSWER_ID, _ANSWER)
    return Answer(node, counter, enum_member(Result, head >> 4), kind, command_counter & 0xF)


def encode_heartbeat(state: NmtState, *, degraded_timing: bool = False) -> bytes:
    """Return the data byte of `Heartbeat`, which is CANopen's and has no crc.

    Degraded timing sets the bit that CiA 301 keeps at 0. A CANopen tool then shows no valid state, as intended, or
    the plain state if it masks the bit out, as node guarding does. In normal operation the byte is CANopen's.

    Example:
        >>> encode_heartbeat(NmtState.OPERATIONAL).hex()
        '05'
        >>> encode_heartbeat(NmtState.OPERATIONAL, degraded_timing=True).hex()
        '85'
    """
    return bytes([state | _DEGRADED_TIMING if degraded_timing else state])


def decode_heartbeat(can_id: int, data: bytes) -> Heartbeat:
    """Return the content of a heartbeat.

    Raises:
        FrameError: The id, length or state is wrong.
    """
    node = node_of(can_id, HEARTBEAT_ID)
    try:
        (code,) = data
        return Heartbeat(node, NmtState(code & ~_DEGRADED_TIMING), bool(code & _DEGRADED_TIMING))
    except ValueError:
        raise FrameError(f"{data.hex() or 'nothing'} is no heartbeat of CiA 301") from None
