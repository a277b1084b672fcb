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
import struct
from binascii import crc_hqx
from collections.abc import Sequence
from typing import NamedTuple

from firmware_interface.can.codes import USABLE, Flag, State
from firmware_interface.can.crc8 import COUNTER_PERIOD, FrameError, enum_member
from firmware_interface.can.force import ALL_ELEMENTS_MASK, FORCE_ID, Force, Quality

#: The id of `Force` with node 0, which stands for nodes 1 to 6, and with node 9, which stands for nodes 7 and 8.
FORCES_ID, FORCES4_ID = FORCE_ID, FORCE_ID + 9
#: Nodes in each of the frames, in its order.
NODES_OF_FRAME = {FORCES_ID: range(1, 7), FORCES4_ID: range(7, 9)}

_HEADER_STRUCT = struct.Struct("<HBB")
_LEG_STRUCT = struct.Struct("<Ihhh")
#: Data bytes of each of the frames.
DATA_BYTES_OF_FRAME = {
    can_id: _HEADER_STRUCT.size + len(nodes) * _LEG_STRUCT.size for can_id, nodes in NODES_OF_FRAME.items()
}

_NO_FORCE = -32768
_MAX_FORCE = 32767
_FORCE_CODES_PER_N = 1000
_AGE_STEP_NS, _NO_AGE = 500_000, 0xFF
# First bits of the mask and of both standard deviations of a leg.
_MASK_BIT, _SIGMA_XY_BIT, _SIGMA_Z_BIT = 6, 15, 23
_NO_SIGMA, _SIGMA_CODES_PER_N = 0xFF, 250
# Rounds up, except for the rounding error of a whole number of bits.
_CEILING_OFFSET = 1 - 1e-6
_FLAGS_OF_ALL_LEGS = Flag.SIMULATED | Flag.DEGRADED_TIMING


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
    no_sigmas = _NO_SIGMA << _SIGMA_XY_BIT | _NO_SIGMA << _SIGMA_Z_BIT
    slots = dict.fromkeys(NODES_OF_FRAME[can_id], (State.ABSENT | no_sigmas, _NO_FORCE, _NO_FORCE, _NO_FORCE))
    ages_ns = [0]
    in_air, common = True, 0
    for node, leg_ns, code, leg_n, leg_sigma_n, flag, mask in zip(
        nodes, t_ns, state, force_n, sigma_n, flags, fault_mask, strict=True
    ):
        common |= flag & _FLAGS_OF_ALL_LEGS
        known = code in USABLE and all(map(math.isfinite, leg_n))
        in_air = in_air and known and not flag & Flag.CONTACT
        if node not in slots:
            continue
        shown = State.ELEMENT_FAULT if code in USABLE and not known else code
        forces = [_force_code(part_n) if known else _NO_FORCE for part_n in leg_n]
        x_n, y_n, z_n = leg_sigma_n
        widest_n = max(x_n, y_n) if math.isfinite(x_n + y_n) else math.nan
        bits = shown | bool(flag & Flag.CONTACT) << 4 | bool(flag & Flag.TARE_REFUSED) << 5
        bits |= (mask & ALL_ELEMENTS_MASK) << _MASK_BIT
        bits |= _sigma_code(widest_n) << _SIGMA_XY_BIT | _sigma_code(z_n) << _SIGMA_Z_BIT
        slots[node] = (bits, *forces)
        if known:
            ages_ns.append(t_sent_ns - leg_ns if leg_ns else -1)
    age = -(-max(ages_ns) // _AGE_STEP_NS) if min(ages_ns) >= 0 and len(ages_ns) > 1 else _NO_AGE
    head = (
        counter | in_air << 4 | bool(common & Flag.SIMULATED) << 5 | bool(common & Flag.DEGRADED_TIMING) << 6
    )
    payload = _HEADER_STRUCT.pack(0, head, min(age, _NO_AGE))[2:] + b"".join(
        [_LEG_STRUCT.pack(*leg) for leg in slots.values()]
    )
    return _crc16(can_id, payload).to_bytes(2, "little") + payload


def decode_forces(can_id: int, data: bytes) -> Forces:
    """Return the content of a CAN FD `Forces` or `Forces4` frame, after checking it.

    Raises:
        FrameError: The id, length, crc, counter or a state is wrong.
    """
    if len(data) != DATA_BYTES_OF_FRAME.get(can_id):
        raise FrameError(f"frame 0x{can_id:03x} of {len(data)} bytes is no frame of all legs")
    crc, head, age = _HEADER_STRUCT.unpack_from(data)
    if crc != _crc16(can_id, data[2:]):
        raise FrameError(
            f"frame 0x{can_id:03x} has crc 0x{crc:04x} instead of 0x{_crc16(can_id, data[2:]):04x}"
        )
    counter = head & 0xF
    if counter >= COUNTER_PERIOD:
        raise FrameError(f"frame 0x{can_id:03x} has counter {counter}, which is never sent")
    common = (Flag.SIMULATED if head & 0x20 else 0) | (Flag.DEGRADED_TIMING if head & 0x40 else 0)
    age_ns = None if age == _NO_AGE else age * _AGE_STEP_NS
    legs = []
    slots = _LEG_STRUCT.iter_unpack(data[_HEADER_STRUCT.size :])
    for node, (bits, *codes) in zip(NODES_OF_FRAME[can_id], slots, strict=True):
        x_n, y_n, z_n = (math.nan if code == _NO_FORCE else code / _FORCE_CODES_PER_N for code in codes)
        across_n, along_n = _sigma_n(bits >> _SIGMA_XY_BIT), _sigma_n(bits >> _SIGMA_Z_BIT)
        mask = bits >> _MASK_BIT & ALL_ELEMENTS_MASK
        flags = Flag(
            common | (Flag.CONTACT if bits & 0x10 else 0) | (Flag.TARE_REFUSED if bits & 0x20 else 0)
        )
        state = enum_member(State, bits & 0xF)
        own_ns = age_ns if state in USABLE else None
        legs.append(
            (
                Force(node, counter, state, (x_n, y_n, z_n)),
                Quality(node, counter, flags, own_ns, mask, (across_n, across_n, along_n)),
            )
        )
    return Forces(bool(head & 0x10), tuple(legs))


def _crc16(can_id: int, payload: bytes) -> int:
    """Return the CRC-16/CCITT-FALSE of a frame's payload and CAN id."""
    return crc_hqx(payload + can_id.to_bytes(2, "little"), 0xFFFF)


def _sigma_code(sigma_n: float) -> int:
    if not sigma_n >= 0.0:
        return _NO_SIGMA
    return int(min(sigma_n * _SIGMA_CODES_PER_N + _CEILING_OFFSET, _NO_SIGMA - 1))


def _sigma_n(bits: int) -> float:
    code = bits & _NO_SIGMA
    return math.nan if code == _NO_SIGMA else code / _SIGMA_CODES_PER_N


def _force_code(force_n: float) -> int:
    """Return the code of a force component [N], clipped to the range."""
    return round(max(-_MAX_FORCE, min(_MAX_FORCE, force_n * _FORCE_CODES_PER_N)))
