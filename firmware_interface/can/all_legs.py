"""CAN FD frame `Forces`: forces and contacts of six legs in 64 bytes, in place of `Force` and `Quality`.

::

    byte    0     1      2          3      4 .. 13    ..   54 .. 63
         +-----------+--------+---------+-----------+-----+-----------+
         |   crc16   |hi | cnt|   age   |  leg lf   | ..  |  leg rr   |   age: 0.5 ms per bit, 255: none
         +-----------+--------+---------+-----------+-----+-----------+
                      7..4 3..0

    hi: bit 4 all in air, 5 simulated, 6 degraded timing

    bit of a leg   0      4         5              6       15            23        31     32   48   64
                   +------+---------+--------------+-------+-------------+---------+------+----+----+----+
                   |state | contact | tare refused | mask  |sigma of x, y| sigma z |  0   | fx | fy | fz |
                   +------+---------+--------------+-------+-------------+---------+------+----+----+----+
    bits              4       1            1          9           8           8       1     16   16   16

    sigma: 4 mN per bit, the larger one of x and y, 255: no value, 254: 1.016 N or more
    fx, fy, fz: as in `Force`

Age and sigma are rounded up. A leg that the robot does not have is Absent. A robot that has node 7 or 8 sends `Forces4`
beside it, 24 bytes of the same layout with the fourth legs, l4 and r4.

The crc is that of AUTOSAR E2E profile 5, CRC-16/CCITT-FALSE, over all bytes behind it and the CAN id (low byte first);
profile 11 of the other frames ends at 30 bytes.

Source:
    AUTOSAR FO R22-11, PRS E2EProtocol, profile 5, with the counter of profile 11.
"""

import math
from binascii import crc_hqx
from collections.abc import Sequence
from typing import Annotated, NamedTuple

from firmware_interface.can.codes import USABLE, Flag, State
from firmware_interface.can.crc8 import COUNTER_PERIOD, FrameError
from firmware_interface.can.force import Force, Quality
from firmware_interface.can.signals import Age, Code, Layout, Number, Vector

#: Behind the ids of the frames of single legs.
FORCES_ID, FORCES4_ID = 0x159, 0x15A
#: Nodes in each of the frames, in its order.
NODES_OF_FRAME = {FORCES_ID: range(1, 7), FORCES4_ID: range(7, 9)}

_HEADER_BYTES, _LEG_BYTES = 4, 10
#: Data bytes of each of the frames.
DATA_BYTES_OF_FRAME = {
    can_id: _HEADER_BYTES + len(nodes) * _LEG_BYTES for can_id, nodes in NODES_OF_FRAME.items()
}

_FLAGS_OF_ALL_LEGS = Flag.SIMULATED | Flag.DEGRADED_TIMING


class _Header(NamedTuple):
    counter: Annotated[int, Code(16, 4)]
    all_in_air: Annotated[bool, Code(20, 1)]
    simulated: Annotated[bool, Code(21, 1)]
    degraded_timing: Annotated[bool, Code(22, 1)]
    age_ns: Annotated[int | None, Age(24, 8, 500_000)]


class _Leg(NamedTuple):
    state: Annotated[State, Code(0, 4)]
    contact: Annotated[bool, Code(4, 1)]
    tare_refused: Annotated[bool, Code(5, 1)]
    fault_mask: Annotated[int, Code(6, 9)]
    sigma_xy_n: Annotated[float, Number(15, 8, 250, up=True)]
    sigma_z_n: Annotated[float, Number(23, 8, 250, up=True)]
    force_n: Annotated[tuple[float, float, float], Vector(32, 48, Number(0, 16, 1000, signed=True))]


_HEADER, _LEG = Layout(_Header), Layout(_Leg)
_NO_FORCE = (math.nan, math.nan, math.nan)
_NO_LEG = _Leg(State.ABSENT, False, False, 0, math.nan, math.nan, _NO_FORCE)


class Forces(NamedTuple):
    """Decoded `Forces` frame: force and quality of each leg.

    Attributes:
        all_in_air: Whether every leg of the robot is known to be without contact.
        legs: Content of a `Force` and of a `Quality` of each node of the frame, in the order of the nodes.
    """

    all_in_air: bool
    legs: tuple[tuple[Force, Quality], ...]


