"""State, cause and faulty elements of every leg in a frame in which not every leg is healthy."""

import numpy as np
from numpy.typing import NDArray

from footsense.estimation.baseline import BaselineTracker
from footsense.estimation.elements import ConsistencyTest, ElementStatus
from footsense.estimation.missing_elements import (
    COLUMN_SETS,
    MAX_OVERLOADED,
    ROW_SETS,
    fault_mask,
    missing_sets_containing,
)
from footsense.estimation.network import Readings
from footsense.foot.network_card import TrainedInputs
from footsense.frames import Cause, Codes, Mask, State, Vector
from footsense.leg_words import STATE_AND_CAUSE_OF_READING


class LegStateClassifier:
    """Determines the state of every leg of a frame.

    Args:
        trained: Range of closures that the network was trained for.
        gap_um: Air gap of each element [um], shape (legs, elements).
        max_age_ns: Age of the oldest reading from which a measurement is stale [ns].
        baselines: Baselines of the legs.
        consistency: Consistency test of their elements.

    Attributes:
        stopped: Legs that a command has stopped, shape (legs,).
        closure_min_rel: Least closures over the gap that the network can use [1], shape (legs, elements).
        closure_max_rel: Largest ones [1], same shape; a larger one is an overload.
    """

    def __init__(
        self,
        trained: TrainedInputs,
        gap_um: Vector,
        max_age_ns: int,
        baselines: BaselineTracker,
        consistency: ConsistencyTest,
    ) -> None:
        n_legs = len(gap_um)
        # One row per leg: to broadcast a single one takes twice as long as the comparison.
        self.closure_min_rel = np.tile(trained.closure_rel_min, (n_legs, 1))
        self.closure_max_rel = trained.max_usable_closure_rel(gap_um)
        self._max_age_ns = max_age_ns
        self._baselines, self._consistency = baselines, consistency
        self.stopped: Mask = np.zeros(n_legs, bool)

    def classify(
        self,
        reading: Codes,
        elements: ElementStatus,
        unusable: Mask,
        missing: Mask,
        overloaded: Mask,
        interrupted_legs: Mask,
        closure_rel: Vector,
        readings: Readings,
        now_ns: int,
    ) -> tuple[Codes, NDArray[np.uint16], Codes]:
        """Return the most severe state of every leg, the mask of its faulty elements, and the cause.

        Args:
            reading: How each element answered, shape (legs, elements).
            elements: Status of the elements.
            unusable: Elements that the network does without, whatever the consistency test finds.
            missing: Elements that it does without.
            overloaded: Elements over the converter's range or above `closure_max_rel`, shape (legs, elements).
            interrupted_legs: Legs of which it cannot do without all elements with interrupted readings, shape (legs,).
            closure_rel: Measured closures over the gap [1], shape (legs, elements).
            readings: The last readings of the elements.
            now_ns: Current time [ns].
        """
        baselines, excluded, stuck = self._baselines, self._consistency.excluded, self._consistency.stuck
        shorted = elements.over_range & (unusable | excluded)
        left_out = excluded | missing & ~missing_sets_containing(unusable | excluded)
        faulty = elements.opened | baselines.unloaded.untared_elements_of_tared_legs | left_out
        kept = ~missing
        n_overloaded = (overloaded & kept).sum(axis=1)
        state = np.full(len(reading), State.VALID, np.uint8)
        state[missing.any(axis=1) | (n_overloaded > 0)] = State.DEGRADED
        state[((closure_rel < self.closure_min_rel) & kept).any(axis=1)] = State.OUT_OF_RANGE
        state[(now_ns - readings.oldest_of_newest_ns > self._max_age_ns) | interrupted_legs] = State.STALE
        for leg, untared_state in baselines.tares.states.items():
            state[leg] = untared_state
        state[(state == State.TARING) & interrupted_legs] = State.STARTING
        state[n_overloaded > MAX_OVERLOADED] = State.SATURATED
        state[(faulty & kept).any(axis=1)] = State.ELEMENT_FAULT
        if reading.any():
            for kind, (worse, _) in STATE_AND_CAUSE_OF_READING.items():
                state[(reading == kind).any(axis=1)] = worse
        state[self.stopped] = State.STOPPED
        cause = baselines.unloaded.cause.copy()
        cause[n_overloaded > 0] = Cause.OVERLOAD
        cause[(excluded & ~stuck).any(axis=1)] = Cause.ELEMENT_DRIFTS
        cause[stuck.any(axis=1)] = Cause.ELEMENT_STUCK
        cause[elements.opened.any(axis=1)] = Cause.ELEMENT_OPEN
        # An open line shows as all three of its elements being open. A shorted element ties its column to its row and
        # takes the other two elements of its column along.
        for lines, broken in ((COLUMN_SETS, Cause.COLUMN_OPEN), (ROW_SETS, Cause.ROW_OPEN)):
            for line in lines:
                cause[elements.opened[:, line].all(axis=1)] = broken
        cause[shorted.any(axis=1)] = Cause.ELEMENT_SHORTED
        if reading.any():
            for kind, (_, reason) in STATE_AND_CAUSE_OF_READING.items():
                cause[(reading == kind).any(axis=1)] = reason
        cause[(state == State.STALE) & (cause == Cause.NONE)] = Cause.DELAYED
        return state, fault_mask((reading != 0) | faulty | overloaded), cause
