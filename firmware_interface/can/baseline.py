"""CAN frame `Baseline`: a leg's baseline status and drift, once a second; protected as `crc8` describes.

A baseline that tracks temperature takes a force away from the consumer unseen, so the bus carries its offset since
the last tare, the time of its last move, and why it holds.

Units:
    Offsets pF, age ns; on the wire 0.1 fF and 0.1 s per bit.
"""

import math
import struct
from typing import NamedTuple

from firmware_interface.can.codes import BaselineStatus
from firmware_interface.can.crc8 import protect
from firmware_interface.can.decoding import enum_member, unpack_protected

#: CAN id is this plus the node id, as CANopen's default transmit PDO 3. Source: CiA 301, pre-defined connection set.
BASELINE_ID = 0x380


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
