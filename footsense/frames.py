"""Data types passed between the packages: capacitance frame, leg motion, force frame, gait frame, cycle.

A frame holds all legs of the robot, row n for the n-th leg of the configuration, because the network runs once for all
of them. An entry that was not measured is NaN, never a substitute. Arrays are read-only by agreement: a receiver may
keep a frame. The arrays are declared once, here: ring, recording and export store them as their `CycleField` says.
"""

from dataclasses import dataclass
from enum import IntEnum
from typing import Annotated, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from firmware_interface.can.codes import FAULT_FREE as FAULT_FREE
from firmware_interface.can.codes import NODE_IDS
from firmware_interface.can.codes import USABLE as USABLE
from firmware_interface.can.codes import BaselineStatus as BaselineStatus
from firmware_interface.can.codes import Cause as Cause
from firmware_interface.can.codes import CommandKind as CommandKind
from firmware_interface.can.codes import Flag as Flag
from firmware_interface.can.codes import GaitEventKind as GaitEventKind
from firmware_interface.can.codes import Result as Result
from firmware_interface.can.codes import Slip as Slip
from firmware_interface.can.codes import State as State
from firmware_interface.can.codes import StepPhase as StepPhase

#: Arrays by their entries: numbers, truth values, times [ns], and codes of an enumeration.
Vector = NDArray[np.float64]
Mask = NDArray[np.bool_]
Stamps = NDArray[np.int64]
Codes = NDArray[np.uint8]

#: Whether the force of a leg in a state may be used, by the state's code, shape (256,): `IS_USABLE_STATE[frame.state]`.
IS_USABLE_STATE: Mask = np.isin(np.arange(256), list(USABLE))

#: Elements of a foot: a 3 x 3 grid, flat index 3 * row + column, row 0 the most forward, column 0 the leftmost.
ELEMENTS = 9
#: Rows of elements, and columns.
ROWS = 3

#: Every leg that a robot may have, in the order of the CAN node ids 1..8.
ALL_LEGS = tuple(NODE_IDS)
Leg = Literal["lf", "lm", "lr", "rf", "rm", "rr", "l4", "r4"]
#: The legs of a hexapod, which is simulated where no robot is given.
LEGS = ALL_LEGS[:6]


class Reading(IntEnum):
    """Result of reading one element in one scan."""

    OK = 0
    NO_ANSWER = 1  #: the chip or its channel did not acknowledge
    NOT_READY = 2  #: the conversion had not finished when it was read
    OVER_RANGE = 3  #: the code is at the end of the converter's range
    MISCONFIGURED = 4  #: the leg's row switch or converter has lost its settings
    BUS_STUCK = 5  #: SDA or SCL is held low while the leg is connected
    WRONG_CHIP = 6  #: another chip answers at the converter's address
    CORRUPT = 7  #: an answer that no healthy chip gives
    DELAYED = 8  #: the bus was occupied by a fault of another leg
    UNDER_RANGE = 11  #: the code is 0: no line has so little


class CycleField(NamedTuple):
    """How one array of a frame, with one row per leg, is stored: type, shape, keys in JSON.

    Attributes:
        dtype: Type of its entries, as numpy calls it.
        row_shape: Shape of a leg's row.
        json_keys: Keys of a leg's row in JSON: one, or one for each component; none where it is the array's name.
        max_code: Largest code or mask with a meaning; None for numbers.
        code_enum: Enumeration by whose names JSON calls the codes; None for numbers.
    """

    dtype: str
    row_shape: tuple[int, ...] = ()
    json_keys: tuple[str, ...] = ()
    max_code: int | None = None
    code_enum: type[IntEnum] | None = None


_NUMBER, _TIME, _MARK = CycleField("<f8"), CycleField("<i8"), CycleField("u1", max_code=1)
_OF_ELEMENTS = (ELEMENTS,)


def _code(enum: type[IntEnum]) -> CycleField:
    return CycleField("u1", max_code=max(enum), code_enum=enum)


