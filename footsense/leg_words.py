"""What people are told of a leg: word, phase, meaning and remedy of its states and causes, and what readings they show.

The only table of these texts. Log, terminal tables, `footsense probe` and the page read it.
"""

from enum import IntEnum
from typing import NamedTuple

from footsense.frames import Cause, Reading, State


class LegPhase(IntEnum):
    """Operating phase of a leg from power-up to forces (not a gait phase): a coarse grouping of its states."""

    ABSENT = 0  #: its chips do not answer
    STARTING = 1  #: they answer, but readings or a tare are missing for a force
    TARING = 2  #: a tare is being taken
    VALID = 3  #: forces come
    DEGRADED = 4  #: forces come from fewer elements
    FAULTED = 5  #: something is broken, delayed or out of range
    STOPPED = 6  #: the leg was stopped by command


class StateWords(NamedTuple):
    """Words for a state: its phase, its meaning, and what to do or check where the cause says nothing better."""

    phase: LegPhase
    meaning: str
    remedy: str = ""


class CauseWords(NamedTuple):
    """Words for a cause: its meaning, what to check, and the mark of its elements in a picture of the foot."""

    meaning: str
    remedy: str
    mark: str = ""


STATE_WORDS = {
    State.ABSENT: StateWords(LegPhase.ABSENT, "its chips do not answer"),
    State.VALID: StateWords(LegPhase.VALID, "its force may be used"),
    State.NO_BASELINE: StateWords(
        LegPhase.STARTING, "no tare has succeeded yet", "lift the foot off the ground, and tare it"
    ),
    State.TARING: StateWords(LegPhase.TARING, "a tare is being taken", "keep the foot in the air, and still"),
    State.SATURATED: StateWords(
        LegPhase.FAULTED, "a gap is closed, or a code is at the end of its range", "what presses the foot"
    ),
    State.ELEMENT_FAULT: StateWords(
        LegPhase.FAULTED,
        "elements give no number, too many to do without them",
        "the foot's plug; `footsense probe` names the lines",
    ),
    State.CONVERTER_FAULT: StateWords(
        LegPhase.FAULTED, "its converter answers, but its conversions do not finish"
    ),
    State.STALE: StateWords(LegPhase.FAULTED, "its measurement is older than the limit"),
    State.OUT_OF_RANGE: StateWords(
        LegPhase.FAULTED,
        "its load is outside those that the network was trained on",
        "whether the load is one that this foot is made for",
    ),
    State.STOPPED: StateWords(
        LegPhase.STOPPED, "it was stopped by command", "the command START publishes its forces again"
    ),
    State.DEGRADED: StateWords(
        LegPhase.DEGRADED,
        "its force comes from fewer elements, with a larger sigma",
        "the foot's plug; `footsense probe` names the lines",
    ),
    State.STARTING: StateWords(LegPhase.STARTING, "its first readings are incomplete"),
}

CAUSE_WORDS = {
    Cause.NONE: CauseWords("", ""),
    Cause.NO_ANSWER: CauseWords(
        "its chips do not answer", "its plug, its 3.3 V, and whether this is its channel"
    ),
    Cause.BUS_STUCK: CauseWords(
        "it holds SDA or SCL low as soon as it is connected",
        "short in its cable or plug, and whether its chips have power",
    ),
    Cause.WRONG_CHIP: CauseWords(
        "another chip answers at the converter's address",
        "what is plugged in there, and `board` in the configuration",
    ),
    Cause.NEVER_FINISHES: CauseWords(
        "its converter does not finish its conversions", "its 3.3 V supply", "busy"
    ),
    Cause.SETTINGS_LOST: CauseWords(
        "a chip does not hold its settings",
        "the supply of its chips and the switches' RESET pin; or a loose contact",
        "reset",
    ),
    Cause.CORRUPT: CauseWords(
        "its answers are such as no healthy chip gives",
        "pull-ups, cable length and ground of this leg",
        "corrupt",
    ),
    Cause.ELEMENT_OPEN: CauseWords(
        "single elements have lost their electrode",
        "the foot's plug, then the traces of these elements",
        "open",
    ),
    Cause.ELEMENT_SHORTED: CauseWords(
        "an element reads more than any load can cause",
        "whether its electrodes touch, and the trace of its column",
        "short",
    ),
    Cause.ELEMENT_STUCK: CauseWords("an element no longer moves, not even by its noise", "its solder joints"),
    Cause.ELEMENT_DRIFTS: CauseWords(
        "an element's baseline has drifted away from the others'",
        "water or dirt in its gap; then tare the foot",
    ),
    Cause.ROW_OPEN: CauseWords(
        "the line of a row is interrupted", "the plug, then the row's trace and its switch", "open"
    ),
    Cause.COLUMN_OPEN: CauseWords(
        "the line of a column is interrupted",
        "the plug, then the column's trace and the converter's pin",
        "open",
    ),
    Cause.GAP_CLOSED: CauseWords(
        "a gap is closed: more load than the foot can measure",
        "water in the gap, and what presses the foot",
        "closed",
    ),
    Cause.DELAYED: CauseWords(
        "its readings came too late",
        "what else loads this computer or this bus, and the bus's pull-ups and clock",
        "late",
    ),
    Cause.CANNOT_EXCITE: CauseWords(
        "its converter cannot drive the rows", "a row line that is shorted or leaks to ground", "drive"
    ),
    Cause.CALIBRATION_STALE: CauseWords("", ""),
}

#: State and cause that a reading of a leg's chips gives the leg, the most severe last.
STATE_AND_CAUSE_OF_READING = {
    Reading.DELAYED: (State.STALE, Cause.DELAYED),
    Reading.NOT_READY: (State.CONVERTER_FAULT, Cause.NEVER_FINISHES),
    Reading.CORRUPT: (State.CONVERTER_FAULT, Cause.CORRUPT),
    Reading.MISCONFIGURED: (State.CONVERTER_FAULT, Cause.SETTINGS_LOST),
    Reading.EXCITATION: (State.CONVERTER_FAULT, Cause.CANNOT_EXCITE),
    Reading.WRONG_CHIP: (State.ABSENT, Cause.WRONG_CHIP),
    Reading.BUS_STUCK: (State.ABSENT, Cause.BUS_STUCK),
    Reading.NO_ANSWER: (State.ABSENT, Cause.NO_ANSWER),
}

#: Readings of a leg whose foot does not answer: it may come back with another foot.
SILENT_READINGS = tuple(
    reading for reading, (state, _) in STATE_AND_CAUSE_OF_READING.items() if state is State.ABSENT
)


def words_of_reading(reading: Reading) -> CauseWords:
    """Return the words for the cause that a faulty reading of a leg's chips shows."""
    return CAUSE_WORDS[STATE_AND_CAUSE_OF_READING[reading][1]]


def word_of(code: IntEnum) -> str:
    """Return a code's name in words.

    Example:
        >>> word_of(State.ELEMENT_FAULT)
        'element fault'
    """
    return code.name.lower().replace("_", " ")


def phase_of(state: State) -> LegPhase:
    """Return the operating phase that a leg state belongs to."""
    return STATE_WORDS[state].phase
