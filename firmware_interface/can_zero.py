"""The CAN frame that tells where a leg's zero stands, once a second; protected as told in `crc8`.

A zero that follows temperature takes a force away from whoever watches the force alone. So what it took, when,
and why it moves no further is on the bus too.

Units:
    Offsets pF, age ns; on the wire 0.1 fF and 0.1 s per bit.
"""

import math
import struct
from typing import NamedTuple

from firmware_interface.can_codes import ZeroStatus
from firmware_interface.can_frames import node_of
from firmware_interface.crc8 import FrameError, check, protect

__all__ = ["ZERO_ID", "Zero", "decode_zero", "encode_zero"]

#: CAN id is this plus the node id, as CANopen's default transmit PDO 3.
ZERO_ID = 0x380


class Zero(NamedTuple):
    """What `Zero` says of one leg.

    Attributes:
        node: CAN node id of the leg, 1..6.
        counter: Running number of the frame, 0..14.
        status: What the tracking does, or why it is refused.
        mean_pf: Mean over the elements of how far the zero has moved since the last tare [pF]; NaN: no value.
        worst_pf: The same of the element that moved farthest [pF]; NaN: no value.
        age_ns: Since the zero last moved or was tared [ns], in steps of 0.1 s; None: there is none; 6553.4 s: or more.
    """

    node: int
    counter: int
    status: ZeroStatus
    mean_pf: float
    worst_pf: float
    age_ns: int | None


_ZERO = struct.Struct("<BhhH")
_PER_PF = 10_000
_NO_OFFSET = -32768
_MAX_OFFSET = 32767

_AGE_NS = 100_000_000
_NO_AGE = 0xFFFF


def encode_zero(
    node: int, counter: int, status: int, mean_pf: float, worst_pf: float, age_ns: int | None
) -> bytes:
    """Return the 8 data bytes of `Zero`.

    ::

        byte    0        1            2    3       4    5       6    7
             +-------+------+-----+------------+------------+-----------+
             | crc8  |status| cnt | mean int16 | worst int16| age uint16|
             +-------+------+-----+------------+------------+-----------+
                      7..4   3..0

        offsets: 0.1 fF per bit, saturating at +-3276.7 fF; -32768: no value
        age: 0.1 s per bit, rounded up, saturating at 65534; 65535: none

    A number that is NaN, and an age that is negative, is no value.

    Example:
        >>> encode_zero(1, 0, ZeroStatus.TRACKING, 0.0012, -0.0055, 2_000_000_000).hex(" ")
        'f5 10 0c 00 c9 ff 14 00'
    """
    age = _NO_AGE if age_ns is None or age_ns < 0 else min(-(-age_ns // _AGE_NS), _NO_AGE - 1)
    payload = _ZERO.pack(status << 4 | counter, _offset_code(mean_pf), _offset_code(worst_pf), age)
    return protect(ZERO_ID + node, payload)


def decode_zero(can_id: int, data: bytes) -> Zero:
    """Return what a `Zero` frame says.

    Raises:
        FrameError: The id, length, crc, counter or status is wrong.
    """
    node = node_of(can_id, ZERO_ID)
    counter = check(can_id, data, 8)
    head, mean, worst, age = _ZERO.unpack_from(data, 1)
    try:
        status = ZeroStatus(head >> 4)
    except ValueError:
        raise FrameError(f"no zero has the status {head >> 4}") from None
    return Zero(
        node=node,
        counter=counter,
        status=status,
        mean_pf=_offset_pf(mean),
        worst_pf=_offset_pf(worst),
        age_ns=None if age == _NO_AGE else age * _AGE_NS,
    )


def _offset_code(offset_pf: float) -> int:
    """Return the 16 bits of an offset."""
    if math.isnan(offset_pf):
        return _NO_OFFSET
    return round(max(-_MAX_OFFSET, min(_MAX_OFFSET, offset_pf * _PER_PF)))


def _offset_pf(code: int) -> float:
    """Return the offset that 16 bits stand for [pF]."""
    return math.nan if code == _NO_OFFSET else code / _PER_PF
