"""State, cause and fault mask of every leg, from its elements, its closures and its baseline."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from footsense.estimation.alignment.scan_by_scan import AlignedSample
from footsense.estimation.faults.consistency import ConsistencyResult
from footsense.estimation.faults.element_status import ElementStatus
from footsense.estimation.faults.missing_sets import COLUMNS, ROWS
from footsense.foot.network_card import TrainedInputs
from footsense.frames import ELEMENTS, USABLE, BaselineDrift, Cause, Reading, State

Mask = NDArray[np.bool_]
Codes = NDArray[np.uint8]

#: Largest distance of an element's drift from the mean of its leg's [pF]: all drift by 30 fF over 20 K, and elements
#: differ in that by a fifth.
DRIFT_LIMIT_PF = 20e-3

_BITS = (1 << np.arange(ELEMENTS)).astype(np.uint16)
#: By state: to search the few usable ones for each leg costs ten times as much.
_IS_USABLE = np.isin(np.arange(256), sorted(USABLE))

#: State and cause of a leg by the readings of its elements, the most severe last.
_BY_READING = {
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
SILENT = np.array([Reading.NO_ANSWER, Reading.BUS_STUCK, Reading.WRONG_CHIP], np.uint8)


class ElementFaults(NamedTuple):
    """Faulty elements by kind, shape (legs, 9) each.

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
        """Elements with any fault."""
        return self.opened | self.shorted | self.stuck | self.drifting


class LegStatus(NamedTuple):
    """Status of every leg, shape (legs,) each; fields as in `ContactFrame`.

    Attributes:
        state: Whether its force may be used, and if not, why.
        usable: Whether its force may be used.
        fault_mask: Elements that are not usable.
        cause: Cause of the state.
        t_ns: Time of its measurement [ns]; 0 without one.
        all_usable: Whether every leg is usable.
        in_range: Whether no element of any leg has a closed gap or is out of the trained range.
    """

    state: Codes
    usable: Mask
    fault_mask: NDArray[np.uint16]
    cause: Codes
    t_ns: NDArray[np.int64]
    all_usable: bool
    in_range: bool


class LegClassifier:
    """Classifies the legs frame by frame.

    Args:
        n_legs: Legs in a frame.
        trained: Range of closures that the network was trained for.
        gap_um: Air gap of each element [um], shape (legs, 9).
        max_age_ns: Age of the oldest reading from which a measurement is stale [ns].

    Attributes:
        stopped: Legs that a command has stopped, shape (legs,).
    """

    def __init__(
        self, n_legs: int, trained: TrainedInputs, gap_um: NDArray[np.float64], max_age_ns: int
    ) -> None:
        self.stopped: Mask = np.zeros(n_legs, bool)
        self._closure_min_rel = trained.closure_rel_min
        self._closure_max_rel = trained.usable_max_rel(gap_um)
        self._gap_closed_rel = trained.gap_closed_rel(gap_um)
        self._max_age_ns = max_age_ns
        # Of healthy legs; shared by their frames and never written to.
        self._valid = np.full(n_legs, State.VALID, np.uint8)
        self._all = np.ones(n_legs, bool)
        self._no_fault = np.zeros(n_legs, np.uint16)

    def classify(
        self,
        reading: Codes,
        elements: ElementStatus,
        missing: Mask,
        sample: AlignedSample,
        measured_rel: NDArray[np.float64],
        consistency: ConsistencyResult,
        untared: Mask,
        untared_legs: Mapping[int, State],
        drift_cause: Codes,
        now_ns: int,
    ) -> LegStatus:
        """Classify the legs of a frame.

        Args:
            reading: How each element answered, shape (legs, 9).
            elements: Status of the elements.
            missing: Elements missing before the consistency test, shape (legs, 9).
            sample: The elements as of one time.
            measured_rel: Measured closures over the gap [1], shape (legs, 9).
            consistency: Result of the consistency test.
            untared: Elements without a baseline on legs that have others, shape (legs, 9).
            untared_legs: State of every leg without a baseline, by row.
            drift_cause: Cause of each leg by the drift of its baseline, shape (legs,).
            now_ns: Current time [ns].
        """
        out_of_range = (measured_rel < self._closure_min_rel) | (measured_rel > self._closure_max_rel)
        in_range = not np.count_nonzero(out_of_range)
        oldest_ns = min(sample.oldest_ns.tolist())
        fresh = oldest_ns > 0 and now_ns - oldest_ns <= self._max_age_ns
        aligned = np.count_nonzero(sample.time_aligned) == len(sample.time_aligned)
        # A leg without a baseline has no closures, and fails the consistency test.
        if (
            elements.ok
            and consistency.ok
            and fresh
            and aligned
            and in_range
            and not np.count_nonzero(self.stopped)
        ):
            return LegStatus(
                self._valid,
                self._all,
                self._no_fault,
                drift_cause,
                sample.t_ns,
                all_usable=True,
                in_range=True,
            )
        excluded = consistency.stuck | consistency.drifting
        shorted = elements.over_range & (missing | excluded)
        faulty = elements.opened | untared | excluded | (consistency.missing & ~missing)
        kept = ~consistency.missing
        closed = measured_rel > self._gap_closed_rel
        state = self._valid.copy()
        state[~kept.all(axis=1) | (consistency.inconsistency_rel > 0.0)] = State.DEGRADED
        state[(out_of_range & kept).any(axis=1)] = State.OUT_OF_RANGE
        state[(now_ns - sample.oldest_ns > self._max_age_ns) | ~sample.time_aligned] = State.STALE
        for leg, untared_state in untared_legs.items():
            state[leg] = untared_state
        state[(state == State.TARING) & ~sample.time_aligned] = State.STARTING
        converter_states(state, reading, faulty & kept, closed & kept | elements.over_range & ~shorted)
        state[self.stopped] = State.STOPPED
        faults = ElementFaults(elements.opened, shorted, consistency.stuck, consistency.drifting)
        usable = _IS_USABLE[state]
        return LegStatus(
            state=state,
            usable=usable,
            fault_mask=fault_mask((reading != 0) | faulty | closed),
            cause=causes(reading, state, faults, drift_cause),
            t_ns=np.where(sample.oldest_ns > 0, sample.t_ns, 0),
            all_usable=bool(usable.all()),
            in_range=in_range,
        )