class CapFrame(NamedTuple):
    """Latest capacitance reading of every element of every leg, with time and read result.

    A scanner of converters that are triggered gives a frame for every conversion, with one new reading of each leg;
    converters that run freely and a microcontroller give one for every scan, with nine.

    Attributes:
        sequence: Number of the frame since start, from 0, without gaps.
        t_ns: Middle of each element's conversion [ns, monotonic], shape (legs, elements), int64; 0 where none.
        capacitance_pf: Capacitance as converted, stray included [pF], shape (legs, elements), float64, NaN unless OK.
        reading: Result of reading each element, shape (legs, elements), uint8 of `Reading`.
    """

    sequence: int
    t_ns: Annotated[Stamps, CycleField("<i8", _OF_ELEMENTS)]
    capacitance_pf: Annotated[Vector, CycleField("<f8", _OF_ELEMENTS)]
    reading: Annotated[Codes, CycleField("u1", _OF_ELEMENTS, max_code=max(Reading))]


class LegMotion(NamedTuple):
    """Motion of every leg as its gait controller knows it, the newest of each; NaN where it sent none in time.

    Foot frame here is that of `ContactFrame.force_n`: x forward, y left, z along the leg towards the body.

    Attributes:
        t_ns: Time of arrival [ns, monotonic], shape (legs,), int64; 0 where there is none, or its time is out.
        acceleration_m_per_s2: Acceleration of the foot along z of the foot frame, of its path alone, gravity not
            included [m/s2], shape (legs,).
        sigma_m_per_s2: Standard deviation of it [m/s2], shape (legs,).
        up: Unit vector against gravity in the foot frame, shape (legs, 3).
        phase: Planned phase of the step, shape (legs,), uint8 of `StepPhase`.
    """

    t_ns: Annotated[Stamps, _TIME]
    acceleration_m_per_s2: Annotated[Vector, _NUMBER]
    sigma_m_per_s2: Annotated[Vector, _NUMBER]
    up: Annotated[Vector, CycleField("<f8", (3,), ("up_x", "up_y", "up_z"))]
    phase: Annotated[Codes, _code(StepPhase)]


class BaselineDrift(NamedTuple):
    """Status of every leg's baseline, and the drift of its baseline since the last tare.

    Attributes:
        status: Status of the drift tracking, shape (legs,), uint8 of `BaselineStatus`.
        mean_pf: Mean drift of the elements [pF], shape (legs,).
        worst_pf: Drift of the element that moved farthest [pF], shape (legs,).
        moved_ns: Time of the last move or tare [ns], shape (legs,), int64; 0 without a baseline.
    """

    status: Annotated[Codes, _code(BaselineStatus)._replace(json_keys=("baseline_status",))]
    mean_pf: Annotated[Vector, CycleField("<f8", json_keys=("baseline_mean_pf",))]
    worst_pf: Annotated[Vector, CycleField("<f8", json_keys=("baseline_worst_pf",))]
    moved_ns: Annotated[Stamps, CycleField("<i8", json_keys=("baseline_moved_ns",))]


class GaitEvent(NamedTuple):
    """A gait event of one leg (touchdown, lift-off, slip, ...), reported once.

    Attributes:
        kind: Kind of event.
        leg: Row of the leg in the frames.
        t_ns: Time at which it happened [ns], back-dated.
        sigma_s: Standard deviation of that time [s].
    """

    kind: GaitEventKind
    leg: int
    t_ns: int
    sigma_s: float


