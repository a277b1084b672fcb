"""Serial protocol of board `mcu`: records of one leg's scan each, in COBS frames with a CRC.

A record is one scan of one leg, 50 bytes, little endian::

    offset  0        1     2      3      4    6        8      12                    48
         +---------+-----+-------+----+-----+---------+------+---------------------+-------+
         | version | leg | flags | n  | seq | step_us | t_us | n values [aF], int32| crc16 |
         |   u8    | u8  |  u8   | u8 | u16 |   u16   | u32  |     9 x 4 bytes     |  u16  |
         +---------+-----+-------+----+-----+---------+------+---------------------+-------+

    version  1; a record of another version is counted and ignored
    leg      node id as on CAN: 1 lf, 2 lm, 3 lr, 4 rf, 5 rm, 6 rr, 7 l4, 8 r4
    flags    `RecordFlag`; the upper four bits are the place in the order, 0 to 8, at which the scan began
    n        elements, 9; the values are in flat index 3 * row + column, in any order of conversion
    seq      counts the records of a leg, and wraps
    step_us  from the middle of one element's conversion to that of the next; 0 if all are converted together
    t_us     middle of the conversion at that place, in the controller's time, which wraps after 71.6 minutes; the
             legs of one scan agree within half a scan
    values   capacitance, stray included; or -2^31 + the code of `NoValue`
    crc16    CRC-16/CCITT-FALSE (polynomial 0x1021, start 0xFFFF, no reflection, no final value; "123456789" gives
             0x29B1) over all bytes before it

On the line a record is stuffed by COBS, so that no byte of it is zero, and a zero ends it: 52 bytes. After a lost byte,
or a start within a record, a reader is in step again after the next zero (`serial_decoder.py`). Six legs at 200
scans/s are 62 400 bytes/s: 68 % of 921600 bit/s, 8N1.

A converter that runs freely goes through its elements in a ring; a record has the last nine conversions, whichever of
them came first.

**Sending.** Before the records of a scan a controller may say when it begins to send them, in the same header: all
zeros but the time as t_us. Without it the shortest time from the last conversion to the line cannot be known. A byte
`IDENTIFY` asks what it is: the next of these frames has n characters of ASCII in place of the values, at most 60.

Source:
    S. Cheshire and M. Baker, Consistent Overhead Byte Stuffing, IEEE/ACM Trans. Networking 7(2), 1999. CRC by the
    catalogue of R. Cook ("CRC-16/IBM-3740", alias CCITT-FALSE).
"""

import struct
from binascii import crc_hqx
from collections.abc import Sequence
from enum import IntEnum, IntFlag
from typing import NamedTuple

from firmware_interface.can.codes import NODE_IDS

VERSION = 1
ELEMENTS = 9

#: A value below NO_VALUE + N_CODES is no capacitance: NO_VALUE plus a code of `NoValue`.
NO_VALUE_BASE = -(2**31)
N_NO_VALUE_CODES = 16

_HEADER_STRUCT = struct.Struct("<BBBBHHI")
_VALUES_STRUCT = struct.Struct(f"<{ELEMENTS}i")
_CRC_STRUCT = struct.Struct("<H")
_CRC_START = 0xFFFF
_CRC_OFFSET = _HEADER_STRUCT.size + _VALUES_STRUCT.size
_RECORD_BYTES = _CRC_OFFSET + _CRC_STRUCT.size
#: A record on the line without the zero that ends it, and with it.
STUFFED_BYTES = _RECORD_BYTES + 1
FRAME_BYTES = STUFFED_BYTES + 1
#: The same in bits, 8N1.
RECORD_BITS = 10 * FRAME_BYTES

#: Longest record of any version, stuffed; more bytes without a zero are no record.
MAX_STUFFED_BLOCK = 255

_LEGS = frozenset(NODE_IDS.values())


#: Byte that asks a controller what it is: ENQ of ASCII.
IDENTIFY = b"\x05"
_NO_RECORD = 0
_LONGEST_TEXT = 60
#: A `Sending` without text on the line, in bits, 8N1.
SENDING_BITS = 10 * (_HEADER_STRUCT.size + _CRC_STRUCT.size + 2)


class RecordFlag(IntFlag):
    """Flags of a record; bits unknown to this version are zero. Above them is the place at which a scan began."""

    LO_SHU = 1  #: the elements were converted in the order 5 0 7 6 4 2 1 8 3, not 0 to 8
    STARTING = 2  #: one of the first 256 of its leg since the controller's start, at which seq restarts


_BEGAN_AT_SHIFT = 4
_UNUSED_FLAGS = (1 << _BEGAN_AT_SHIFT) - 1 & ~sum(RecordFlag)


def began_at(flags: int) -> int:
    """Return the place in the order of conversion at which a record's scan began, 0 to 15; a valid one ends at 8.

    Example:
        >>> began_at(0x71)
        7
    """
    return flags >> _BEGAN_AT_SHIFT


class NoValue(IntEnum):
    """Reason why an element has no capacitance."""

    NO_ANSWER = 1  #: its converter does not answer
    NOT_READY = 2  #: its conversion had not finished when it was read
    OVER_RANGE = 3  #: it stands at an end of the converter's range
    MISCONFIGURED = (
        4  #: the switches or the converter do not hold their setting, or its reference reads wrong
    )
    BUS_STUCK = 5  #: SDA or SCL of its bus is held low
    WRONG_CHIP = 6  #: another chip answers
    CORRUPT = 7  #: an answer that no healthy chip gives
    UNDER_RANGE = 11  #: it reads nothing at all


