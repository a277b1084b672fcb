"""CAN frames `Fault` (fault report), `Heartbeat`, `Baseline`, `Identity` and `Calibration` of a leg.

All but the heartbeat are protected as `crc8` describes; that has the byte of CANopen's, and an id of ours.
A baseline that tracks temperature takes a force away from the consumer unseen: the bus carries its offset since the
last tare, the time of its last move, and why it holds.

Source:
    CiA 301, heartbeat protocol.
"""

from datetime import date, timedelta
from hashlib import sha256
from typing import Annotated, NamedTuple

from firmware_interface.can.codes import BaselineStatus, CalibrationKind, Cause, NmtState, State
from firmware_interface.can.crc8 import FrameError, node_of
from firmware_interface.can.force import FORCE_STEPS_MN
from firmware_interface.can.signals import Age, Code, Codec, Number, SignedNumber

#: CAN ids are these plus the node id.
FAULT_ID = 0x100
HEARTBEAT_ID = 0x148
BASELINE_ID = 0x128
IDENTITY_ID = 0x150
CALIBRATION_ID = 0x158

#: Version of the frames of this folder. Number 1 had no version in its frames, and other ids.
PROTOCOL_VERSION = 3


#: Day 0 of a calibration's date.
CALIBRATION_EPOCH = date(2020, 1, 1)


class Fault(NamedTuple):
    """Content of a `Fault` frame (fault report): state, element mask and cause of a leg; on change and once a second.

    ::

        byte    0        1           2         3    4      5
             +-------+-----+-----+------+---+---------+-------+
             | crc8  |state| cnt |  0   |old|  mask   | cause |   mask: bits 0..8
             +-------+-----+-----+------+---+---------+-------+
                      7..4  3..0  7..4   3..0

    Attributes:
        node: CAN node id of the leg, 1..8.
        counter: Sequence counter of the frame, 0..14.
        state: State from now on.
        previous: State until now; the same where it has not changed.
        fault_mask: Bit e set where element e is not usable or overloaded, 9 bits.
        cause: Cause of the state, as far as it is known.
    """

    node: int
    counter: int
    state: Annotated[State, Code(12, 4)]
    previous: Annotated[State, Code(16, 4)]
    fault_mask: Annotated[int, Code(24, 9)]
    cause: Annotated[Cause, Code(40, 8)]


class Heartbeat(NamedTuple):
    """Content of a `Heartbeat` frame: node, node state, timing flag.

    Attributes:
        node: CAN node id of the leg, 1..8.
        state: State of the node.
        degraded_timing: Whether the service runs without the scheduling that it asked for, or a simulation lags.
    """

    node: int
    state: NmtState
    degraded_timing: bool


_DEGRADED_TIMING = 0x80


class Baseline(NamedTuple):
    """Content of a `Baseline` frame: baseline status, mean and worst drift, age.

    ::

        byte    0        1            2    3       4    5       6    7
             +-------+------+-----+------------+------------+-----------+
             | crc8  |status| cnt | mean int16 | worst int16| age uint16|
             +-------+------+-----+------------+------------+-----------+
                      7..4   3..0

        offsets: 0.1 fF per bit, saturating at +-3276.7 fF; -32768: no value
        age: 0.1 s per bit, rounded up, saturating at 65534; 65535: none

    Attributes:
        node: CAN node id of the leg, 1..8.
        counter: Sequence counter of the frame, 0..14.
        status: Status of the baseline tracking, or why it is refused.
        mean_pf: Offset of the baseline since the last tare, mean over the elements [pF]; NaN: no value.
        worst_pf: Offset of the element with the largest [pF]; NaN: no value.
        age_ns: Time since the baseline last moved or was tared [ns], in steps of 0.1 s; None: no baseline; 6553.4 s:
            or more.
    """

    node: int
    counter: int
    status: Annotated[BaselineStatus, Code(12, 4)]
    mean_pf: Annotated[float, SignedNumber(16, 16, 10_000)]
    worst_pf: Annotated[float, SignedNumber(32, 16, 10_000)]
    age_ns: Annotated[int | None, Age(48, 16, 100_000_000, saturates=True)]


