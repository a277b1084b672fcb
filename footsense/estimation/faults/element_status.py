"""What a frame's readings are worth by themselves, before anything is known of loads."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from footsense.estimation.faults import leg_status
from footsense.frames import CapFrame, Reading

Vector = NDArray[np.float64]
Mask = NDArray[np.bool_]


class Seen(NamedTuple):
    """The readings of a frame, shape (legs, 9) each.

    Attributes:
        settled_pf: Capacitances without stray [pF], NaN where there is none to be used.
        opened: Elements that have lost their electrode.
        over_range: Elements that read more than the converter can.
        faulty: Those that are open, and those that contradicted the others before.
        lacking: What a tare has to do without.
        well: Whether nothing is wrong with any reading.
    """

    settled_pf: Vector
    opened: Mask
    over_range: Mask
    faulty: Mask
    lacking: Mask
    well: bool


class Readings:
    """Looks at one frame after the other.

    Args:
        stray_pf: Known capacitance in parallel with each element [pF], shape (legs, 9).
        unloaded_pf: What each element of the free foot is expected to read, without stray [pF], shape (legs, 9).
        range_end_pf: What an element over the converter's range has at least [pF].
    """

    def __init__(
        self, stray_pf: Vector, unloaded_pf: Vector, range_end_pf: float = leg_status.RANGE_END_PF
    ) -> None:
        self._stray_pf = stray_pf
        self._range_end_pf = range_end_pf
        self._open_below_pf = leg_status.OPEN_REL * unloaded_pf
        self._none: Mask = np.zeros(stray_pf.shape, bool)
        self._opened = self._none
        self._any_opened = False

    def look(self, scan: CapFrame, remembered: Mask, baseline_pf: Vector) -> Seen:
        """Tell which readings may be used.

        Args:
            scan: The frame.
            remembered: Elements that contradicted the others before, shape (legs, 9).
            baseline_pf: Unloaded elements [pF], shape (legs, 9), NaN where that is not known.
        """
        capacitance_pf = scan.capacitance_pf - self._stray_pf
        # NaN compares as False: an element that was not read is neither open, shut nor out of range.
        opened = capacitance_pf < self._open_below_pf
        all_ok = not np.count_nonzero(scan.reading)
        if not all_ok:
            opened |= scan.reading == Reading.UNDER_RANGE
        before, self._opened = self._opened, opened
        any_before, self._any_opened = self._any_opened, bool(np.count_nonzero(opened))
        if all_ok and not (self._any_opened or any_before):
            lacking = leg_status.missing_elements(remembered)
            return Seen(capacitance_pf, self._none, self._none, remembered, lacking, well=True)
        over_range = scan.reading == Reading.OVER_RANGE
        if over_range.any():  # as much at least: whether that may be, the other elements tell
            capacitance_pf = np.where(over_range, self._range_end_pf - self._stray_pf, capacitance_pf)
        if self._any_opened:
            capacitance_pf = capacitance_pf - leg_status.floating_pf(scan.capacitance_pf, opened)
        # A line that breaks or returns was whole for a part of the scan, and what it does to the other elements too.
        unsettled = opened | (opened != before).any(axis=1, keepdims=True)
        faulty = opened | remembered
        # Whether an element over the range is pressed or shorted, the others' closures tell: none without a baseline.
        lacking = leg_status.missing_elements(faulty | over_range & np.isnan(baseline_pf))
        # What is open or unsettled has none: a line through its last one would take the element's return for a load.
        settled_pf = np.where(unsettled, np.nan, capacitance_pf)
        return Seen(settled_pf, opened, over_range, faulty, lacking, well=False)