class GaitFrame(NamedTuple):
    """Gait estimate of all legs at one time: contact, load share, ground normal, friction, slip, events.

    Foot frame here is that of `ContactFrame.force_n`: x forward, y left, z along the leg.

    Attributes:
        t_ns: The time [ns].
        touchdown_ns: Time of the last touchdown, back-dated [ns], shape (legs,); 0 if it is not known.
        touchdown_sigma_s: Standard deviation of it [s], shape (legs,), NaN if it is not known.
        lift_off_ns: Time of the last lift-off, back-dated [ns], shape (legs,); 0 if it is not known.
        lift_off_sigma_s: Standard deviation of it [s], shape (legs,), NaN if it is not known.
        load_share: Share of the load that all legs in contact carry along their legs [1], shape (legs,); 0 for a foot
            in the air, NaN for a leg without a force and where no leg carries anything.
        normal: Unit normal of the ground into the foot, foot frame, shape (legs, 3), NaN without a load.
        normal_sigma_rad: Standard deviation of its direction, root of the sum of both squares [rad], shape (legs,).
        tangential_over_normal: Tangential over normal force [1], shape (legs,), NaN without a load.
        tangential_over_normal_sigma: Standard deviation of it [1], shape (legs,).
        contact: Debounced contact, shape (legs,).
        contact_raw: Whether the newest load alone is one of contact, shape (legs,).
        slip: Whether the foot slides, shape (legs,), uint8 of `Slip`.
        friction: Coefficient of the ground's friction, as configured [1]; NaN if not, and then no slip is reported.
        all_in_air: Whether every leg is known to be without contact.
        events: What was noticed since the last frame.
    """

    t_ns: int
    touchdown_ns: Annotated[Stamps, _TIME]
    touchdown_sigma_s: Annotated[Vector, _NUMBER]
    lift_off_ns: Annotated[Stamps, _TIME]
    lift_off_sigma_s: Annotated[Vector, _NUMBER]
    load_share: Annotated[Vector, _NUMBER]
    normal: Annotated[Vector, CycleField("<f8", (3,), ("normal_x", "normal_y", "normal_z"))]
    normal_sigma_rad: Annotated[Vector, _NUMBER]
    tangential_over_normal: Annotated[Vector, _NUMBER]
    tangential_over_normal_sigma: Annotated[Vector, _NUMBER]
    contact: Annotated[Mask, _MARK]
    contact_raw: Annotated[Mask, _MARK]
    slip: Annotated[Codes, _code(Slip)]
    friction: float
    all_in_air: bool
    events: tuple[GaitEvent, ...]


class ContactFrame(NamedTuple):
    """Force estimate of every leg after one scan, with standard deviation, state, faults and baseline drift.

    Attributes:
        sequence: Number of the frame that it was estimated from.
        t_sent_ns: Time at which it is handed to the sinks, and that the forces are valid for [ns, monotonic].
        t_ns: Time of each leg's newest reading [ns], shape (legs,); 0 without one.
        force_n: Ground reaction on the foot in the foot frame [N], shape (legs, 3), NaN unless the state is USABLE.
        sigma_n: Standard deviation of each component [N], shape (legs, 3), NaN where the force is.
        contact_probability: Probability that the foot is on the ground now [1], shape (legs,), NaN where the force is
            not known.
        holds: Probability that the foot stands still on the ground now [1], shape (legs,), NaN where that is not known.
        state: Whether the force may be used, and if not, why, shape (legs,), uint8 of `State`.
        fault_mask: Bit e set where element e is not usable or overloaded, shape (legs,), uint16.
        cause: Cause of the state, shape (legs,), uint8 of `Cause`.
        flags: Notes on a usable force, shape (legs,), uint8 of `Flag`.
        noise_ff: Noise of each leg's readings, measured while it runs [fF], shape (legs,).
        baseline: Status and drift of the baselines.
        gait: Gait semantics, ten times a second and with every event; None between, and in recordings from before them.
    """

    sequence: int
    t_sent_ns: int
    t_ns: Annotated[Stamps, _TIME]
    force_n: Annotated[Vector, CycleField("<f8", (3,), ("fx_n", "fy_n", "fz_n"))]
    sigma_n: Annotated[Vector, CycleField("<f8", (3,), ("sigma_x_n", "sigma_y_n", "sigma_z_n"))]
    contact_probability: Annotated[Vector, _NUMBER]
    holds: Annotated[Vector, _NUMBER]
    state: Annotated[Codes, _code(State)]
    fault_mask: Annotated[NDArray[np.uint16], CycleField("<u2", max_code=(1 << ELEMENTS) - 1)]
    cause: Annotated[Codes, _code(Cause)]
    flags: Annotated[Codes, CycleField("u1", max_code=255)]
    noise_ff: Annotated[Vector, _NUMBER]
    baseline: BaselineDrift
    gait: GaitFrame | None = None

    @property
    def age_ns(self) -> Stamps:
        """Age of each leg's newest reading at sending [ns], shape (legs,); meaningless where t_ns is 0."""
        return self.t_sent_ns - self.t_ns


