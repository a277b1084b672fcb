"""CAN frames `GaitEvent`, `Gait` and `Ground` of a leg; protected as `crc8` describes.

An event is sent at once, with the time that has passed since it happened; `Gait` and `Ground` come ten times a second.
The nodes are footsense's own, so that the ids are free: CANopen's second and third receive PDO and fourth transmit PDO.

Units:
    Times ns and s, angles rad, ratios 1; on the wire as in the layouts.
"""

import math
import struct
from collections.abc import Sequence
from typing import NamedTuple

from firmware_interface.can.codes import GaitEventKind, Slip
from firmware_interface.can.crc8 import enum_member, protect, unpack_protected

#: CAN ids are these plus the node id. Source: CiA 301, pre-defined connection set.
GAIT_EVENT_ID = 0x300
GAIT_ID = 0x400
GROUND_ID = 0x480


class GaitEventFrame(NamedTuple):
    """Decoded `GaitEvent` frame: touchdown, lift-off or slip of a leg.

    Attributes:
        node: CAN node id of the leg, 1..8.
        counter: Sequence counter of the leg's events, 0..14.
        kind: What happened.
        age_ns: From the event to the send [ns], in steps of 0.1 ms; None: unknown, or above 6553.4 ms.
        sigma_s: Standard deviation of that time [s]; NaN: no value; 0.0508: or more.
        all_in_air: Whether every leg of the robot is known to be without contact now.
    """

    node: int
    counter: int
    kind: GaitEventKind
    age_ns: int | None
    sigma_s: float
    all_in_air: bool


class Gait(NamedTuple):
    """Decoded `Gait` frame: contact, slip and load share of a leg.

    Attributes:
        node: CAN node id of the leg, 1..8.
        counter: Sequence counter of the frame, 0..14.
        contact: Debounced contact.
        contact_raw: Whether the newest load alone is one of contact.
        all_in_air: Whether every leg of the robot is known to be without contact.
        slip: Whether the foot slides.
        probability: Probability of contact [1]; NaN: no value.
        load_share: Share of the load that all legs carry [1]; NaN: no value.
    """

    node: int
    counter: int
    contact: bool
    contact_raw: bool
    all_in_air: bool
    slip: Slip
    probability: float
    load_share: float


class Ground(NamedTuple):
    """Decoded `Ground` frame: ground normal and friction below a foot.

    Attributes:
        node: CAN node id of the leg, 1..8.
        counter: Sequence counter of the frame, 0..14.
        normal: Unit normal into the foot, x forward, y left, z along the leg; NaN: no value.
        normal_sigma_rad: Standard deviation of its direction [rad]; NaN: no value; 0.315: or more.
        tangential_over_normal: Tangential over normal force [1]; NaN: no value; 2.04: or more.
        tangential_over_normal_sigma: Standard deviation of it [1]; NaN: no value; 0.248: or more.
        friction: Coefficient of friction that the slips of all legs have taught [1]; NaN: not known yet.
    """

    node: int
    counter: int
    normal: tuple[float, float, float]
    normal_sigma_rad: float
    tangential_over_normal: float
    tangential_over_normal_sigma: float
    friction: float


_EVENT_STRUCT = struct.Struct("<BHBB")
_GAIT_STRUCT = struct.Struct("<BBBB")
_GROUND_STRUCT = struct.Struct("<7s")

_AGE_STEP_NS = 100_000
_NO_AGE = 0xFFFF
_EVENT_SIGMA_CODES_PER_S = 5000
_SHARE_CODES_PER_UNIT = 200
_NORMAL_CODES_PER_UNIT = 500
_NO_NORMAL = -512
_NORMAL_SIGMA_CODES_PER_RAD = 400
_FRICTION_CODES_PER_UNIT = 250
_NAN = math.nan
# Rounds up, except for the rounding error of a whole number of bits.
_CEILING_OFFSET = 1 - 1e-6
# Arguments of `_encoded_values`.
_EVENT_FIELDS = ((_EVENT_SIGMA_CODES_PER_S, 0xFF, _CEILING_OFFSET),)
_GAIT_FIELDS = ((_SHARE_CODES_PER_UNIT, 0xFF, 0.5), (_SHARE_CODES_PER_UNIT, 0xFF, 0.5))
_GROUND_FIELDS = (
    (_NORMAL_SIGMA_CODES_PER_RAD, 0x7F, _CEILING_OFFSET),
    (_FRICTION_CODES_PER_UNIT, 0x1FF, 0.5),
    (_FRICTION_CODES_PER_UNIT, 0x3F, _CEILING_OFFSET),
    (_FRICTION_CODES_PER_UNIT, 0x1FF, 0.5),
)


