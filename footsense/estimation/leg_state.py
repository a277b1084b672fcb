"""State, cause and faulty elements of every leg in a frame: of healthy legs at once, of others by `classify`."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from footsense.estimation.baseline import BaselineTracker
from footsense.estimation.elements import ConsistencyResult, ElementStatus
from footsense.estimation.missing_elements import COLUMN_SETS, ROW_SETS, fault_mask
from footsense.estimation.network import Readings
from footsense.foot.files.network_card import TrainedInputs
from footsense.frames import IS_USABLE_STATE, Cause, Codes, Mask, Stamps, State, Vector
from footsense.leg_words import STATE_AND_CAUSE_OF_READING


class LegStatus(NamedTuple):
    """Status of every leg in a frame, shape (legs,) each; fields as in `ContactFrame`.

    Attributes:
        state: Whether its force may be used, and if not, why.
        usable: Whether its force may be used.
        fault_mask: Elements that are not usable.
        cause: Cause of the state.
        t_ns: Time of its measurement [ns]; 0 without one.
        all_healthy: Whether every leg is valid without any fault.
    """

    state: Codes
    usable: Mask
    fault_mask: NDArray[np.uint16]
    cause: Codes
    t_ns: Stamps
    all_healthy: bool


class LegStateClassifier:
    """Determines the state of every leg of a frame.

    Args:
        trained: Range of closures that the network was trained for.
        gap_um: Air gap of each element [um], shape (legs, elements).
        max_age_ns: Age of the oldest reading from which a measurement is stale [ns].
        baselines: Baselines of the legs.

    Attributes:
        stopped: Legs that a command has stopped, shape (legs,).
        closure_min_rel, closure_max_rel: Closures over the gap that the network can use [1], shape (legs, elements).
        healthy: Status of legs that are all healthy, but for cause and time; never written to.
    """

    def __init__(
        self, trained: TrainedInputs, gap_um: Vector, max_age_ns: int, baselines: BaselineTracker
    ) -> None:
        n_legs = len(gap_um)
        # One row per leg: to broadcast a single one takes twice as long as the comparison.
        self.closure_min_rel = np.tile(trained.closure_rel_min, (n_legs, 1))
        self.closure_max_rel = trained.max_usable_closure_rel(gap_um)
        self._closed_rel = trained.gap_closed_threshold_over_design_gap(gap_um)
        self._max_age_ns = max_age_ns
        self._baselines = baselines
        self.stopped: Mask = np.zeros(n_legs, bool)
        self.healthy = LegStatus(
            state=np.full(n_legs, State.VALID, np.uint8),
            usable=np.ones(n_legs, bool),
            fault_mask=np.zeros(n_legs, np.uint16),
            cause=np.zeros(n_legs, np.uint8),
            t_ns=np.zeros(n_legs, np.int64),
            all_healthy=True,
        )

    def classify(
        self,
        reading: Codes,
        elements: ElementStatus,
        missing_before_test: Mask,
        consistency: ConsistencyResult,
        closure_rel: Vector,
        readings: Readings,
        now_ns: int,
    ) -> LegStatus:
        """Return the state, cause and faults of every leg of a frame, the most severe of each leg.

        Args:
            reading: How each element answered, shape (legs, elements).
            elements: Status of the elements.
            missing_before_test: Elements that the network did without before the consistency test.
            consistency: Result of the consistency test.
            closure_rel: Measured closures over the gap [1], shape (legs, elements).
            readings: The last readings of the elements.
            now_ns: Current time [ns].
        """
        unloaded, interrupted = self._baselines.unloaded, consistency.interrupted_legs
        excluded = consistency.stuck | consistency.drifting
        shorted = elements.over_range & (missing_before_test | excluded)
        isolated = consistency.missing & ~missing_before_test
        faulty = elements.opened | unloaded.untared_elements_of_tared_legs | excluded | isolated
        kept = ~consistency.missing
        out_of_range = (closure_rel < self.closure_min_rel) | (closure_rel > self.closure_max_rel)
        closed = closure_rel > self._closed_rel
        saturated = closed & kept | elements.over_range & ~shorted
        state = self.healthy.state.copy()
        state[~kept.all(axis=1) | consistency.unexplained_legs] = State.DEGRADED
        state[(out_of_range & kept).any(axis=1)] = State.OUT_OF_RANGE
        state[(now_ns - readings.oldest_of_newest_ns > self._max_age_ns) | interrupted] = State.STALE
        for leg, untared_state in self._baselines.untared_legs.items():
            state[leg] = untared_state
        state[(state == State.TARING) & interrupted] = State.STARTING
        state[saturated.any(axis=1)] = State.SATURATED
        state[(faulty & kept).any(axis=1)] = State.ELEMENT_FAULT
        if reading.any():
            for kind, (worse, _) in STATE_AND_CAUSE_OF_READING.items():
                state[(reading == kind).any(axis=1)] = worse
        state[self.stopped] = State.STOPPED
        cause = self._baselines.drift_cause.copy()
        cause[state == State.SATURATED] = Cause.GAP_CLOSED
        cause[consistency.drifting.any(axis=1)] = Cause.ELEMENT_DRIFTS
        cause[consistency.stuck.any(axis=1)] = Cause.ELEMENT_STUCK
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
        return LegStatus(
            state=state,
            usable=IS_USABLE_STATE[state],
            fault_mask=fault_mask((reading != 0) | faulty | closed),
            cause=cause,
            t_ns=readings.newest_ns,
            all_healthy=False,
        )
