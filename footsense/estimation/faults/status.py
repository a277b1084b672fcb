"""Status of every element and of every leg in a frame.

An element is classified by its reading alone: usable, open, over range, or missing for the network. Whether a possible
reading is the right one is decided by `consistency.py`. A leg is classified by its elements, closures and baseline.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from firmware_interface.chips import fdc1004
from footsense.estimation.faults.causes import ElementFaults, leg_causes, set_states_without_force
from footsense.estimation.faults.consistency import ConsistencyResult
from footsense.estimation.faults.missing_sets import fault_mask, missing_sets_containing
from footsense.estimation.faults.open_elements import OPEN_ELEMENT_THRESHOLD_REL, floating_row_crosstalk_pf
from footsense.estimation.reading_window import Readings
from footsense.foot.files.network_card import TrainedInputs
from footsense.frames import IS_USABLE_STATE, CapFrame, Codes, Mask, Reading, Stamps, State, Vector

#: Least capacitance of an element over the range of an FDC1004 [pF].
CONVERTER_MAX_PF = fdc1004.capacitance_pf(fdc1004.CODE_MAX)


class ElementStatus(NamedTuple):
    """Status of every element in a frame: open, over range, faulty, missing; shape (legs, elements) each.

    Attributes:
        capacitance_pf: Capacitances without stray [pF], NaN where there is none to be used.
        opened: Elements whose electrode is disconnected.
        over_range: Elements above the converter's range.
        faulty: Elements that are open, or excluded by the consistency test.
        missing: Elements that a tare and the network do without.
        all_readings_ok: Whether no reading of the frame has a fault.
    """

    capacitance_pf: Vector
    opened: Mask
    over_range: Mask
    faulty: Mask
    missing: Mask
    all_readings_ok: bool


class ElementClassifier:
    """Determines the status of every element of a frame.

    Args:
        stray_pf: Known capacitance in parallel with each element [pF], shape (legs, elements).
        unloaded_pf: Expected reading of each element of the free foot, without stray [pF], shape (legs, elements).
        range_end_pf: Least capacitance of an element over the converter's range [pF].
    """

    def __init__(self, stray_pf: Vector, unloaded_pf: Vector, range_end_pf: float = CONVERTER_MAX_PF) -> None:
        self._stray_pf = stray_pf
        self._range_end_pf = range_end_pf
        self._open_below_pf = OPEN_ELEMENT_THRESHOLD_REL * unloaded_pf
        self._none: Mask = np.zeros(stray_pf.shape, bool)
        self._opened = self._none
        self._any_opened = False

    def classify(self, scan: CapFrame, excluded: Mask, baseline_pf: Vector) -> ElementStatus:
        """Return the status of the elements of a frame.

        Args:
            scan: The frame.
            excluded: Elements that the consistency test excludes, shape (legs, elements).
            baseline_pf: Baselines [pF], shape (legs, elements), NaN where there is none.
        """
        capacitance_pf = scan.capacitance_pf - self._stray_pf
        # NaN compares as False: an element that was not read is not open.
        opened = capacitance_pf < self._open_below_pf
        all_ok = not np.count_nonzero(scan.reading)
        if not all_ok:
            opened |= scan.reading == Reading.UNDER_RANGE
        before, self._opened = self._opened, opened
        any_before, self._any_opened = self._any_opened, bool(np.count_nonzero(opened))
        if all_ok and not (self._any_opened or any_before):
            missing = missing_sets_containing(excluded) if np.count_nonzero(excluded) else excluded
            return ElementStatus(
                capacitance_pf, self._none, self._none, excluded, missing, all_readings_ok=True
            )
        over_range = scan.reading == Reading.OVER_RANGE
        if over_range.any():  # at least that much: the consistency test decides whether it can be
            capacitance_pf = np.where(over_range, self._range_end_pf - self._stray_pf, capacitance_pf)
        if self._any_opened:
            capacitance_pf = capacitance_pf - floating_row_crosstalk_pf(scan.capacitance_pf, opened)
        # A line that breaks or returns was intact for a part of the scan, and so was its effect on other elements.
        unsettled = opened | (opened != before).any(axis=1, keepdims=True)
        faulty = opened | excluded
        # Pressed or shorted? The other closures tell, and without a baseline there are none.
        missing = missing_sets_containing(faulty | over_range & np.isnan(baseline_pf))
        # In the window, an unsettled reading would be a step of the load.
        settled_pf = np.where(unsettled, np.nan, capacitance_pf)
        return ElementStatus(settled_pf, opened, over_range, faulty, missing, all_readings_ok=False)


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
        n_legs: Legs in a frame.
        trained: Range of closures that the network was trained for.
        gap_um: Air gap of each element [um], shape (legs, elements).
        max_age_ns: Age of the oldest reading from which a measurement is stale [ns].

    Attributes:
        stopped: Legs that a command has stopped, shape (legs,).
    """

    def __init__(self, n_legs: int, trained: TrainedInputs, gap_um: Vector, max_age_ns: int) -> None:
        self.stopped: Mask = np.zeros(n_legs, bool)
        # One row per leg: to broadcast a single one takes twice as long as the comparison.
        self._closure_min_rel = np.tile(trained.closure_rel_min, (n_legs, 1))
        self._closure_max_rel = trained.max_usable_closure_rel(gap_um)
        self._gap_closed_threshold_over_design_gap = trained.gap_closed_threshold_over_design_gap(gap_um)
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
        readings: Readings,
        interrupted_legs: Mask,
        measured_rel: Vector,
        consistency: ConsistencyResult,
        untared: Mask,
        untared_legs: Mapping[int, State],
        drift_cause: Codes,
        now_ns: int,
    ) -> LegStatus:
        """Return the state, cause and faults of every leg of a frame.

        Args:
            reading: How each element answered, shape (legs, elements).
            elements: Status of the elements.
            missing: Elements missing before the consistency test, shape (legs, elements).
            readings: The last readings of the elements.
            interrupted_legs: Legs with more incomplete windows than the network can do without, shape (legs,).
            measured_rel: Measured closures over the gap [1], shape (legs, elements).
            consistency: Result of the consistency test.
            untared: Elements without a baseline on legs that have others, shape (legs, elements).
            untared_legs: State of every leg without a baseline, by row.
            drift_cause: Cause of each leg by the drift of its baseline, shape (legs,).
            now_ns: Current time [ns].
        """
        out_of_range = (measured_rel < self._closure_min_rel) | (measured_rel > self._closure_max_rel)
        oldest_ns = min(readings.oldest_of_newest_ns.tolist())
        fresh = oldest_ns > 0 and now_ns - oldest_ns <= self._max_age_ns
        # A leg without a baseline has no closures, and fails the consistency test.
        if (
            elements.all_readings_ok
            and consistency.is_all_ok
            and fresh
            and not np.count_nonzero(interrupted_legs)
            and not np.count_nonzero(out_of_range)
            and not np.count_nonzero(self.stopped)
        ):
            return LegStatus(
                self._valid,
                self._all,
                self._no_fault,
                drift_cause,
                readings.newest_ns,
                all_healthy=True,
            )
        excluded = consistency.stuck | consistency.drifting
        shorted = elements.over_range & (missing | excluded)
        faulty = elements.opened | untared | excluded | (consistency.missing & ~missing)
        kept = ~consistency.missing
        closed = measured_rel > self._gap_closed_threshold_over_design_gap
        state = self._valid.copy()
        state[~kept.all(axis=1) | consistency.unexplained_legs] = State.DEGRADED
        state[(out_of_range & kept).any(axis=1)] = State.OUT_OF_RANGE
        state[(now_ns - readings.oldest_of_newest_ns > self._max_age_ns) | interrupted_legs] = State.STALE
        for leg, untared_state in untared_legs.items():
            state[leg] = untared_state
        state[(state == State.TARING) & interrupted_legs] = State.STARTING
        set_states_without_force(
            state, reading, faulty & kept, closed & kept | elements.over_range & ~shorted
        )
        state[self.stopped] = State.STOPPED
        faults = ElementFaults(elements.opened, shorted, consistency.stuck, consistency.drifting)
        return LegStatus(
            state=state,
            usable=IS_USABLE_STATE[state],
            fault_mask=fault_mask((reading != 0) | faulty | closed),
            cause=leg_causes(reading, state, faults, drift_cause),
            t_ns=readings.newest_ns,
            all_healthy=False,
        )