def fault_mask(unusable: Mask) -> NDArray[np.uint16]:
    """Return bit e for each unusable element e of each leg, shape (legs,).

    Example:
        >>> unusable = np.zeros((1, 9), bool)
        >>> unusable[0, [0, 8]] = True
        >>> bin(int(fault_mask(unusable)[0]))
        '0b100000001'
    """
    masks: NDArray[np.uint16] = unusable @ _BITS
    return masks


def converter_states(state: Codes, reading: Codes, faulty: Mask, closed: Mask) -> None:
    """Write the states that forbid any value over `state`, shape (legs,), the most severe last.

    Args:
        state: The states so far.
        reading: How each element answered, shape (legs, 9).
        faulty: Faulty elements that the network cannot do without, shape (legs, 9).
        closed: Elements pressed beyond their range, shape (legs, 9).
    """
    if closed.any():
        state[closed.any(axis=1)] = State.SATURATED
    if faulty.any():
        state[faulty.any(axis=1)] = State.ELEMENT_FAULT
    if reading.any():
        for kind, (worse, _) in _BY_READING.items():
            state[(reading == kind).any(axis=1)] = worse


def drift_causes(drift: BaselineDrift) -> Codes:
    """Return ELEMENT_DRIFTS for legs with an element whose drift differs from the others', else NONE, shape (legs,)."""
    apart = np.abs(drift.worst_pf - drift.mean_pf) > DRIFT_LIMIT_PF
    return np.where(apart, np.uint8(Cause.ELEMENT_DRIFTS), np.uint8(Cause.NONE))


def causes(reading: Codes, state: Codes, faults: ElementFaults, drift_cause: Codes) -> Codes:
    """Return the cause of each leg's state, shape (legs,), NONE where no fault is known.

    An open line shows as all three of its elements being open. A shorted element ties its column to its row and takes
    the other two elements of its column along.

    Args:
        reading: How each element answered, shape (legs, 9).
        state: State of each leg, shape (legs,).
        faults: Faulty elements.
        drift_cause: Causes by the drift of the baselines, as of `drift_causes`: told, though it is still followed.
    """
    cause = drift_cause.copy()
    cause[state == State.SATURATED] = Cause.GAP_CLOSED
    if faults.any.any():
        cause[faults.drifting.any(axis=1)] = Cause.ELEMENT_DRIFTS
        cause[faults.stuck.any(axis=1)] = Cause.ELEMENT_STUCK
        cause[faults.opened.any(axis=1)] = Cause.ELEMENT_OPEN
        for lines, broken in ((COLUMNS, Cause.COLUMN_OPEN), (ROWS, Cause.ROW_OPEN)):
            for line in lines:
                cause[faults.opened[:, line].all(axis=1)] = broken
        cause[faults.shorted.any(axis=1)] = Cause.ELEMENT_SHORTED
    if reading.any():
        for kind, (_, reason) in _BY_READING.items():
            cause[(reading == kind).any(axis=1)] = reason
    return cause