def encode_gait_event(
    node: int, counter: int, kind: int, age_ns: int | None, sigma_s: float, *, all_in_air: bool
) -> bytes:
    """Return the 6 data bytes of a `GaitEvent` frame.

    ::

        byte    0        1        2    3      4       5
             +-------+----+-----+----------+-------+-----+
             | crc8  |kind| cnt |   age    | sigma | air |   age: 0.1 ms per bit, 65535: none
             +-------+----+-----+----------+-------+-----+   sigma: 0.2 ms per bit, rounded up, 255: none
                      7..4 3..0                     bit 0

    Example:
        >>> encode_gait_event(1, 0, GaitEventKind.TOUCHDOWN, 11_200_000, 0.0021, all_in_air=False).hex(" ")
        '0c 10 70 00 0b 00'
    """
    age = _NO_AGE if age_ns is None else round(age_ns / _AGE_STEP_NS)
    if not 0 <= age < _NO_AGE:
        age = _NO_AGE
    (sigma,) = _encoded_values(_EVENT_FIELDS, [sigma_s])
    return protect(GAIT_EVENT_ID + node, _EVENT_STRUCT.pack(kind << 4 | counter, age, sigma, all_in_air))


def decode_gait_event(can_id: int, data: bytes) -> GaitEventFrame:
    """Return the content of a `GaitEvent` frame, after checking it.

    Raises:
        FrameError: The id, length, crc, counter or kind is wrong.
    """
    node, counter, (head, age, sigma, air) = unpack_protected(can_id, data, GAIT_EVENT_ID, _EVENT_STRUCT)
    return GaitEventFrame(
        node,
        counter,
        enum_member(GaitEventKind, head >> 4),
        None if age == _NO_AGE else age * _AGE_STEP_NS,
        _decoded_value(sigma, _EVENT_SIGMA_CODES_PER_S, 0xFF),
        bool(air & 1),
    )


def encode_gait(
    node: int,
    counter: int,
    slip: int,
    probability: float,
    load_share: float,
    *,
    contact: bool,
    contact_raw: bool,
    all_in_air: bool,
) -> bytes:
    """Return the 5 data bytes of a `Gait` frame.

    ::

        byte    0          1           2          3            4
             +-------+----------+-----+------+-------------+-------+
             | crc8  |0 air raw con cnt| slip | probability | share |   0.005 per bit, 255: none
             +-------+----------+-----+------+-------------+-------+
                       6   5   4  3..0  1..0

    Example:
        >>> states = {"contact": True, "contact_raw": True, "all_in_air": False}
        >>> encode_gait(1, 0, Slip.NONE, 1.0, 0.25, **states).hex(" ")
        '1a 30 01 c8 32'
    """
    head = counter | contact << 4 | contact_raw << 5 | all_in_air << 6
    shares = _encoded_values(_GAIT_FIELDS, [probability, load_share])
    return protect(GAIT_ID + node, _GAIT_STRUCT.pack(head, slip, *shares))


def decode_gait(can_id: int, data: bytes) -> Gait:
    """Return the content of a `Gait` frame, after checking it.

    Raises:
        FrameError: The id, length, crc, counter or slip is wrong.
    """
    node, counter, (head, slip, *shares) = unpack_protected(can_id, data, GAIT_ID, _GAIT_STRUCT)
    contact, contact_raw, all_in_air = (bool(head >> bit & 1) for bit in (4, 5, 6))
    probability, load_share = (_decoded_value(code, _SHARE_CODES_PER_UNIT, 0xFF) for code in shares)
    state = enum_member(Slip, slip & 3)
    return Gait(node, counter, contact, contact_raw, all_in_air, state, probability, load_share)


