"""Binary formats of Linux CAN sockets: `struct can_frame` (16 bytes), and error frames.

::

    byte  0      1      2      3      4       5  6  7    8 .. 15
        +---------------------------+--------+---------+----------+
        | id, flags in bits 29..31  | length |  zero   |   data   |
        +---------------------------+--------+---------+----------+

The id has the byte order of the machine, which is little-endian wherever footsense runs.

Source:
    Linux, include/uapi/linux/can.h and can/error.h.
"""

import struct
from enum import IntFlag

FRAME_BYTES = 16

#: Flags beside the id.
EXTENDED = 0x8000_0000
REMOTE = 0x4000_0000
ERROR = 0x2000_0000

_FRAME = struct.Struct("<IB3x8s")
_HEAD = struct.Struct("<IB")


class ErrorClass(IntFlag):
    """Error classes of an error frame: bits of its CAN id."""

    CONTROLLER = 0x004  #: the controller's state has changed, see `data[1]`
    NO_ACKNOWLEDGE = 0x020  #: no node acknowledged
    BUS_OFF = 0x040  #: the controller has left the bus after too many errors
    RESTARTED = 0x100  #: the controller has returned to the bus


#: Bits of `data[1]` of a `CONTROLLER` error frame: error passive as receiver or transmitter; error active again.
CONTROLLER_PASSIVE = 0x10 | 0x20
CONTROLLER_ACTIVE = 0x40


def pack_frame(can_id: int, data: bytes) -> bytes:
    """Return a `struct can_frame` with at most 8 data bytes; `can_id` includes the flag bits.

    Example:
        >>> pack_frame(0x149, bytes([5])).hex(" ", 4)
        '49010000 01000000 05000000 00000000'
    """
    return _FRAME.pack(can_id, len(data), data)


def error_frame(kind: ErrorClass, controller: int = 0) -> bytes:
    """Return an error frame as a CAN driver reports it, with `controller` as `data[1]`."""
    return pack_frame(ERROR | kind, bytes([0, controller, 0, 0, 0, 0, 0, 0]))


def unpack_frame(frame: bytes) -> tuple[int, bytes]:
    """Return CAN id (with flag bits) and data of a `struct can_frame`.

    Example:
        >>> unpack_frame(pack_frame(0x149, b"on"))
        (329, b'on')
    """
    can_id, length = _HEAD.unpack_from(frame)
    return can_id, frame[8 : 8 + length]


def is_standard_data(can_id: int) -> bool:
    """Return whether a CAN id (with flag bits) is that of a data frame with an 11-bit id."""
    return can_id <= 0x7FF


def is_error(can_id: int) -> bool:
    """Return whether a CAN id (with flag bits) is that of an error frame."""
    return bool(can_id & ERROR)
