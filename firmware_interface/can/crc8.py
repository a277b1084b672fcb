"""End-to-end protection (CRC and counter) of every CAN frame but the heartbeat: AUTOSAR E2E profile 11, variant A.

A CRC-8 in byte 0 and a sequence counter in the low nibble of byte 1 protect a frame::

    byte    0        1          2 .. 7
         +-------+----+----+---------------+
         | crc8  | hi | cnt|    payload    |
         +-------+----+----+---------------+
                  7..4 3..0

The crc covers the CAN id (low byte first) and every byte behind the crc, so a frame under another leg's id is wrong
too. Every error of one or two bits and every burst of up to eight bits behind the crc is detected; of bursts that
reach into the crc, 5 of 1785 are not, because it stands in front. CAN's own crc comes on top. The counter runs 0, 1,
.. 14, 0; 15 is never sent.

Source:
    AUTOSAR FO R22-11, PRS E2EProtocol, profile 11, data id mode BOTH: polynomial x^8 + x^4 + x^3 + x^2 + 1
    (0x1D). Start and final value of that text cancel out; both are 0 here.
"""

from firmware_interface.can.codes import NODE_IDS

#: Number of values of the counter, 0..14.
COUNTER_PERIOD = 15

_POLYNOMIAL = 0x1D


class FrameError(ValueError):
    """A CAN frame must not be used: wrong length, CRC, counter or code."""


def _crc_of(byte: int) -> int:
    """Return the CRC of a byte."""
    crc = byte
    for _ in range(8):
        crc = (crc << 1 ^ (_POLYNOMIAL if crc & 0x80 else 0)) & 0xFF
    return crc


_TABLE = tuple(map(_crc_of, range(256)))


def crc8(data: bytes, start: int = 0) -> int:
    """Return the CRC-8 of `data`, continued from `start`.

    Example:
        >>> hex(crc8(b"123456789"))
        '0x37'
    """
    crc, table = start, _TABLE
    for byte in data:
        crc = table[crc ^ byte]
    return crc


#: The crc over each 11-bit id, from which the crc of its frames continues.
ID_CRC = bytes(crc8(can_id.to_bytes(2, "little")) for can_id in range(0x800))


def protect(can_id: int, payload: bytes) -> bytes:
    """Return a frame's data: the CRC, then `payload`, whose first low nibble is the counter.

    Example:
        >>> protect(0x0123, bytes(7)).hex()
        'cc00000000000000'
    """
    return bytes([crc8(payload, ID_CRC[can_id])]) + payload


def check_frame_and_get_counter(can_id: int, data: bytes, length: int) -> int:
    """Check a frame's length, CRC and counter; return the counter.

    Raises:
        FrameError: One of the three is wrong.
    """
    if len(data) != length:
        raise FrameError(f"frame 0x{can_id:03x} has {len(data)} bytes instead of {length}")
    expected = crc8(data[1:], ID_CRC[can_id])
    if data[0] != expected:
        raise FrameError(f"frame 0x{can_id:03x} has crc 0x{data[0]:02x} instead of 0x{expected:02x}")
    counter = data[1] & 0xF
    if counter >= COUNTER_PERIOD:
        raise FrameError(f"frame 0x{can_id:03x} has counter {counter}, which is never sent")
    return counter


def next_counter(counter: int) -> int:
    """Return the counter value of the next frame."""
    return (counter + 1) % COUNTER_PERIOD


def kind_and_node(can_id: int) -> tuple[int, int]:
    """Return the two parts of the CAN id of a leg's frame: the id of its kind, and the node id.

    Example:
        >>> kind_and_node(0x10A)
        (264, 2)
    """
    node = (can_id - 1) % len(NODE_IDS) + 1
    return can_id - node, node


def node_of(can_id: int, base: int) -> int:
    """Return the node id contained in a CAN id; raise an error if it has another base id.

    Raises:
        FrameError: The id belongs to another kind of frame, or to a node that is no leg.
    """
    node = can_id - base
    if not 1 <= node <= len(NODE_IDS):
        raise FrameError(f"CAN id 0x{can_id:03x} is not 0x{base:03x} plus a node 1..{len(NODE_IDS)}")
    return node