class Command(NamedTuple):
    """A received command to one leg (tare, stop, ...), with CRC and counter already checked.

    Attributes:
        kind: Kind of command.
        leg: Row of the leg in the frames.
    """

    kind: CommandKind
    leg: int


class CommandResult(NamedTuple):
    """Result of a command, or of the tare that the daemon starts by itself at start-up.

    Attributes:
        command: The command.
        result: DONE, or why it was refused.
        reason: The same as text, with the numbers that decided it.
    """

    command: Command
    result: Result
    reason: str


class ReferenceSamples(NamedTuple):
    """Samples of the test stand's force sensor since the last cycle, oldest first.

    Attributes:
        t_ns: Time of each sample in the daemon's clock [ns, monotonic], shape (n,), int64.
        force_n: Ground reaction on the foot in the leg's frame, as in `ContactFrame` [N], shape (n, 3).
        saturated: Whether an axis was at the end of its range, shape (n,).
    """

    t_ns: Stamps
    force_n: Vector
    saturated: Mask


@dataclass(slots=True)
class SensorStatistics:
    """Statistics of a force sensor's data stream: counts of samples and faults, and the error of its times.

    Attributes:
        n_samples: Samples received.
        n_missing: Samples lost, by their times and sequence numbers.
        n_bad_records: Lines or packets that could not be decoded.
        n_saturated: Samples with a saturated axis.
        n_clock_jumps: Jumps of its clock.
        n_stream_starts: Openings of its line.
        clock_fit_residual_ms: Uncertainty of the times [ms].
    """

    n_samples: int = 0
    n_missing: int = 0
    n_bad_records: int = 0
    n_saturated: int = 0
    n_clock_jumps: int = 0
    n_stream_starts: int = 0
    clock_fit_residual_ms: float = 0.0


class Cycle(NamedTuple):
    """All inputs and outputs of one cycle of the main loop, as passed to its observers.

    Attributes:
        scan: The readings.
        started_commands: Commands executed before the readings were processed.
        forces: The contacts; the sink publishes every n-th.
        ended_commands: Results of the commands that ended in this cycle.
        reference: Samples of a test stand's force sensor, None without one.
        temperature_c: Temperature of each foot from this cycle on [degC], shape (legs,), NaN for an unknown one; None
            if unchanged, and where nothing tells it.
        motion: Motion of each leg from this cycle on; None if unchanged, and without a gait controller that sends it.
    """

    scan: CapFrame
    started_commands: tuple[Command, ...]
    forces: ContactFrame
    ended_commands: tuple[CommandResult, ...]
    reference: ReferenceSamples | None = None
    temperature_c: Vector | None = None
    motion: LegMotion | None = None


@dataclass(slots=True)
class CanStatistics:
    """Counters of CAN frames and bus events since the interface was first opened.

    Attributes:
        published_cycles: Cycles whose forces were published, whether the channel took them or not.
        sent: Handed to the channel.
        dropped: Refused by the channel, for a full queue or a dead interface, and never sent again.
        received_commands: Arrived under a command id of ours, good or bad.
        rejected_commands: Received frames that were not executed: wrong crc, repeated counter, unknown command.
        received_motions: Arrived under the id of a leg's motion, good or bad.
        rejected_motions: Received ones that were not taken: wrong crc, repeated counter, or none are to be taken.
        bus_errors: Error frames that the controller reported.
        bus_off: Error frames that report bus-off: the controller has left the bus.
        error_passive: Error frames that report error passive: errors, or no acknowledgement.
        reopened: Number of times that the interface was opened again after it had gone.
    """

    published_cycles: int = 0
    sent: int = 0
    dropped: int = 0
    received_commands: int = 0
    rejected_commands: int = 0
    received_motions: int = 0
    rejected_motions: int = 0
    bus_errors: int = 0
    bus_off: int = 0
    error_passive: int = 0
    reopened: int = 0