class Record(NamedTuple):
    """Readings of one leg in one scan, as sent over the serial port.

    Attributes:
        leg: Node id, 1 to 8.
        seq: Its number, 0 to 65535.
        flags: Order of conversion, whether the controller has just started, and where the scan began (`began_at`).
        step_us: Time from element to element [us], 0 to 65535.
        t_us: Middle of the first conversion in the controller's time [us], 0 to 2^32 - 1.
        values: Capacitance of each element [aF], little endian int32, 36 bytes; not decoded here, which would cost 54
            objects a scan.
    """

    leg: int
    seq: int
    flags: RecordFlag
    step_us: int
    t_us: int
    values: bytes

    def values_af(self) -> tuple[int, ...]:
        """Return the capacitances of the nine elements as integers [aF], shape (9,)."""
        return _VALUES_STRUCT.unpack(self.values)


def encode_record(record: Record) -> bytes:
    """Return a record as the bytes sent over the serial port.

    Raises:
        ValueError: A field does not fit, or there are not nine values.
    """
    if len(record.values) != _VALUES_STRUCT.size:
        raise ValueError(f"a record has {_VALUES_STRUCT.size} bytes of values, not {len(record.values)}")
    try:
        header = _HEADER_STRUCT.pack(
            VERSION, record.leg, record.flags, ELEMENTS, record.seq, record.step_us, record.t_us
        )
    except struct.error as error:
        raise ValueError(f"{record[:5]} does not fit into a record: {error}") from error
    body = header + record.values
    return stuff(body + _CRC_STRUCT.pack(crc_hqx(body, _CRC_START))) + b"\0"


def pack_values(values_af: Sequence[int]) -> bytes:
    """Return nine capacitances [aF] as the bytes of a record."""
    return _VALUES_STRUCT.pack(*values_af)


def stuff(data: bytes) -> bytes:
    """Return at most 253 bytes in COBS encoding: without zeros, each run preceded by its length.

    Example:
        >>> stuff(bytes([0x11, 0, 0, 0x22])).hex()
        '0211010222'
    """
    return b"".join(bytes((len(run) + 1,)) + run for run in data.split(b"\0"))


def unstuff(stuffed: bytes) -> bytes | None:
    """Return the decoded bytes of at most 254 COBS bytes; None if they are not valid COBS.

    Example:
        >>> unstuff(bytes.fromhex("0211010222")) == bytes.fromhex("11000022"), unstuff(b"broken")
        (True, None)
    """
    data, end, at = bytearray(stuffed), len(stuffed), 0
    while at < end:
        length = data[at] or MAX_STUFFED_BLOCK  # a zero is never encoded: it leads past the end
        data[at] = 0
        at += length
    return bytes(data[1:]) if at == end and end else None


class Sending(NamedTuple):
    """What a controller says before the records of a scan.

    Attributes:
        t_us: Time at which it began to send, in its own time [us], 0 to 2^32 - 1.
        text: Its firmware, converters and legs if it was asked; else empty.
    """

    t_us: int
    text: str = ""


def encode_sending(sending: Sending) -> bytes:
    """Return the frame that comes before the records of a scan, as the bytes sent over the serial port."""
    text = sending.text.encode("ascii")
    body = _HEADER_STRUCT.pack(_NO_RECORD, 0, 0, len(text), 0, 0, sending.t_us) + text
    return stuff(body + _CRC_STRUCT.pack(crc_hqx(body, _CRC_START))) + b"\0"


def decode_sending(data: bytes) -> Sending | None:
    """Return what CRC-checked bytes say that come before records; None if they are something else."""
    kind, _, _, n, _, _, t_us = _HEADER_STRUCT.unpack_from(data)
    text = data[_HEADER_STRUCT.size : -_CRC_STRUCT.size]
    if kind != _NO_RECORD or len(text) != n or n > _LONGEST_TEXT or not text.isascii():
        return None
    return Sending(t_us, text.decode("ascii"))


def has_valid_crc(data: bytes) -> bool:
    """Return whether bytes have a header and a correct CRC, as records of all versions do."""
    end = len(data) - _CRC_STRUCT.size
    return (
        end >= _HEADER_STRUCT.size
        and crc_hqx(data[:end], _CRC_START) == _CRC_STRUCT.unpack_from(data, end)[0]
    )


def decode_record(data: bytes) -> Record | None:
    """Return the record of CRC-checked bytes; None for another version, or an unknown leg or flag.

    Raises:
        ValueError: A record of this version has another length.
    """
    version, leg, flags, n, seq, step_us, t_us = _HEADER_STRUCT.unpack_from(data)
    if version != VERSION or leg not in _LEGS or flags & _UNUSED_FLAGS or began_at(flags) >= ELEMENTS:
        return None
    if len(data) != _RECORD_BYTES or n != ELEMENTS:
        raise ValueError(
            f"a record of {len(data)} bytes and {n} elements, not {_RECORD_BYTES} and {ELEMENTS}"
        )
    return Record(leg, seq, RecordFlag(flags), step_us, t_us, data[_HEADER_STRUCT.size : _CRC_OFFSET])
