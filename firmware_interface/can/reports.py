"""CAN frames `Fault` (fault report), `Heartbeat` and `Baseline` of a leg.

Fault report and baseline are protected as `crc8` describes. The ids are CANopen's, so that a CANopen tool shows an
emergency and a heartbeat; other contents are footsense's own. A baseline that tracks temperature takes a force away
from the consumer unseen: the bus carries its offset since the last tare, the time of its last move, and why it holds.

Source:
    CiA 301, pre-defined connection set and heartbeat protocol.
"""

import math
import struct
from typing import NamedTuple

from firmware_interface.can.codes import BaselineStatus, Cause, NmtState, State
from firmware_interface.can.crc8 import FrameError, enum_member, node_of, protect, unpack_protected

#: CAN ids are these plus the node id.
FAULT_ID = 0x080
HEARTBEAT_ID = 0x700
#: As CANopen's default transmit PDO 3.
BASELINE_ID = 0x380


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


class Baseline(NamedTuple):
    """Decoded `Baseline` frame: baseline status, mean and worst drift, age.

    Attributes:
        node: CAN node id of the leg, 1..8.
        counter: Sequence counter of the frame, 0..14.
        status: Status of the baseline tracking, or why it is refused.
        mean_pf: Offset of the baseline since the last tare, mean over the elements [pF]; NaN: no value.
        worst_pf: Offset of the element with the largest [pF]; NaN: no value.
        age_ns: Time since the baseline last moved or was tared [ns], in steps of 0.1 s; None: no baseline; 6553.4 s:
            or more.
    """

    node: int
    counter: int
    status: BaselineStatus
    mean_pf: float
    worst_pf: float
    age_ns: int | None


_BASELINE_STRUCT = struct.Struct("<BhhH")
_OFFSET_CODES_PER_PF = 10_000
_NO_OFFSET = -32768
_MAX_OFFSET = 32767
_AGE_STEP_NS = 100_000_000
_NO_AGE = 0xFFFF


def encode_baseline(
    node: int, counter: int, status: int, mean_pf: float, worst_pf: float, age_ns: int | None
) -> bytes:
    """Return the 8 data bytes of a `Baseline` frame.

    ::

        byte    0        1            2    3       4    5       6    7
             +-------+------+-----+------------+------------+-----------+
             | crc8  |status| cnt | mean int16 | worst int16| age uint16|
             +-------+------+-----+------------+------------+-----------+
                      7..4   3..0

        offsets: 0.1 fF per bit, saturating at +-3276.7 fF; -32768: no value
        age: 0.1 s per bit, rounded up, saturating at 65534; 65535: none

    NaN and a negative age are encoded as no value. Arguments as in `Baseline`.

    Example:
        >>> encode_baseline(1, 0, BaselineStatus.TRACKING, 0.0012, -0.0055, 2_000_000_000).hex(" ")
        'f5 10 0c 00 c9 ff 14 00'
    """
    age = _NO_AGE if age_ns is None or age_ns < 0 else min(-(-age_ns // _AGE_STEP_NS), _NO_AGE - 1)
    payload = _BASELINE_STRUCT.pack(status << 4 | counter, _offset_code(mean_pf), _offset_code(worst_pf), age)
    return protect(BASELINE_ID + node, payload)


def decode_baseline(can_id: int, data: bytes) -> Baseline:
    """Return the content of a `Baseline` frame, after checking it.

    Raises:
        FrameError: The id, length, crc, counter or status is wrong.
    """
    node, counter, (head, mean, worst, age) = unpack_protected(can_id, data, BASELINE_ID, _BASELINE_STRUCT)
    status = enum_member(BaselineStatus, head >> 4)
    age_ns = None if age == _NO_AGE else age * _AGE_STEP_NS
    return Baseline(node, counter, status, _offset_pf(mean), _offset_pf(worst), age_ns)


def _offset_code(offset_pf: float) -> int:
    """Return the code of a drift [pF], clipped; NaN has a code of its own."""
    if math.isnan(offset_pf):
        return _NO_OFFSET
    return round(max(-_MAX_OFFSET, min(_MAX_OFFSET, offset_pf * _OFFSET_CODES_PER_PF)))


def _offset_pf(code: int) -> float:
    """Return the drift of a code [pF]; NaN without a value."""
    return math.nan if code == _NO_OFFSET else code / _OFFSET_CODES_PER_PF
