"""CAN frames `Force` and `Quality`, sent together for each leg; described for other tools in `footsense.dbc`.

Everything is little-endian. Byte 0 and the low nibble of byte 1 protect a frame as `crc8` describes. "No value" has a
code of its own, apart from the code of a number too large for its field, so that neither passes for a measurement.

Units:
    Force and its standard deviation N, age ns, probabilities 1; on the wire as in the layouts.
"""

import math
from collections.abc import Sequence
from typing import Annotated, NamedTuple

from firmware_interface.can.codes import USABLE, Flag, State
from firmware_interface.can.signals import Age, Code, Codec, LogNumber, Number, SignedNumber, Vector

#: CAN ids are these plus the node id.
FORCE_ID = 0x108
QUALITY_ID = 0x118


class Force(NamedTuple):
    """Content of a `Force` frame (8 bytes): state and force of a leg.

    ::

        byte    0        1           2    3      4    5      6    7
             +-------+-----+-----+-----------+-----------+-----------+
             | crc8  |state| cnt | fx  int16 | fy  int16 | fz  int16 |   1 mN per bit, -32768: no value
             +-------+-----+-----+-----------+-----------+-----------+
                      7..4  3..0

    All three components are sent, with the state VALID or DEGRADED, or none: under any other state they are "no
    value", and a force with a component that is NaN or infinite, or without a sigma, is sent as ELEMENT_FAULT. A
    component above 32.767 N saturates there, which is not "no value". Of feet for larger forces every bit, and every
    sigma, stands for `force_step_mn` times as much, on all frames of the robot: the frame `Identity` has it.

    Attributes:
        node: CAN node id of the leg, 1..8.
        counter: Sequence counter of the frame, 0..14.
        state: State of the leg: whether the force may be used.
        force_n: Ground reaction (fx, fy, fz) on the foot in the foot frame [N]; NaN: no value.
    """

    node: int
    counter: int
    state: Annotated[State, Code(12, 4)]
    force_n: Annotated[tuple[float, float, float], Vector(16, 48, SignedNumber(0, 16, 1000))]


class Quality(NamedTuple):
    """Content of a `Quality` frame (8 bytes): flags, age, sigma, contact and hold of the force with the same counter.

    ::

        bit   0     8     12      17      29        36        43        50        57      63
              +-----+-----+-------+-------+---------+---------+---------+---------+-------+
              | crc8| cnt | flags |  age  | sigma x | sigma y | sigma z | contact | holds |
              +-----+-----+-------+-------+---------+---------+---------+---------+-------+
        bits     8     4      5      12        7         7         7         7        7

        bit 0 is the least significant of byte 0
        age: 0.1 ms per bit, 0xFFF: none, negative, or above 409.4 ms
        sigma: code c is 1 mN times 2^(c/8), a step of 9 %; 127: no value, 126: 55.1 N or more
        contact, holds: 0.01 per bit, 127: no value

    Age and sigma are rounded up: a frame never looks younger or more certain than it is.

    Attributes:
        node: CAN node id of the leg, 1..8.
        counter: Sequence counter of the frame, 0..14.
        flags: Properties of the force that do not forbid its use.
        age_ns: From the measurement to the send [ns], in steps of 0.1 ms; None: unknown, or above 409.4 ms.
        sigma_n: Standard deviation of each component [N]; NaN: no value; 55.1: or more.
        contact_probability: Probability that the foot is on the ground [1]; NaN: no value.
        holds: Probability that the foot stands still on the ground [1]; NaN: no value.
    """

    node: int
    counter: int
    flags: Annotated[Flag, Code(12, 5)]
    age_ns: Annotated[int | None, Age(17, 12, 100_000)]
    sigma_n: Annotated[tuple[float, float, float], Vector(29, 21, LogNumber(0, 7, 1000))]
    contact_probability: Annotated[float, Number(50, 7, 100)]
    holds: Annotated[float, Number(57, 7, 100)]


FORCE = Codec(FORCE_ID, Force)
QUALITY = Codec(QUALITY_ID, Quality)


#: What a bit of a force may stand for [mN]; a robot with feet for up to 32 N uses the first.
FORCE_STEPS_MN = (1, 2, 5, 10, 20)

#: Largest force at 1 mN per bit [N].
_MAX_FORCE_N = 32.767
_NO_FORCE_N = (math.nan, math.nan, math.nan)


def force_step_mn(max_n: float) -> int:
    """Return the resolution of the forces on CAN [mN per bit], the finest whose range covers forces up to `max_n`.

    Args:
        max_n: Largest force that the feet's network was trained for [N].

    Example:
        >>> force_step_mn(2.0), force_step_mn(15.0), force_step_mn(187.5)
        (1, 1, 10)
    """
    return next((step for step in FORCE_STEPS_MN if max_n <= step * _MAX_FORCE_N), FORCE_STEPS_MN[-1])


def force_frames(
    nodes: Sequence[int],
    counter: int,
    t_sent_ns: int,
    t_ns: Sequence[int],
    state: Sequence[int],
    force_n: Sequence[Sequence[float]],
    sigma_n: Sequence[Sequence[float]],
    flags: Sequence[int],
    contact_probability: Sequence[float],
    holds: Sequence[float],
) -> list[bytes]:
    """Return each leg's `Force` and then its `Quality` frame, as `struct can_frame`s of 16 bytes.

    Args:
        nodes: CAN node id of each leg, 1..8.
        counter: Sequence counter of all frames, 0..14.
        t_sent_ns: Time of sending [ns].
        t_ns: Time of each leg's measurement [ns]; 0 for none.
        state: State of each leg.
        force_n: Force of each leg [N], shape (legs, 3).
        sigma_n: Its standard deviation [N], shape (legs, 3).
        flags: Flags of each leg.
        contact_probability: Probability of each leg's contact [1]; NaN: not known.
        holds: Probability that each foot stands still on the ground [1], same.

    Example:
        >>> legs = [0], [State.VALID], [(0.5, -0.25, 1.0)], [(0.01, 0.01, 0.02)], [Flag.SIMULATED], [1.0], [0.9]
        >>> force, quality = force_frames([1], 0, 12_300_000, *legs)
        >>> force[8:].hex(" ")
        '63 10 f4 01 06 ff e8 03'
    """
    frames = []
    legs = zip(nodes, t_ns, state, force_n, sigma_n, flags, contact_probability, holds, strict=True)
    for node, leg_ns, leg_state, leg_n, leg_sigma_n, flag, contact, hold in legs:
        shown, shown_n = _sendable_force(leg_state, leg_n, leg_sigma_n)
        frames.append(FORCE.pack((node, counter, shown, shown_n)))
        age_ns = t_sent_ns - leg_ns if leg_ns else None
        frames.append(QUALITY.pack((node, counter, flag, age_ns, leg_sigma_n, contact, hold)))
    return frames


def _sendable_force(
    state: int, force_n: Sequence[float], sigma_n: Sequence[float]
) -> tuple[int, Sequence[float]]:
    """Return state and force as sent: none in unusable states; a fault if not finite or without sigma."""
    if state not in USABLE:
        return state, _NO_FORCE_N
    x_n, y_n, z_n = sigma_n
    if x_n >= 0.0 and y_n >= 0.0 and z_n >= 0.0 and all(map(math.isfinite, force_n)):
        return state, force_n
    return State.ELEMENT_FAULT, _NO_FORCE_N
