"""State, cause and faulty elements of every leg: what follows from the findings of a cycle."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from footsense.estimation.missing_elements import (
    COLUMN_SETS,
    MAX_OVERLOADED,
    ROW_SETS,
    patterns_of,
)
from footsense.frames import ELEMENTS, Cause, Codes, Mask, Reading, State
from footsense.leg_words import STATE_AND_CAUSE_OF_READING

# Of each code of a reading: how severe it is, 0 for none that faults a leg; and of that state and cause.
_SEVERITY = np.zeros(max(Reading) + 1, np.intp)
_SEVERITY[list(STATE_AND_CAUSE_OF_READING)] = np.arange(1, len(STATE_AND_CAUSE_OF_READING) + 1)
_STATE_OF_SEVERITY, _CAUSE_OF_SEVERITY = np.array([(0, 0), *STATE_AND_CAUSE_OF_READING.values()], np.uint8).T
# Of each pattern of open elements: what is open. An open line shows as all three of its elements being open.
_OPEN_CAUSE = np.full(1 << ELEMENTS, Cause.ELEMENT_OPEN, np.uint8)
_OPEN_CAUSE[0] = Cause.NONE
for _sets, _cause in ((COLUMN_SETS, Cause.COLUMN_OPEN), (ROW_SETS, Cause.ROW_OPEN)):
    for _line in patterns_of(_sets):
        _OPEN_CAUSE[(np.arange(len(_OPEN_CAUSE)) & _line) == _line] = _cause
# Plain numbers: to store an enumeration's member in an array costs a microsecond each time.
_VALID, _DEGRADED, _OUT_OF_RANGE, _STALE, _SATURATED, _ELEMENT_FAULT, _STOPPED = map(
    int,
    (
        State.VALID,
        State.DEGRADED,
        State.OUT_OF_RANGE,
        State.STALE,
        State.SATURATED,
        State.ELEMENT_FAULT,
        State.STOPPED,
    ),
)
_NONE, _OVERLOAD, _DRIFTS, _STUCK, _SHORTED, _DELAYED = map(
    int,
    (
        Cause.NONE,
        Cause.OVERLOAD,
        Cause.ELEMENT_DRIFTS,
        Cause.ELEMENT_STUCK,
        Cause.ELEMENT_SHORTED,
        Cause.DELAYED,
    ),
)


class LegRecord(NamedTuple):
    """What the stages of the estimation have found in a cycle; masks of shape (legs, elements) unless said.

    Attributes:
        reading: How each element answered.
        opened: Elements whose electrode is disconnected.
        over_range: Elements above the converter's range.
        untared: Elements without a baseline, of legs that have others.
        unusable: Sets of elements that the network does without by their readings and baselines.
        excluded: Elements that contradict the others.
        stuck: Those of them that do not follow the load.
        interrupted: Elements that it does without for readings that do not follow on one another.
        missing: All that it does without.
        overloaded: Elements that are closed at least as far as they read.
        below: Elements that are closed less than the network was trained for.
        is_interrupted: Legs of which it cannot do without all elements with interrupted readings, shape (legs,).
        is_old: Legs whose oldest reading is too old, shape (legs,).
        is_stopped: Legs that a command has stopped, shape (legs,).
        untared_states: State of each leg without a baseline, by its row.
        cause: Cause of each leg by noise and drift, shape (legs,).
    """

    reading: Codes
    opened: Mask
    over_range: Mask
    untared: Mask
    unusable: Mask
    excluded: Mask
    stuck: Mask
    interrupted: Mask
    missing: Mask
    overloaded: Mask
    below: Mask
    is_interrupted: Mask
    is_old: Mask
    is_stopped: Mask
    untared_states: dict[int, State]
    cause: Codes


def states_and_causes(record: LegRecord) -> tuple[Codes, NDArray[np.uint16], Codes]:
    """Return the most severe state of every leg, the mask of its faulty elements, and the cause."""
    faulty = record.opened | record.untared | record.excluded | record.interrupted
    kept = ~record.missing
    overloaded = record.overloaded & kept
    patterns = patterns_of(
        np.array(
            [
                record.missing | overloaded,
                overloaded,
                record.below & kept,
                faulty & kept,
                record.excluded & ~record.stuck,
                record.stuck,
                # It ties its column to its row, and takes the other two elements of its column along.
                record.over_range & (record.unusable | record.excluded),
                record.opened,
                (record.reading != 0) | faulty | record.overloaded,
            ]
        )
    )
    is_degraded, is_overloaded, is_below, is_faulty, drifts, is_stuck, is_shorted, _, _ = patterns > 0
    severity = np.maximum.reduce(_SEVERITY[record.reading], axis=1)
    state = np.where(is_degraded, np.uint8(_DEGRADED), np.uint8(_VALID))
    state[is_below] = _OUT_OF_RANGE
    state[record.is_old | record.is_interrupted] = _STALE
    for leg, untared_state in record.untared_states.items():
        starts = untared_state is State.TARING and record.is_interrupted[leg]
        state[leg] = State.STARTING if starts else untared_state
    state[np.add.reduce(overloaded, axis=1) > MAX_OVERLOADED] = _SATURATED
    state[is_faulty] = _ELEMENT_FAULT
    has_reading = severity > 0
    state = np.where(has_reading, _STATE_OF_SEVERITY[severity], state)
    state[record.is_stopped] = _STOPPED
    cause = record.cause.copy()
    cause[is_overloaded] = _OVERLOAD
    cause[drifts] = _DRIFTS
    cause[is_stuck] = _STUCK
    *_, opened, fault_mask = patterns
    cause = np.where(opened > 0, _OPEN_CAUSE[opened], cause)
    cause[is_shorted] = _SHORTED
    cause = np.where(has_reading, _CAUSE_OF_SEVERITY[severity], cause)
    cause[(state == _STALE) & (cause == _NONE)] = _DELAYED
    return state, fault_mask, cause
