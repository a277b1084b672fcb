"""The two values that travel through the daemon: a scan of capacitances, and the forces made of it.

Both hold all legs of the robot at once, row n for the n-th leg of the configuration, because the network
runs once for all of them. An entry that was not measured is NaN: a frame never holds a stand-in number.
Arrays are read-only by agreement: whoever receives a frame may keep it.
"""

from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from firmware_interface.can_codes import EXPECTED, USABLE, BaselineStatus, Cause
from firmware_interface.can_frames import NODE_IDS, CommandKind, Flag, Result, State

__all__ = [
    "ELEMENTS",
    "EXPECTED",
    "LEGS",
    "USABLE",
    "BaselineDrift",
    "BaselineStatus",
    "CapFrame",
    "Cause",
    "Command",
    "CommandKind",
    "CommandResult",
    "ContactFrame",
    "Cycle",
    "Flag",
    "Reading",
    "Reference",
    "Result",
    "State",
]

#: Elements of a foot: a 3 x 3 grid, flat index 3 * row + column, row 0 the most forward, column 0 the leftmost.
ELEMENTS = 9

#: Every leg that a robot may have, in the order of the CAN node ids 1..6.
LEGS = tuple(NODE_IDS)


class Reading(IntEnum):
    """How the converter answered for one element of one scan."""

    OK = 0
    NO_ANSWER = 1  #: the chip or its channel did not acknowledge
    NOT_READY = 2  #: the conversion had not finished when it was read
    OVER_RANGE = 3  #: the code stands at the end of the converter's range
    MISCONFIGURED = 4  #: the leg's row switch or converter does not hold the setting that it was given
    BUS_STUCK = 5  #: SDA or SCL is held low while the leg is connected
    WRONG_CHIP = 6  #: another chip answers at the converter's address
    CORRUPT = 7  #: an answer that no healthy chip gives
    DELAYED = 8  #: the bus was busy with what is wrong elsewhere
    EXCITATION = 10  #: the converter cannot drive the leg's rows: a short, or a leak to ground
    UNDER_RANGE = 11  #: the code stands at the lower end of a range that begins above 0


@dataclass(frozen=True, slots=True, eq=False)
class CapFrame:
    """One scan of every element of every leg.

    Attributes:
        sequence: Number of the scan since start, from 0, without gaps.
        t_ns: Middle of each element's conversion [ns, monotonic], shape (legs, 9), int64; 0 where there was none.
        capacitance_pf: Capacitance as converted, stray included [pF], shape (legs, 9), float64, NaN unless OK.
        reading: How each element answered, shape (legs, 9), uint8 of `Reading`.
    """

    sequence: int
    t_ns: NDArray[np.int64]
    capacitance_pf: NDArray[np.float64]
    reading: NDArray[np.uint8]

    def __post_init__(self) -> None:
        """Check the shapes.

        Raises:
            ValueError: The three arrays are not all of one shape (legs, 9).
        """
        shape = self.capacitance_pf.shape
        if len(shape) != 2 or shape[1] != ELEMENTS or self.t_ns.shape != shape or self.reading.shape != shape:
            raise ValueError(
                f"a CapFrame needs three arrays of shape (legs, {ELEMENTS}), "
                f"got {self.t_ns.shape}, {shape}, {self.reading.shape}"
            )


class BaselineDrift(NamedTuple):
    """Where the zero of every leg stands and why.

    Attributes:
        status: What its tracking does, shape (legs,), uint8 of `BaselineStatus`.
        mean_pf: Mean over the elements of how far it has moved since the leg's last tare [pF], shape (legs,).
        worst_pf: The same of the element that moved farthest [pF], shape (legs,).
        moved_ns: When it was last moved or tared [ns], shape (legs,), int64; 0 where there is none.
    """

    status: NDArray[np.uint8]
    mean_pf: NDArray[np.float64]
    worst_pf: NDArray[np.float64]
    moved_ns: NDArray[np.int64]

    @classmethod
    def none(cls, n_legs: int) -> "BaselineDrift":
        """Return that of legs without any."""
        nan = np.full(n_legs, np.nan)
        return cls(np.full(n_legs, BaselineStatus.NONE, np.uint8), nan, nan, np.zeros(n_legs, np.int64))


