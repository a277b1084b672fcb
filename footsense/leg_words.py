"""States and causes of a leg for people: word, phase, meaning, remedy, and the readings that show them.

The only table of these texts. Log, terminal tables, `footsense probe` and the page read it.
"""

from enum import IntEnum
from typing import NamedTuple

import numpy as np

from footsense.frames import Cause, Mask, Reading, State


class LegPhase(IntEnum):
    """Operating phase of a leg from power-up to forces (not a gait phase): a coarse grouping of its states."""

    ABSENT = 0  #: its chips do not answer
    STARTING = 1  #: they answer, but readings or a tare are missing for a force
    TARING = 2  #: a tare is being taken
    VALID = 3  #: forces come
    DEGRADED = 4  #: forces come from fewer elements, or from overloaded ones
    FAULTED = 5  #: something is broken, delayed or out of range
    STOPPED = 6  #: the leg was stopped by command


class Words(NamedTuple):
    """A state or a cause for people.

    Attributes:
        meaning: What it means, of a leg ("its ...").
        remedy: What to check; of a state, where the cause says nothing better.
        mark: Mark of its elements in a picture of the foot, at most 7 characters.
    """

    meaning: str = ""
    remedy: str = ""
    mark: str = ""


STATE_WORDS = {
    State.ABSENT: Words("its chips do not answer"),
    State.VALID: Words("its force may be used"),
    State.NO_BASELINE: Words(
        "no tare has succeeded yet",
        "that nothing presses the foot and it hangs still; then `footsense tare LEG`",
    ),
    State.TARING: Words("a tare is being taken", "that nothing presses the foot and it hangs still"),
    State.SATURATED: Words("too many elements are overloaded for a force", "what presses the foot"),
    State.ELEMENT_FAULT: Words(
        "too many elements give no number", "the foot's plug; `footsense probe` names the lines"
    ),
    State.CONVERTER_FAULT: Words("its converter answers, but its conversions do not finish"),
    State.STALE: Words("its measurement is older than the limit"),
    State.OUT_OF_RANGE: Words(
        "its readings, or the force from them, are outside those of the network's training",
        "whether this foot is made for such a load",
    ),
    State.STOPPED: Words(
        "it was stopped by command",
        "whether it is to go on: the command START, in Python `Feet.start`, publishes its forces again",
    ),
    State.DEGRADED: Words(
        "its force comes from fewer elements, or from overloaded ones",
        "the foot's plug; `footsense probe` names the lines",
    ),
    State.STARTING: Words("its first readings are incomplete"),
}

CAUSE_WORDS = {
    Cause.NONE: Words(),
    Cause.NO_ANSWER: Words(
        "its chips do not answer", "its plug, its supply, its address straps, and whether this is its channel"
    ),
    Cause.BUS_STUCK: Words(
        "it holds SDA or SCL low as soon as it is connected",
        "short in its cable or plug, and whether its chips have power",
    ),
    Cause.WRONG_CHIP: Words(
        "another chip answers at the converter's address", "what is plugged in there, and the key `board`"
    ),
    Cause.NEVER_FINISHES: Words("its converter does not finish its conversions", "its 3.3 V supply", "busy"),
    Cause.SETTINGS_LOST: Words(
        "a chip does not hold its settings",
        "the supply of its chips, and the RESET pin of switches; or a loose contact",
        "reset",
    ),
    Cause.CORRUPT: Words(
        "its answers are those of no healthy chip", "pull-ups, cable length and ground of this leg", "corrupt"
    ),
    Cause.ELEMENT_OPEN: Words(
        "single elements have lost their electrode", "the foot's plug, then the elements' traces", "open"
    ),
    Cause.ELEMENT_SHORTED: Words(
        "an element reads more than the others explain", "whether its electrodes touch; its trace", "short"
    ),
    Cause.ELEMENT_STUCK: Words("an element no longer moves, not even by its noise", "its solder joints"),
    Cause.ELEMENT_DRIFTS: Words(
        "an element's baseline has drifted from the others'", "water or dirt in its gap; then tare the foot"
    ),
    Cause.ROW_OPEN: Words(
        "the line of a row is interrupted",
        "the plug, then the row's traces or its switch",
        "open",
    ),
    Cause.COLUMN_OPEN: Words(
        "the line of a column is interrupted",
        "the plug, then the column's traces and the chip's pins",
        "open",
    ),
    Cause.OVERLOAD: Words(
        "elements are loaded beyond their range",
        "what presses the foot; if nothing does, water in a gap",
        "over",
    ),
    Cause.DELAYED: Words(
        "its readings came too late",
        "what else loads this computer or this bus, and the bus's pull-ups and clock",
        "late",
    ),
    Cause.CANNOT_EXCITE: Words(),
    Cause.CALIBRATION_STALE: Words(),
    Cause.NOISY: Words(
        "its readings are noisy",
        "motor cables beside its cable, its shield, and what `footsense probe` shows with motors on",
    ),
}

#: State and cause that a reading of a leg's chips gives the leg, the most severe last.
STATE_AND_CAUSE_OF_READING = {
    Reading.DELAYED: (State.STALE, Cause.DELAYED),
    Reading.NOT_READY: (State.CONVERTER_FAULT, Cause.NEVER_FINISHES),
    Reading.CORRUPT: (State.CONVERTER_FAULT, Cause.CORRUPT),
    Reading.MISCONFIGURED: (State.CONVERTER_FAULT, Cause.SETTINGS_LOST),
    Reading.WRONG_CHIP: (State.ABSENT, Cause.WRONG_CHIP),
    Reading.BUS_STUCK: (State.ABSENT, Cause.BUS_STUCK),
    Reading.NO_ANSWER: (State.ABSENT, Cause.NO_ANSWER),
}

#: Whether a reading is of a leg whose foot does not answer, by its code, shape (256,): it may come back with another
#: foot.
IS_SILENT: Mask = np.isin(
    np.arange(256),
    [reading for reading, (state, _) in STATE_AND_CAUSE_OF_READING.items() if state is State.ABSENT],
)


def words_of_reading(reading: Reading) -> Words:
    """Return the words for the cause that a faulty reading of a leg's chips shows."""
    return CAUSE_WORDS[STATE_AND_CAUSE_OF_READING[reading][1]]


def word_of(code: IntEnum) -> str:
    """Return a code's name in words.

    Example:
        >>> word_of(State.ELEMENT_FAULT)
        'element fault'
    """
    return code.name.lower().replace("_", " ")


def contact_word(contact: bool | None) -> str:  # noqa: FBT001 - a state, not an option
    """Return what a foot does, as far as it is known: `contact`, `swing`, or nothing."""
    return "" if contact is None else "contact" if contact else "swing"


def phase_of(state: State) -> LegPhase:
    """Return the operating phase that a leg state belongs to."""
    if state is State.NO_BASELINE:
        return LegPhase.STARTING
    return LegPhase.__members__.get(state.name, LegPhase.FAULTED)
