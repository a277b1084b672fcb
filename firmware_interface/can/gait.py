"""CAN frames `GaitEvent`, `Ground` and `LegMotion` of a leg; protected as `crc8` describes.

An event is sent at once, with the time that has passed since it happened; `Ground` comes ten times a second.
`LegMotion` comes from the gait controller, as often as it likes.

Units:
    Times ns and s, angles rad, accelerations m/s2, ratios 1; on the wire as in the layouts.
"""

from typing import Annotated, NamedTuple

from firmware_interface.can.codes import GaitEventKind, StepPhase
from firmware_interface.can.signals import Age, Code, Codec, LogNumber, Number, SignedNumber, Vector

#: CAN ids are these plus the node id.
GAIT_EVENT_ID = 0x120
LEG_MOTION_ID = 0x130
GROUND_ID = 0x138


class GaitEventFrame(NamedTuple):
    """Content of a `GaitEvent` frame: touchdown, lift-off or slip of a leg.

    ::

        byte    0        1        2    3      4       5
             +-------+----+-----+----------+-------+-----+
             | crc8  |kind| cnt |   age    | sigma | air |   age: 0.1 ms per bit, 65535: none
             +-------+----+-----+----------+-------+-----+   sigma: 0.2 ms per bit, rounded up, 255: none
                      7..4 3..0                     bit 0

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
    kind: Annotated[GaitEventKind, Code(12, 4)]
    age_ns: Annotated[int | None, Age(16, 16, 100_000, nearest=True)]
    sigma_s: Annotated[float, Number(32, 8, 5000, up=True)]
    all_in_air: Annotated[bool, Code(40, 1)]


class Ground(NamedTuple):
    """Content of a `Ground` frame: ground normal and friction below a foot.

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

    Attributes:
        node: CAN node id of the leg, 1..8.
        counter: Sequence counter of the frame, 0..14.
        normal: Unit normal into the foot, x forward, y left, z along the leg; NaN: no value.
        normal_sigma_rad: Standard deviation of its direction [rad]; NaN: no value; 0.315: or more.
        tangential_over_normal: Tangential over normal force [1]; NaN: no value; 2.04: or more.
        tangential_over_normal_sigma: Standard deviation of it [1]; NaN: no value; 0.248: or more.
        friction: Coefficient of friction of the ground, as configured [1]; NaN: not known, and no slip is reported.
    """

    node: int
    counter: int
    normal: Annotated[tuple[float, float, float], Vector(12, 20, SignedNumber(0, 10, 500))]
    normal_sigma_rad: Annotated[float, Number(32, 7, 400, up=True)]
    tangential_over_normal: Annotated[float, Number(39, 9, 250)]
    tangential_over_normal_sigma: Annotated[float, Number(48, 6, 250, up=True)]
    friction: Annotated[float, Number(54, 9, 250)]


class LegMotionFrame(NamedTuple):
    """Content of a `LegMotion` frame (8 bytes), from the gait controller: what it knows of the motion of a leg.

    ::

        bit   0     8     12      16             32      39     50     61  63
              +-----+-----+-------+--------------+-------+------+------+---+
              | crc8| cnt | phase | acceleration | sigma | up x | up y | 0 |
              +-----+-----+-------+--------------+-------+------+------+---+
        bits     8     4      4          16          7      11     11    3

        bit 0 is the least significant of byte 0
        acceleration: 0.01 m/s2 per bit, signed, -32768: no value
        sigma of it: code c is 0.01 m/s2 times 2^(c/8), rounded up; 127: no value, 126: 551 m/s2 or more
        up: 0.001 per bit, signed, -1024: no value; the third component follows from the length of 1

    The frame of the foot is that of the force: x forward, y left, z along the leg towards the body. A foot that rests,
    or moves with constant speed, has the acceleration 0, whatever gravity does; one that is lifted ever faster a
    positive one. A foot upside down, whose z points down, cannot be told.

    Attributes:
        node: CAN node id of the leg, 1..8.
        counter: Sequence counter of the frame, 0..14.
        phase: Planned phase of the step.
        acceleration_m_per_s2: Second derivative of the foot's path, against the ground, along its z [m/s2]; NaN: no
            value.
        sigma_m_per_s2: Standard deviation of it [m/s2]; NaN: no value.
        up: Unit vector against gravity in the frame of the foot; NaN: no value.
    """

    node: int
    counter: int
    phase: Annotated[StepPhase, Code(12, 4)]
    acceleration_m_per_s2: Annotated[float, SignedNumber(16, 16, 100)]
    sigma_m_per_s2: Annotated[float, LogNumber(32, 7, 100)]
    up: Annotated[tuple[float, float, float], Vector(39, 22, SignedNumber(0, 11, 1000))]


GAIT_EVENT = Codec(GAIT_EVENT_ID, GaitEventFrame)
GROUND = Codec(GROUND_ID, Ground)
LEG_MOTION = Codec(LEG_MOTION_ID, LegMotionFrame)
