"""CAN frames `Force` and `Quality`, sent together for each leg; described for other tools in `footsense.dbc`.

Everything is little-endian. Byte 0 and the low nibble of byte 1 protect a frame as `crc8` describes. "No value" has a
code of its own, apart from the code of a number too large for its field, so that neither passes for a measurement.

Units:
    Force and its standard deviation N, age ns; on the wire 1 mN, 2 mN and 0.1 ms per bit.
"""

import math
import struct
from collections.abc import Sequence
from typing import Annotated, NamedTuple

from firmware_interface.can.codes import USABLE, Flag, State
from firmware_interface.can.crc8 import COLUMN_CRC, ID_CRC, crc8
from firmware_interface.can.signals import CEILING_OFFSET, Age, Code, Codec, Number, Vector
from firmware_interface.can.socketcan import FRAME_BYTES, pack_frame

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
    component above 32.767 N saturates there, which is not "no value". Of feet for larger forces every bit, of sigma
    too, stands for `force_step_mn` times as much, on all frames of the robot: the frame `Identity` tells it.

    Attributes:
        node: CAN node id of the leg, 1..8.
        counter: Sequence counter of the frame, 0..14.
        state: State of the leg: whether the force may be used.
        force_n: Ground reaction (fx, fy, fz) on the foot in the foot frame [N]; NaN: no value.
    """

    node: int
    counter: int
    state: Annotated[State, Code(12, 4)]
    force_n: Annotated[tuple[float, float, float], Vector(16, 48, Number(0, 16, 1000, signed=True))]


class Quality(NamedTuple):
    """Content of a `Quality` frame (8 bytes): flags, age, fault mask and sigma of the force with the same counter.

    ::

        bit   0     8     12      16      28           37        46        55      63
              +-----+-----+-------+-------+------------+---------+---------+---------+
              | crc8| cnt | flags |  age  | fault mask | sigma x | sigma y | sigma z |
              +-----+-----+-------+-------+------------+---------+---------+---------+
        bits     8     4      4      12         9           9         9         9

        bit 0 is the least significant of byte 0
        age: 0.1 ms per bit, 0xFFF: none, negative, or above 409.4 ms
        sigma: 2 mN per bit, 511: no value, 510: 1.02 N or more

    Age and sigma are rounded up: a frame never looks younger or more certain than it is.

    Attributes:
        node: CAN node id of the leg, 1..8.
        counter: Sequence counter of the frame, 0..14.
        flags: Properties of the force that do not forbid its use.
        age_ns: From the measurement to the send [ns], in steps of 0.1 ms; None: unknown, or above 409.4 ms.
        fault_mask: Bit e set where element e is not usable or overloaded, 9 bits.
        sigma_n: Standard deviation of each component [N]; NaN: no value; 1.02: or more.
    """

    node: int
    counter: int
    flags: Annotated[Flag, Code(12, 4)]
    age_ns: Annotated[int | None, Age(16, 12, 100_000)]
    fault_mask: Annotated[int, Code(28, 9)]
    sigma_n: Annotated[tuple[float, float, float], Vector(37, 27, Number(0, 9, 500, up=True))]


FORCE = Codec(FORCE_ID, Force)
QUALITY = Codec(QUALITY_ID, Quality)


#: What a bit of a force may stand for [mN]; a robot with feet for up to 32 N uses the first.
FORCE_STEPS_MN = (1, 2, 5, 10, 20)

_FORCE_STRUCT = struct.Struct("<Bhhh")
_NO_FORCE_N = -32.768
_MAX_FORCE_N = 32.767
_FORCE_CODES_PER_N = 1000

_AGE_STEP_NS = 100_000
_NO_AGE = 0xFFF
_MAX_AGE_NS = (_NO_AGE - 1) * _AGE_STEP_NS

#: Fault mask with the bits of all nine elements set.
ALL_ELEMENTS_MASK = 0x1FF
# First bits of the mask and of the three standard deviations, each of which has so many bits.
_MASK_BIT, _SIGMA_BIT, _SIGMA_BITS = 20, 29, 9
_NO_SIGMA, _SIGMA_CODES_PER_N = 0x1FF, 500
_MAX_SIGMA_N = (_NO_SIGMA - 1) / _SIGMA_CODES_PER_N


def force_step_mn(max_n: float) -> int:
    """Return the resolution of the forces on CAN [mN per bit], the finest whose range covers forces up to `max_n`.

    Args:
        max_n: Largest force that the feet's network was trained for [N].

    Example:
        >>> force_step_mn(2.0), force_step_mn(15.0), force_step_mn(187.5)
        (1, 1, 10)
    """
    return next((step for step in FORCE_STEPS_MN if max_n <= step * _MAX_FORCE_N), FORCE_STEPS_MN[-1])


class ForceQualityEncoder:
    """Encoder of the `Force` and `Quality` frames of several legs in one pass.

    Six legs make twelve frames, up to once a conversion. One call encodes them all, and the crcs are looked up for one
    byte of all frames at a time.

    Args:
        nodes: CAN node id of each leg, 1..8.
    """

    def __init__(self, nodes: Sequence[int]) -> None:
        can_ids = [base + node for node in nodes for base in (FORCE_ID, QUALITY_ID)]
        self._frames = bytearray(b"".join(pack_frame(can_id, bytes(8)) for can_id in can_ids))
        self._n_frames = len(can_ids)
        self._id_crcs = int.from_bytes(bytes(crc8(bytes(7), ID_CRC[can_id]) for can_id in can_ids), "little")

    def encode(
        self,
        counter: int,
        t_sent_ns: int,
        t_ns: Sequence[int],
        state: Sequence[int],
        force_n: Sequence[Sequence[float]],
        sigma_n: Sequence[Sequence[float]],
        flags: Sequence[int],
        fault_mask: Sequence[int],
    ) -> list[bytes]:
        """Return each leg's `Force` and then its `Quality` frame, as `struct can_frame`s of 16 bytes.

        Args:
            counter: Sequence counter of all frames, 0..14.
            t_sent_ns: Time of sending [ns].
            t_ns: Time of each leg's measurement [ns]; 0 for none.
            state: State of each leg.
            force_n: Force of each leg [N], shape (legs, 3).
            sigma_n: Its standard deviation [N], shape (legs, 3).
            flags: Flags of each leg.
            fault_mask: Unusable elements of each leg.

        Timing:
            12 us for six legs.

        Example:
            >>> legs = [0], [State.VALID], [(0.5, -0.25, 1.0)], [(0.01, 0.01, 0.02)], [Flag.SIMULATED], [0]
            >>> force, quality = ForceQualityEncoder([1]).encode(0, 12_300_000, *legs)
            >>> force[8:].hex(" ")
            '63 10 f4 01 06 ff e8 03'
        """
        frames = self._frames
        at = 8
        legs = zip(t_ns, state, force_n, sigma_n, flags, fault_mask, strict=True)
        for leg_t_ns, code, (x_n, y_n, z_n), sigmas_n, flag, mask in legs:
            sigma_x_n, sigma_y_n, sigma_z_n = sigmas_n
            if not (
                -_MAX_FORCE_N <= x_n <= _MAX_FORCE_N
                and -_MAX_FORCE_N <= y_n <= _MAX_FORCE_N
                and -_MAX_FORCE_N <= z_n <= _MAX_FORCE_N
                and code in USABLE
                and sigma_x_n >= 0.0
                and sigma_y_n >= 0.0
                and sigma_z_n >= 0.0
            ):
                code, x_n, y_n, z_n = _sendable_force(code, (x_n, y_n, z_n), sigmas_n)  # noqa: PLW2901
            x, y, z = (
                round(x_n * _FORCE_CODES_PER_N),
                round(y_n * _FORCE_CODES_PER_N),
                round(z_n * _FORCE_CODES_PER_N),
            )
            _FORCE_STRUCT.pack_into(frames, at + 1, code << 4 | counter, x, y, z)
            age_ns = t_sent_ns - leg_t_ns
            age = -(-age_ns // _AGE_STEP_NS) if leg_t_ns and 0 <= age_ns <= _MAX_AGE_NS else _NO_AGE
            bits = counter | (flag & 0xF) << 4 | age << 8 | (mask & ALL_ELEMENTS_MASK) << _MASK_BIT
            shift = _SIGMA_BIT
            for component_n in sigmas_n:
                if 0.0 <= component_n < _MAX_SIGMA_N:
                    bits |= int(component_n * _SIGMA_CODES_PER_N + CEILING_OFFSET) << shift
                else:
                    bits |= (_NO_SIGMA - 1 if component_n > 0.0 else _NO_SIGMA) << shift
                shift += _SIGMA_BITS
            frames[at + FRAME_BYTES + 1 : at + FRAME_BYTES + 8] = bits.to_bytes(7, "little")
            at += 2 * FRAME_BYTES
        crcs = self._id_crcs
        for column, table in enumerate(COLUMN_CRC, 9):
            crcs ^= int.from_bytes(frames[column::FRAME_BYTES].translate(table), "little")
        frames[8::FRAME_BYTES] = crcs.to_bytes(self._n_frames, "little")
        sent = bytes(frames)
        return [sent[start : start + FRAME_BYTES] for start in range(0, len(sent), FRAME_BYTES)]


def _sendable_force(
    state: int, force_n: tuple[float, float, float], sigma_n: Sequence[float]
) -> tuple[int, float, float, float]:
    """Return state and force as sent: clipped; none in unusable states; a fault if not finite or without sigma."""
    if state in USABLE and not (all(map(math.isfinite, force_n)) and all(n >= 0.0 for n in sigma_n)):
        state = State.ELEMENT_FAULT
    if state not in USABLE:
        return state, _NO_FORCE_N, _NO_FORCE_N, _NO_FORCE_N
    x_n, y_n, z_n = (max(-_MAX_FORCE_N, min(_MAX_FORCE_N, component)) for component in force_n)
    return state, x_n, y_n, z_n
