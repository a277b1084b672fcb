"""State, cause and faulty elements of every leg: what follows from the findings of a cycle."""

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from footsense.estimation.missing_elements import COLUMN_SETS, MAX_OVERLOADED, ROW_SETS, patterns_of
from footsense.frames import ELEMENTS, Cause, Codes, Mask, Reading, State
from footsense.leg_words import STATE_AND_CAUSE_OF_READING

_COLUMNS, _ROWS = patterns_of(COLUMN_SETS).tolist(), patterns_of(ROW_SETS).tolist()
_OK = int(Reading.OK)


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
        cause: Cause of each leg by noise and drift, shape (legs,).
        untared_states: State of each leg without a baseline, by its row.
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
    cause: Codes
    untared_states: dict[int, State]


#: Fields of a record that are of elements, the first ones.
_N_OF_ELEMENTS = LegRecord._fields.index("is_interrupted")

_Found = tuple[Codes, NDArray[np.uint16], Codes]


class LegStates:
    """States, faulty elements and causes of all legs, which are derived anew when a finding has changed."""

    def __init__(self) -> None:
        self._key: tuple[object, ...] = ()
        self._found: _Found

    def observe(self, record: LegRecord) -> _Found:
        """Return the most severe state of each leg, the pattern of its faulty elements, and the cause."""
        *arrays, untared_states = record
        masks = tuple(map(np.ndarray.tobytes, arrays))
        key = masks, untared_states
        if key != self._key:
            self._key, self._found = key, _states_and_causes(record, b"".join(masks[:_N_OF_ELEMENTS]))
        return self._found


def _states_and_causes(record: LegRecord, of_elements: bytes) -> _Found:
    # Bytes and plain numbers of each leg: to look it up takes less than one operation of numpy.
    by_leg = np.frombuffer(of_elements, np.uint8).reshape(_N_OF_ELEMENTS, -1, ELEMENTS).transpose(1, 0, 2)
    in_turn, size = by_leg.tobytes(), _N_OF_ELEMENTS * ELEMENTS
    columns = record.is_interrupted, record.is_old, record.is_stopped, record.cause
    of_legs = [
        _of_leg(record.untared_states.get(leg, State.VALID), in_turn[size * leg : size * (leg + 1)], *values)
        for leg, values in enumerate(zip(*map(np.ndarray.tolist, columns), strict=True))
    ]
    states, fault_masks, causes = zip(*of_legs, strict=True)
    return np.array(states, np.uint8), np.array(fault_masks, np.uint16), np.array(causes, np.uint8)


# Of the last findings: what comes and goes, as an answer of a chip, does so many times.
@lru_cache
def _of_leg(untared_state: State, of_elements: bytes, *values: Any) -> tuple[int, int, int]:  # noqa: ANN401 - a row of the record
    """Return state, pattern of faulty elements, and cause of a leg."""
    patterns = patterns_of(np.frombuffer(of_elements, np.uint8).reshape(-1, ELEMENTS) != _OK)
    found: Any = LegRecord._make((*patterns.tolist(), *values, untared_state))
    missing, opened, excluded, stuck = found.missing, found.opened, found.excluded, found.stuck
    faulty = opened | found.untared | excluded | found.interrupted
    kept_overloaded = found.overloaded & ~missing
    if untared_state is State.TARING and found.is_interrupted:
        untared_state = State.STARTING
    state_of_reading, cause_of_reading = _of_readings(of_elements[:ELEMENTS])
    # The most severe last.
    state = _last_found(
        (True, State.VALID),
        (missing or kept_overloaded, State.DEGRADED),
        (found.below & ~missing, State.OUT_OF_RANGE),
        (found.is_old or found.is_interrupted, State.STALE),
        (untared_state is not State.VALID, untared_state),
        (kept_overloaded.bit_count() > MAX_OVERLOADED, State.SATURATED),
        (faulty & ~missing, State.ELEMENT_FAULT),
        (state_of_reading is not None, state_of_reading),
        (found.is_stopped, State.STOPPED),
    )
    cause = _last_found(
        (state == State.STALE, Cause.DELAYED),
        (found.cause, found.cause),
        (kept_overloaded, Cause.OVERLOAD),
        (excluded & ~stuck, Cause.ELEMENT_DRIFTS),
        (stuck, Cause.ELEMENT_STUCK),
        (opened, Cause.ELEMENT_OPEN),
        # An open line shows as all three of its elements being open.
        (any(opened & line == line for line in _COLUMNS), Cause.COLUMN_OPEN),
        (any(opened & line == line for line in _ROWS), Cause.ROW_OPEN),
        # It ties its column to its row, and takes the other two elements of its column along.
        (found.over_range & (found.unusable | excluded), Cause.ELEMENT_SHORTED),
        (cause_of_reading is not None, cause_of_reading),
    )
    # Plain numbers: to store an enumeration's member in an array costs a microsecond.
    return int(state), found.reading | faulty | found.overloaded, int(cause)


def _last_found(*found: tuple[object, int | None]) -> int:
    """Return the last code whose condition holds; NONE or ABSENT where none does."""
    return next((code for holds, code in reversed(found) if holds and code is not None), 0)


def _of_readings(reading: bytes) -> tuple[int | None, int | None]:
    """Return state and cause by the most severe reading of a leg; None where it has none that faults the leg."""
    of_found = [found for code, found in STATE_AND_CAUSE_OF_READING.items() if code in reading]
    return of_found[-1] if of_found else (None, None)
