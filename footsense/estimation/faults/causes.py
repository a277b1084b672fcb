"""States and causes reported for faulty legs."""

from typing import NamedTuple

import numpy as np

from footsense.estimation.faults.missing_sets import COLUMN_SETS, ROW_SETS
from footsense.frames import BaselineDrift, Cause, Codes, Mask, Reading, State
from footsense.leg_words import STATE_AND_CAUSE_OF_READING

#: Largest distance of an element's drift from the mean of its leg's [pF]: all drift by 30 fF over 20 K, and elements
#: differ in that by a fifth.
MAX_DRIFT_FROM_LEG_MEAN_PF = 20e-3

#: Readings of a leg whose foot does not answer: it may come back with another foot.
SILENT_READINGS = np.array([Reading.NO_ANSWER, Reading.BUS_STUCK, Reading.WRONG_CHIP], np.uint8)


class ElementFaults(NamedTuple):
    """Faulty elements by type of fault, shape (legs, elements) each.

    Attributes:
        opened: The electrode is disconnected.
        shorted: Over the converter's range, while the other elements are not pressed like that.
        stuck: The reading does not follow the load.
        drifting: The reading follows the load with an offset.
    """

    opened: Mask
    shorted: Mask
    stuck: Mask
    drifting: Mask

    @property
    def any(self) -> Mask:
        """Mask of the elements with any fault (open, shorted, stuck, drifting)."""
        return self.opened | self.shorted | self.stuck | self.drifting


def set_states_without_force(state: Codes, reading: Codes, faulty: Mask, closed: Mask) -> None:
    """Set, in `state`, shape (legs,), the states of legs whose readings forbid any force, the most severe last.

    Args:
        state: The states so far.
        reading: How each element answered, shape (legs, elements).
        faulty: Faulty elements that the network cannot do without, shape (legs, elements).
        closed: Elements pressed beyond their range, shape (legs, elements).
    """
    if closed.any():
        state[closed.any(axis=1)] = State.SATURATED
    if faulty.any():
        state[faulty.any(axis=1)] = State.ELEMENT_FAULT
    if reading.any():
        for kind, (worse, _) in STATE_AND_CAUSE_OF_READING.items():
            state[(reading == kind).any(axis=1)] = worse


def drift_causes(drift: BaselineDrift) -> Codes:
    """Return ELEMENT_DRIFTS for each leg with an element that drifts unlike the others, else NONE, shape (legs,)."""
    apart = np.abs(drift.worst_pf - drift.mean_pf) > MAX_DRIFT_FROM_LEG_MEAN_PF
    return np.where(apart, np.uint8(Cause.ELEMENT_DRIFTS), np.uint8(Cause.NONE))


def leg_causes(reading: Codes, state: Codes, faults: ElementFaults, drift_cause: Codes) -> Codes:
    """Return the cause of each leg's state, shape (legs,); NONE without a known fault.

    An open line shows as all three of its elements being open. A shorted element ties its column to its row and takes
    the other two elements of its column along.

    Args:
        reading: How each element answered, shape (legs, elements).
        state: State of each leg, shape (legs,).
        faults: Faulty elements.
        drift_cause: Causes by drift, as of `drift_causes`; a baseline still follows such a drift.
    """
    cause = drift_cause.copy()
    cause[state == State.SATURATED] = Cause.GAP_CLOSED
    if faults.any.any():
        cause[faults.drifting.any(axis=1)] = Cause.ELEMENT_DRIFTS
        cause[faults.stuck.any(axis=1)] = Cause.ELEMENT_STUCK
        cause[faults.opened.any(axis=1)] = Cause.ELEMENT_OPEN
        for lines, broken in ((COLUMN_SETS, Cause.COLUMN_OPEN), (ROW_SETS, Cause.ROW_OPEN)):
            for line in lines:
                cause[faults.opened[:, line].all(axis=1)] = broken
        cause[faults.shorted.any(axis=1)] = Cause.ELEMENT_SHORTED
    if reading.any():
        for kind, (_, reason) in STATE_AND_CAUSE_OF_READING.items():
            cause[(reading == kind).any(axis=1)] = reason
    cause[(state == State.STALE) & (cause == Cause.NONE)] = Cause.DELAYED
    return cause
