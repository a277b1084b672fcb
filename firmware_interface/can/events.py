"""CAN frames `Fault` (fault report) and `Heartbeat` of a leg.

The fault report is protected as `crc8` describes. The ids are CANopen's, so that a CANopen tool shows an emergency and
a heartbeat; the content of the first is footsense's own.

Source:
    CiA 301, pre-defined connection set and heartbeat protocol.
"""

import struct
from typing import NamedTuple

from firmware_interface.can.codes import Cause, NmtState, State
from firmware_interface.can.crc8 import FrameError, protect
from firmware_interface.can.decoding import enum_member, node_of, unpack_protected

#: CAN ids are these plus the node id.
FAULT_ID = 0x080
HEARTBEAT_ID = 0x700


class Fault(NamedTuple):
    """Decoded `Fault` frame (fault report): a leg's state, element mask or cause has changed.

    Attributes:
        node: CAN node id of the leg, 1..8.
        counter: Sequence counter of the frame, 0..14.
        state: State from now on.
        previous: State until now.
        fault_mask: Bit e set where element e is not usable, 16 bits.
        cause: Cause of the state, as far as it is known.
    """

    node: int
    counter: int
    state: State
    previous: State
    fault_mask: int
    cause: Cause


class Heartbeat(NamedTuple):
    """Decoded `Heartbeat` frame: node, node state, timing flag.

    Attributes:
        node: CAN node id of the leg, 1..8.
        state: State of the node.
        degraded_timing: Whether the service runs without the scheduling that it asked for.
    """

    node: int
    state: NmtState
    degraded_timing: bool


_FAULT_STRUCT = struct.Struct("<BBHB")
_DEGRADED_TIMING = 0x80


def encode_fault(node: int, counter: int, state: int, previous: int, fault_mask: int, cause: int) -> bytes:
    """Return the 6 data bytes of a `Fault` frame.

    ::

        byte    0        1           2         3    4      5
             +-------+-----+-----+------+---+---------+-------+
             | crc8  |state| cnt |  0   |old|  mask   | cause |   mask: 16 bits; of nine elements bits 0..8
             +-------+-----+-----+------+---+---------+-------+
                      7..4  3..0  7..4   3..0

    Example:
        >>> encode_fault(2, 7, State.DEGRADED, State.VALID, 0b1_0000_0001, Cause.ELEMENT_STUCK).hex(" ")
        '59 a7 01 01 01 09'
    """
    return protect(
        FAULT_ID + node, _FAULT_STRUCT.pack(state << 4 | counter, previous, fault_mask & 0xFFFF, cause)
    )


def decode_fault(can_id: int, data: bytes) -> Fault:
    """Return the content of a `Fault` frame, after checking it.

    Raises:
        FrameError: The id, length, crc, counter, a state or the cause is wrong.
    """
    node, counter, (head, previous, fault_mask, code) = unpack_protected(
        can_id, data, FAULT_ID, _FAULT_STRUCT
    )
    state, before = enum_member(State, head >> 4), enum_member(State, previous & 0xF)
    return Fault(node, counter, state, before, fault_mask, enum_member(Cause, code))


def encode_heartbeat(state: NmtState, *, degraded_timing: bool = False) -> bytes:
    """Return the data byte of a `Heartbeat` frame (CANopen format, no CRC).

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
    """Return the content of a `Heartbeat` frame, after checking it.

    Raises:
        FrameError: The id, length or state is wrong.
    """
    node = node_of(can_id, HEARTBEAT_ID)
    try:
        (code,) = data
        return Heartbeat(node, NmtState(code & ~_DEGRADED_TIMING), bool(code & _DEGRADED_TIMING))
    except ValueError:
        raise FrameError(f"{data.hex() or 'nothing'} is no heartbeat of CiA 301") from None
