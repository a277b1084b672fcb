"""Binary formats of Linux CAN sockets: `struct can_frame` (16 bytes), error frames, `struct canfd_frame` (72 bytes).

::

    byte  0      1      2      3      4       5  6  7    8 .. 15
        +---------------------------+--------+---------+----------+
        | id, flags in bits 29..31  | length |  zero   |   data   |
        +---------------------------+--------+---------+----------+

A frame of CAN FD has 64 bytes of data, and byte 5 has its flags: `FD_FRAME`, and `FD_BIT_RATE` to send the data at the
higher bit rate. The two are told apart by their lengths.

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

FD_FRAME_BYTES = 72
#: Flags of a CAN FD frame: it is one; its data are sent at the higher bit rate.
FD_FRAME, FD_BIT_RATE = 0x04, 0x01

_FRAME = struct.Struct("<IB3x8s")
_FD_FRAME = struct.Struct("<IBB2x64s")
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


def pack_fd_frame(can_id: int, data: bytes) -> bytes:
    """Return a `struct canfd_frame` with at most 64 data bytes.

    Example:
        >>> pack_fd_frame(0x159, bytes(64))[:8].hex(" ", 4)
        '59010000 40050000'
    """
    return _FD_FRAME.pack(can_id, len(data), FD_FRAME | FD_BIT_RATE, data)


def unpack_frame(frame: bytes) -> tuple[int, bytes]:
    """Return CAN id (with flag bits) and data of a `struct can_frame` or, by its length, a `struct canfd_frame`.

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
