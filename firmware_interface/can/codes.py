"""Enumerations used in the CAN frames: nodes, states, flags, causes, commands, results.

The same names in CamelCase are the value tables of `footsense.dbc`. No code ever changes its meaning.
"""

from enum import IntEnum, IntFlag

#: CAN node id of each leg: left front, left middle, left rear, right front, right middle, right rear; and of a robot
#: with eight legs the fourth of each side, behind the rear one.
NODE_IDS = {"lf": 1, "lm": 2, "lr": 3, "rf": 4, "rm": 5, "rr": 6, "l4": 7, "r4": 8}


class State(IntEnum):
    """State of a leg: whether its force may be used, and if not, why. No usable state has code 0, on purpose."""

    ABSENT = 0  #: the leg's chips do not answer
    VALID = 1  #: the force may be used
    NO_BASELINE = 2  #: no tare has succeeded yet
    TARING = 3  #: a tare is being taken
    SATURATED = 4  #: more elements are overloaded than a force can be given with
    ELEMENT_FAULT = 5  #: an element is open, shorted or gives no number; see the element mask
    CONVERTER_FAULT = 6  #: the converter answers but its conversions do not finish
    STALE = 7  #: the measurement is older than the age limit
    OUT_OF_RANGE = (
        8  #: the readings, or force and sigma from them, lie outside what the network was trained on
    )
    STOPPED = 9  #: the leg was stopped by command
    DEGRADED = (
        10  #: an element, row or column is missing, or up to three elements are overloaded: a larger sigma
    )
    STARTING = 11  #: the chips answer; the first readings are incomplete


#: States under which a force is sent.
USABLE = frozenset({State.VALID, State.DEGRADED})

#: States of a leg without a fault.
FAULT_FREE = frozenset({State.VALID, State.STARTING, State.TARING, State.STOPPED})


class Flag(IntFlag):
    """Flags of a usable force: notes that do not forbid its use."""

    SIMULATED = 1  #: from the simulator, not from a foot
    DEGRADED_TIMING = 2  #: the loop lacks the scheduling that it asked for, or a simulation lags
    TARE_REFUSED = 4  #: the last tare was refused; the older baseline is in use
    CONTACT = 8  #: the foot is in contact with the ground, with hysteresis


class Cause(IntEnum):
    """Cause of a leg's state, sent in the fault report."""

    NONE = 0  #: nothing is wrong, or nothing is known
    NO_ANSWER = 1  #: the leg's chips do not acknowledge: cable, power, or mux channel
    BUS_STUCK = 2  #: SDA or SCL is held low while the leg is connected
    WRONG_CHIP = 3  #: another chip answers at the converter's address
    NEVER_FINISHES = 4  #: conversions do not end
    SETTINGS_LOST = 5  #: a chip has lost its settings: a dip of its supply, or a switch that does not respond
    CORRUPT = 6  #: answers that no healthy chip gives
    ELEMENT_OPEN = 7  #: single elements have lost their electrode
    ELEMENT_SHORTED = 8  #: an element reads more than the others explain
    ELEMENT_STUCK = 9  #: an element no longer moves, not even by its noise
    ELEMENT_DRIFTS = 10  #: an element's baseline has drifted away from the others'
    ROW_OPEN = 11  #: the line of a row is interrupted
    COLUMN_OPEN = 12  #: the line of a column is interrupted
    OVERLOAD = 13  #: elements are loaded beyond their range: a gap is closed, or a code is at the end
    DELAYED = 14  #: the loop or the bus was delayed
    CANNOT_EXCITE = 15  #: reserved: nothing sends it
    CALIBRATION_STALE = 16  #: reserved: nothing sends it
    NOISY = (
        17  #: the readings have more noise than a tare allows: the force is given, with a sigma that has it
    )


class BaselineStatus(IntEnum):
    """Status of a leg's baseline tracking."""

    NONE = 0  #: there is no baseline yet
    TRACKING = 1  #: the foot is in confirmed swing, and the baseline tracks it
    HELD = 2  #: the foot is loaded, or its swing is not confirmed: the baseline holds
    NOT_QUIET = 3  #: tracking refused: the readings move more than noise does
    DRIFT_TOO_LARGE = 4  #: tracking refused: further from the free foot's expected readings than the limit
    DRIFT_TOO_FAST = 5  #: tracking refused: the readings move faster than temperature can move them


class Slip(IntEnum):
    """Slip state of a foot in contact."""

    UNKNOWN = 0  #: no contact, or not known
    NONE = 1  #: the foot sticks
    SLIPPING = 2  #: the foot slides, or sticks at the cone of friction


class GaitEventKind(IntEnum):
    """Type of a gait event. A slip ends with `SLIP_END`, or when the force becomes unknown."""

    TOUCHDOWN = 1
    LIFT_OFF = 2
    SLIP = 3  #: the foot begins to slide
    SLIP_END = 4  #: the foot slides no longer, or carries too little for a slip


class StepPhase(IntEnum):
    """Phase of a leg's step, as the gait controller has planned it."""

    UNKNOWN = 0  #: not planned, or not known
    SWING = 1
    STANCE = 2


class CalibrationKind(IntEnum):
    """How the electrodes of a leg's foot were found."""

    NONE = 0  #: not: they are taken as designed
    STANDING = 1  #: from the robot's own weight, pressed to the ground in several poses
    WALKING = 2  #: from walking
    PRESSED = 3  #: on a test stand


class CommandKind(IntEnum):
    """Commands that a controller can send to one leg."""

    TARE = 1  #: take the present capacitances as those of the unloaded foot
    START = 2  #: publish forces again after STOP
    STOP = 3  #: publish no force of this leg: its state becomes STOPPED


class Result(IntEnum):
    """Result of a command to a leg: done, or the reason for the refusal."""

    DONE = 0
    NOT_QUIET = 1  #: tare refused: the readings move more than noise does
    LOADED = 2  #: refused: the foot is in contact, or its readings are not those of an unloaded foot
    ELEMENT_FAULT = 3  #: tare refused: an element gives no usable number
    ABSENT = 4  #: refused: the leg does not answer
    UNKNOWN = 5  #: refused: no such command


class NmtState(IntEnum):
    """State of a node (one per leg) in its heartbeat, with the codes of CANopen.

    Source:
        CiA 301, heartbeat protocol.
    """

    BOOT = 0x00  #: the service has just opened the channel
    STOPPED = 0x04  #: no forces: the service ends, or the leg was stopped by command
    OPERATIONAL = 0x05
    PRE_OPERATIONAL = 0x7F  #: alive, but without a baseline, or without an answer of the leg's chips
