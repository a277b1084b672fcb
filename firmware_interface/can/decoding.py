"""Checks that all CAN decoders share: id, CRC and counter, codes."""

import struct
from enum import IntEnum
from typing import Any, TypeVar

from firmware_interface.can.codes import NODE_IDS
from firmware_interface.can.crc8 import FrameError, check_frame_and_get_counter

_Code = TypeVar("_Code", bound=IntEnum)


def node_of(can_id: int, base: int) -> int:
    """Return the node id contained in a CAN id; raise an error if it has another base id.

    Raises:
        FrameError: The id belongs to another kind of frame, or to a node that is no leg.
    """
    node = can_id - base
    if not 1 <= node <= len(NODE_IDS):
        raise FrameError(f"CAN id 0x{can_id:03x} is not 0x{base:03x} plus a node 1..{len(NODE_IDS)}")
    return node


def unpack_protected(
    can_id: int, data: bytes, base: int, layout: struct.Struct
) -> tuple[int, int, tuple[Any, ...]]:
    """Check a protected frame; return its node id, counter and fields.

    Args:
        can_id: Its CAN id.
        data: Its bytes.
        base: CAN id of its kind without the node id.
        layout: Layout of the bytes behind the crc; the first field includes the counter.

    Raises:
        FrameError: The id, length, crc or counter is wrong.
    """
    node = node_of(can_id, base)
    return node, check_frame_and_get_counter(can_id, data, layout.size + 1), layout.unpack_from(data, 1)


def enum_member(codes: type[_Code], code: int) -> _Code:
    """Return the enumeration member of a code; raise an error for an unknown code.

    Raises:
        FrameError: There is none.
    """
    try:
        return codes(code)
    except ValueError:
        raise FrameError(f"no {codes.__name__} has the code {code}") from None