@dataclass(frozen=True, slots=True, eq=False)
class ContactFrame:
    """The contact force of every leg, as the consumer is to believe it.

    Attributes:
        sequence: Number of the scan that it was made of.
        t_sent_ns: Time at which it is handed to the sinks [ns, monotonic].
        t_ns: How far the measurement reaches [ns], shape (legs,); 0 where none. Of whole scans the mean
            of the elements' stamps, to which all are brought; of single elements the newest stamp, while the force is
            as of t_sent_ns.
        force_n: Ground reaction on the foot in the foot frame [N], shape (legs, 3), NaN unless the state is USABLE.
        sigma_n: Standard deviation of each component [N], shape (legs, 3), NaN where the force is.
        state: Whether and why the force may be used, shape (legs,), uint8 of `State`.
        fault_mask: Bit e set where element e is not usable, shape (legs,), uint16.
        flags: Notes that do not forbid the value, shape (legs,), uint8 of `Flag`.
        cause: What lies behind the state, shape (legs,), uint8 of `Cause`.
        baseline: Status and drift of the baselines.
    """

    sequence: int
    t_sent_ns: int
    t_ns: NDArray[np.int64]
    force_n: NDArray[np.float64]
    sigma_n: NDArray[np.float64]
    state: NDArray[np.uint8]
    fault_mask: NDArray[np.uint16]
    flags: NDArray[np.uint8]
    cause: NDArray[np.uint8]
    baseline: BaselineDrift

    @property
    def age_ns(self) -> NDArray[np.int64]:
        """Age of each leg's measurement at the time of sending [ns], shape (legs,); of no meaning where t_ns is 0."""
        return self.t_sent_ns - self.t_ns


class Command(NamedTuple):
    """A request to the daemon, already checked for its crc and counter.

    Attributes:
        kind: What to do.
        leg: Row of the leg in the frames.
    """

    kind: CommandKind
    leg: int


class CommandResult(NamedTuple):
    """What became of a command, or of the tare that the daemon takes by itself at start.

    Attributes:
        command: The request.
        result: DONE, or why it was refused.
        reason: The same in words, with the numbers that decided it.
    """

    command: Command
    result: Result
    reason: str


class Reference(NamedTuple):
    """Samples of a test stand's force sensor since the last cycle, oldest first.

    Attributes:
        t_ns: When each sample was taken, in the daemon's clock [ns, monotonic], shape (n,), int64.
        force_n: Ground reaction on the foot in the leg's frame, as in `ContactFrame` [N], shape (n, 3).
        saturated: Whether an axis stood at the end of its range, shape (n,).
    """

    t_ns: NDArray[np.int64]
    force_n: NDArray[np.float64]
    saturated: NDArray[np.bool_]


class Cycle(NamedTuple):
    """One turn of the loop, as its observers see it.

    Attributes:
        scan: What the converters said.
        commands: Commands that were obeyed before the scan was processed.
        forces: What was published.
        outcomes: Commands that came to an end in this turn.
        reference: Samples of a test stand's force sensor, None on a robot.
        temperature_c: Of each leg's converter from this cycle on [degC], shape (legs,), NaN for none; None as long as
            it is what it was, and where none has a sensor.
    """

    scan: CapFrame
    commands: tuple[Command, ...]
    forces: ContactFrame
    outcomes: tuple[CommandResult, ...]
    reference: Reference | None = None
    temperature_c: NDArray[np.float64] | None = None


@dataclass(slots=True)
class CanStatistics:
    """Numbers of frames and events since the channel was first opened.

    Attributes:
        sent: Handed to the channel.
        dropped: Refused by the channel, for a full queue or a dead interface, and never sent again.
        received: Arrived under a command id of ours, good or bad.
        rejected: Of those, the ones that were not obeyed: wrong crc, repeated counter, unknown command.
        bus_errors: Error frames that the controller reported.
        bus_off: Of those, the ones that said that the controller has left the bus.
        error_passive: Of those, the ones that said that it may hardly speak any more: errors, or nobody acknowledges.
        reopened: How often the interface has been opened again after it had gone.
        unlogged: Frames that were sent and are not in the log, because whoever writes it was too slow or has ended.
    """

    sent: int = 0
    dropped: int = 0
    received: int = 0
    rejected: int = 0
    bus_errors: int = 0
    bus_off: int = 0
    error_passive: int = 0
    reopened: int = 0
    unlogged: int = 0