def encode_ground(
    node: int,
    counter: int,
    normal: tuple[float, float, float],
    normal_sigma_rad: float,
    tangential_over_normal: float,
    tangential_over_normal_sigma: float,
    friction: float,
) -> bytes:
    """Return the 8 data bytes of a `Ground` frame; arguments as the fields of `Ground`.

    ::

        bit   0     8     12        22        32           39      48         54       63
              +-----+-----+---------+---------+------------+-------+----------+--------+-+
              | crc8| cnt | normal x| normal y|normal sigma|  use  | use sigma|friction|0|
              +-----+-----+---------+---------+------------+-------+----------+--------+-+
        bits     8     4      10        10          7          9        6         9     1

        bit 0 is the least significant of byte 0
        normal: 0.002 per bit, signed, -512: none; the third component follows from the length of 1
        sigma of it: 2.5 mrad per bit, 127: none; use, its sigma and friction: 0.004 per bit, 511, 63 and 511: none

    Sigmas are rounded up: a frame never looks more certain than it is.

    Example:
        >>> encode_ground(1, 0, (0.1, 0.0, 0.995), 0.03, 0.25, 0.02, math.nan).hex(" ")
        '88 20 03 00 8c 1f c5 7f'
    """
    normal_x, normal_y, _ = [
        round(part * _NORMAL_CODES_PER_UNIT) if -1.0 <= part <= 1.0 else _NO_NORMAL for part in normal
    ]
    normal_sigma, use, use_sigma, coefficient = _encoded_values(
        _GROUND_FIELDS, [normal_sigma_rad, tangential_over_normal, tangential_over_normal_sigma, friction]
    )
    bits = counter | (normal_x & 0x3FF) << 4 | (normal_y & 0x3FF) << 14
    bits |= normal_sigma << 24 | use << 31 | use_sigma << 40 | coefficient << 46
    return protect(GROUND_ID + node, bits.to_bytes(7, "little"))


def decode_ground(can_id: int, data: bytes) -> Ground:
    """Return the content of a `Ground` frame (ground normal, force ratio, friction), after checking it.

    Raises:
        FrameError: The id, length, crc or counter is wrong.
    """
    node, counter, (payload,) = unpack_protected(can_id, data, GROUND_ID, _GROUND_STRUCT)
    bits = int.from_bytes(payload, "little")
    codes = [(bits >> shift & 0x3FF ^ 0x200) - 0x200 for shift in (4, 14)]
    normal_x, normal_y = (_NAN if _NO_NORMAL in codes else code / _NORMAL_CODES_PER_UNIT for code in codes)
    normal_z = math.sqrt(max(1.0 - normal_x * normal_x - normal_y * normal_y, 0.0))
    return Ground(
        node,
        counter,
        (normal_x, normal_y, _NAN if math.isnan(normal_x) else normal_z),
        _decoded_value(bits >> 24 & 0x7F, _NORMAL_SIGMA_CODES_PER_RAD, 0x7F),
        _decoded_value(bits >> 31 & 0x1FF, _FRICTION_CODES_PER_UNIT, 0x1FF),
        _decoded_value(bits >> 40 & 0x3F, _FRICTION_CODES_PER_UNIT, 0x3F),
        _decoded_value(bits >> 46 & 0x1FF, _FRICTION_CODES_PER_UNIT, 0x1FF),
    )


def _encoded_values(fields: Sequence[tuple[int, int, float]], values: Sequence[float]) -> list[int]:
    """Return the unsigned codes of non-negative values, limited to their ranges.

    Args:
        fields: Codes per unit, the code of no value (NaN, and below 0), whose predecessor is that of too much, and what
            is added before the fraction is cut off.
        values: A value for each field.
    """
    return [
        min(int(min(value * per_unit, none) + rounding), none - 1) if value >= 0.0 else none
        for (per_unit, none, rounding), value in zip(fields, values, strict=True)
    ]


def _decoded_value(code: int, per_unit: int, none: int) -> float:
    """Return the value of a code; NaN if it is the code for "no value"."""
    return _NAN if code == none else code / per_unit