class Identity(NamedTuple):
    """Content of an `Identity` frame: what a consumer needs to read the leg's forces. Every version has this layout.

    ::

        byte    0        1          2         3        4 .. 7
             +-------+----+-----+---------+--------+-------------+
             | crc8  | 0  | cnt | version |  step  |  foot type  |
             +-------+----+-----+---------+--------+-------------+
                      7..4 3..0

    Attributes:
        node: CAN node id of the leg, 1..8.
        counter: Sequence counter of the frame, 0..14.
        version: Version of all frames, `PROTOCOL_VERSION`.
        force_step_mn: What a bit of a force stands for [mN], and the least of its sigmas.
        foot_type_hash: `foot_type_hash` of the foot's type.
    """

    node: int
    counter: int
    version: Annotated[int, Code(16, 8)]
    force_step_mn: Annotated[int, Code(24, 8)]
    foot_type_hash: Annotated[int, Code(32, 32)]

    @property
    def is_known(self) -> bool:
        """Whether the decoders of this folder can read the leg's forces."""
        return self.version == PROTOCOL_VERSION and self.force_step_mn in FORCE_STEPS_MN


class CalibrationFrame(NamedTuple):
    """Content of a `Calibration` frame: how the foot of a leg is calibrated, and how far its force is expected to err.

    ::

        byte    0        1         2   3      4        5
             +-------+----+-----+----------+------+-----------+   date: days since 2020-01-01, 65535: none
             | crc8  |kind| cnt |   date   | size | direction |   size: 0.5 % per bit, rounded up, 255: none
             +-------+----+-----+----------+------+-----------+   direction: 0.1 deg per bit, rounded up, 255: none
                      7..4 3..0

    Attributes:
        node: CAN node id of the leg, 1..8.
        counter: Sequence counter of the frame, 0..14.
        kind: How the foot was calibrated.
        day: Day of it, since 2020-01-01; None: no calibration.
        size_error_percent: Expected error of the force's size, over it [%]; NaN: not known; 127: or more.
        direction_error_deg: Expected error of its direction [deg]; NaN: not known; 25.4: or more.
    """

    node: int
    counter: int
    kind: Annotated[CalibrationKind, Code(12, 4)]
    day: Annotated[int | None, Age(16, 16, 1)]
    size_error_percent: Annotated[float, Number(32, 8, 2, up=True)]
    direction_error_deg: Annotated[float, Number(40, 8, 10, up=True)]

    @property
    def date(self) -> date | None:
        """Day of the calibration; None: no calibration."""
        return None if self.day is None else CALIBRATION_EPOCH + timedelta(self.day)


FAULT = Codec(FAULT_ID, Fault)
BASELINE = Codec(BASELINE_ID, Baseline)
IDENTITY = Codec(IDENTITY_ID, Identity)
CALIBRATION = Codec(CALIBRATION_ID, CalibrationFrame)


def foot_type_hash(foot_type: str) -> int:
    """Return the number that stands for a foot type on CAN: the first four bytes of the SHA-256 of its name.

    Example:
        >>> f"{foot_type_hash('aoyagi-3x3'):08x}"
        'abfbaaed'
    """
    return int.from_bytes(sha256(foot_type.encode()).digest()[:4], "big")


def encode_heartbeat(state: NmtState, *, degraded_timing: bool = False) -> bytes:
    """Return the data byte of a `Heartbeat` frame (no CRC): CANopen's state, and degraded timing as bit 7.

    Example:
        >>> encode_heartbeat(NmtState.OPERATIONAL).hex()
        '05'
        >>> encode_heartbeat(NmtState.OPERATIONAL, degraded_timing=True).hex()
        '85'
    """
    return bytes([state | _DEGRADED_TIMING if degraded_timing else state])


def decode_heartbeat(can_id: int, data: bytes) -> Heartbeat:
    """Return the content of a `Heartbeat` frame, after checking it.

    Raises:
        FrameError: The id, length or state is wrong.
    """
    node = node_of(can_id, HEARTBEAT_ID)
    try:
        (code,) = data
        return Heartbeat(node, NmtState(code & ~_DEGRADED_TIMING), bool(code & _DEGRADED_TIMING))
    except ValueError:
        raise FrameError(f"{data.hex() or 'nothing'} is no heartbeat of CiA 301") from None