def encode_forces(
    can_id: int,
    counter: int,
    t_sent_ns: int,
    nodes: Sequence[int],
    t_ns: Sequence[int],
    state: Sequence[int],
    force_n: Sequence[Sequence[float]],
    sigma_n: Sequence[Sequence[float]],
    flags: Sequence[int],
    fault_mask: Sequence[int],
) -> bytes:
    """Return the data bytes of a `Forces` or `Forces4` frame: force and quality of several legs.

    The other arguments are those of `ForceQualityEncoder.encode`, for all legs of the robot, and the legs' nodes.
    """
    slots = dict.fromkeys(NODES_OF_FRAME[can_id], _NO_LEG)
    ages_ns: list[int] = []
    in_air, common = True, Flag(0)
    for node, leg_ns, code, leg_n, (x_n, y_n, z_n), flag, mask in zip(
        nodes, t_ns, state, force_n, sigma_n, flags, fault_mask, strict=True
    ):
        common |= flag & _FLAGS_OF_ALL_LEGS
        known = code in USABLE and all(map(math.isfinite, leg_n)) and x_n >= 0.0 <= y_n and z_n >= 0.0
        contact = bool(flag & Flag.CONTACT)
        in_air = in_air and known and not contact
        if node not in slots:
            continue
        shown = State.ELEMENT_FAULT if code in USABLE and not known else State(code)
        widest_n = math.nan if math.isnan(x_n + y_n) else max(x_n, y_n)
        refused = bool(flag & Flag.TARE_REFUSED)
        shown_n = leg_n if known else _NO_FORCE
        slots[node] = _Leg(shown, contact, refused, mask, widest_n, z_n, shown_n)
        if known:
            ages_ns.append(t_sent_ns - leg_ns if leg_ns else -1)
    age_ns = max(ages_ns) if ages_ns and min(ages_ns) >= 0 else None
    simulated, degraded_timing = Flag.SIMULATED in common, Flag.DEGRADED_TIMING in common
    head = counter, in_air, simulated, degraded_timing, age_ns
    payload = _HEADER.pack(head).to_bytes(_HEADER_BYTES, "little")[2:] + b"".join(
        [_LEG.pack(leg).to_bytes(_LEG_BYTES, "little") for leg in slots.values()]
    )
    return _crc16(can_id, payload).to_bytes(2, "little") + payload


def decode_forces(can_id: int, data: bytes) -> Forces:
    """Return the content of a CAN FD `Forces` or `Forces4` frame, after checking it.

    Raises:
        FrameError: The id, length, crc, counter or a state is wrong.
    """
    if len(data) != DATA_BYTES_OF_FRAME.get(can_id):
        raise FrameError(f"frame 0x{can_id:03x} of {len(data)} bytes is no frame of all legs")
    crc = int.from_bytes(data[:2], "little")
    if crc != _crc16(can_id, data[2:]):
        raise FrameError(
            f"frame 0x{can_id:03x} has crc 0x{crc:04x} instead of 0x{_crc16(can_id, data[2:]):04x}"
        )
    bits = int.from_bytes(data, "little")
    counter, in_air, simulated, degraded_timing, age_ns = _HEADER.unpack(bits)
    if counter >= COUNTER_PERIOD:
        raise FrameError(f"frame 0x{can_id:03x} has counter {counter}, which is never sent")
    common = Flag.SIMULATED * simulated | Flag.DEGRADED_TIMING * degraded_timing
    legs = []
    for row, node in enumerate(NODES_OF_FRAME[can_id]):
        leg = _Leg._make(_LEG.unpack(bits >> 8 * (_HEADER_BYTES + row * _LEG_BYTES)))
        flags = Flag(common | Flag.CONTACT * leg.contact | Flag.TARE_REFUSED * leg.tare_refused)
        own_ns = age_ns if leg.state in USABLE else None
        sigma_n = leg.sigma_xy_n, leg.sigma_xy_n, leg.sigma_z_n
        force = Force(node, counter, leg.state, leg.force_n)
        legs.append((force, Quality(node, counter, flags, own_ns, leg.fault_mask, sigma_n)))
    return Forces(in_air, tuple(legs))


def _crc16(can_id: int, payload: bytes) -> int:
    """Return the CRC-16/CCITT-FALSE of a frame's payload and CAN id."""
    return crc_hqx(payload + can_id.to_bytes(2, "little"), 0xFFFF)
