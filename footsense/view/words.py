"""Texts for the page: meaning and remedy of each state and cause."""

from typing import Any

from footsense.frames import FAULT_FREE, BaselineStatus, Cause, Slip, State
from footsense.leg_phase import phase_of
from footsense.view.events import enum_words

#: Meaning of each state, and what to do where a cause says nothing better.
_STATE_TEXTS = {
    State.ABSENT: ("its chips do not answer", "its plug, its 3.3 V, and whether this is its channel"),
    State.VALID: ("its force may be used", ""),
    State.NO_BASELINE: ("no tare has succeeded yet", "lift the foot off the ground, and tare it"),
    State.TARING: ("a tare is being taken", "keep the foot in the air, and still"),
    State.SATURATED: ("a gap is closed, or a code is at the end of its range", "what presses the foot"),
    State.ELEMENT_FAULT: (
        "elements give no number, too many to do without them",
        "the foot's plug; `footsense probe` names the lines",
    ),
    State.CONVERTER_FAULT: ("its converter answers, but its conversions do not finish", "its 3.3 V supply"),
    State.STALE: ("its measurement is older than the limit", "what else loads this computer or this bus"),
    State.OUT_OF_RANGE: (
        "its load is outside those that the network was trained on",
        "whether the load is one that this foot is made for",
    ),
    State.STOPPED: ("it was stopped by command", "the command START publishes its forces again"),
    State.DEGRADED: (
        "its force comes from fewer elements, with a larger sigma",
        "the foot's plug; `footsense probe` names the lines",
    ),
    State.STARTING: ("its first readings are incomplete", ""),
}

#: Each cause in words, and what to check: as `footsense probe` has it.
_CAUSE_TEXTS = {
    Cause.NO_ANSWER: ("its chips do not answer", "its plug, its 3.3 V, and whether this is its channel"),
    Cause.BUS_STUCK: (
        "it holds SDA or SCL low as soon as it is connected",
        "short in its cable or plug, and whether its chips have power",
    ),
    Cause.WRONG_CHIP: (
        "another chip answers at the converter's address",
        "what is plugged in there, and `board` in the configuration",
    ),
    Cause.NEVER_FINISHES: ("its converter does not finish its conversions", "its 3.3 V supply"),
    Cause.SETTINGS_LOST: (
        "a chip does not hold its settings",
        "the supply of its chips and the switches' RESET pin; or a loose contact",
    ),
    Cause.CORRUPT: (
        "its answers are such as no healthy chip gives",
        "pull-ups, cable length and ground of this leg",
    ),
    Cause.ELEMENT_OPEN: (
        "single elements have lost their electrode",
        "the foot's plug, then the traces of these elements",
    ),
    Cause.ELEMENT_SHORTED: (
        "an element reads more than any load can cause",
        "whether its electrodes touch, and the trace of its column",
    ),
    Cause.ELEMENT_STUCK: ("an element no longer moves, not even by its noise", "its solder joints"),
    Cause.ELEMENT_DRIFTS: (
        "an element's baseline has drifted away from the others'",
        "water or dirt in its gap; then tare the foot",
    ),
    Cause.ROW_OPEN: ("the line of a row is interrupted", "the plug, then the row's trace and its switch"),
    Cause.COLUMN_OPEN: (
        "the line of a column is interrupted",
        "the plug, then the column's trace and the converter's pin",
    ),
    Cause.GAP_CLOSED: (
        "a gap is closed: more load than the foot can measure",
        "water in the gap, and what presses the foot",
    ),
    Cause.DELAYED: ("its readings came too late", "what else loads this computer or this bus"),
    Cause.CANNOT_EXCITE: (
        "its converter cannot drive the rows",
        "a row line that is shorted or leaks to ground",
    ),
    Cause.CALIBRATION_STALE: (
        "its loads or elements no longer match its calibration; the force is unchanged",
        "wear of the foot; `footsense calibrate` makes a new calibration",
    ),
}


def code_texts() -> dict[str, Any]:
    """Return the texts of all codes: meaning and remedy of states and causes, names of baseline statuses and slips."""
    return {
        "states": [
            {
                "name": enum_words(state.name),
                "phase": phase_of(state).name.lower(),
                "fault_free": state in FAULT_FREE,
                "what": _STATE_TEXTS[state][0],
                "check": _STATE_TEXTS[state][1],
            }
            for state in State
        ],
        "causes": [
            {"name": enum_words(cause.name), "what": what, "check": check}
            for cause in Cause
            for what, check in [_CAUSE_TEXTS.get(cause, ("", ""))]
        ],
        "baselines": [enum_words(status.name) for status in BaselineStatus],
        "slips": [enum_words(slip.name) for slip in Slip],
    }
