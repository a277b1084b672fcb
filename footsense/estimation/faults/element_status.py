"""Status of every element by its reading alone: usable, open, over range, or missing for the network.

Pressing only adds capacitance, so an element that has lost half of its unloaded capacitance is an open line. Whether a
possible reading is the right one is decided by `consistency.py`.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from firmware_interface import fdc1004
from footsense.estimation.faults.missing_sets import LINES
from footsense.frames import ELEMENTS, CapFrame, Reading

Vector = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: Capacitance below which an element is open, over its unloaded capacitance [1].
OPEN_REL = 0.5
#: Least capacitance of an element over the range of an FDC1004 [pF].
RANGE_END_PF = fdc1004.capacitance_pf(fdc1004.CODE_MAX)


class ElementStatus(NamedTuple):
    """Status of every element in a frame, shape (legs, 9) each.

    Attributes:
        capacitance_pf: Capacitances without stray [pF], NaN where there is none to be used.
        opened: Elements whose electrode is disconnected.
        over_range: Elements above the converter's range.
        faulty: Elements that are open, or excluded by the consistency test.
        missing: Elements that a tare and the network do without.
        ok: Whether no reading of the frame has a fault.
    """

    capacitance_pf: Vector
    opened: Mask
    over_range: Mask
    faulty: Mask
    missing: Mask
    ok: bool


class ElementClassifier:
    """Classifies the elements frame by frame.

    Args:
        stray_pf: Known capacitance in parallel with each element [pF], shape (legs, 9).
        unloaded_pf: Expected reading of each element of the free foot, without stray [pF], shape (legs, 9).
        range_end_pf: Least capacitance of an element over the converter's range [pF].
    """

    def __init__(self, stray_pf: Vector, unloaded_pf: Vector, range_end_pf: float = RANGE_END_PF) -> None:
        self._stray_pf = stray_pf
        self._range_end_pf = range_end_pf
        self._open_below_pf = OPEN_REL * unloaded_pf
        self._none: Mask = np.zeros(stray_pf.shape, bool)
        self._opened = self._none
        self._any_opened = False

    def classify(self, scan: CapFrame, excluded: Mask, baseline_pf: Vector) -> ElementStatus:
        """Classify the elements of a frame.

        Args:
            scan: The frame.
            excluded: Elements that the consistency test excludes, shape (legs, 9).
            baseline_pf: Baselines [pF], shape (legs, 9), NaN where there is none.
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
            missing = missing_elements(excluded)
            return ElementStatus(capacitance_pf, self._none, self._none, excluded, missing, ok=True)
        over_range = scan.reading == Reading.OVER_RANGE
        if over_range.any():  # at least that much: the consistency test decides whether it can be
            capacitance_pf = np.where(over_range, self._range_end_pf - self._stray_pf, capacitance_pf)
        if self._any_opened:
            capacitance_pf = capacitance_pf - floating_pf(scan.capacitance_pf, opened)
        # A line that breaks or returns was intact for a part of the scan, and so was its effect on other elements.
        unsettled = opened | (opened != before).any(axis=1, keepdims=True)
        faulty = opened | excluded
        # Pressed or shorted? The other closures tell, and without a baseline there are none.
        missing = missing_elements(faulty | over_range & np.isnan(baseline_pf))
        # A parabola through an unsettled reading would take the element's return for a load.
        settled_pf = np.where(unsettled, np.nan, capacitance_pf)
        return ElementStatus(settled_pf, opened, over_range, faulty, missing, ok=False)


def missing_elements(faulty: Mask) -> Mask:
    """Return the elements that the network has to do without, shape (legs, 9): a faulty one, or the faulty ones' line.

    A leg whose faulty elements do not lie in one row or column gets none: the network is not trained for that.

    Example:
        >>> two_of_row_0 = np.zeros((1, 9), bool)
        >>> two_of_row_0[0, [0, 2]] = True
        >>> missing_elements(two_of_row_0)[0].astype(int).tolist()
        [1, 1, 1, 0, 0, 0, 0, 0, 0]
    """
    if not np.count_nonzero(faulty):
        return faulty
    missing = np.zeros_like(faulty)
    for leg in np.flatnonzero(faulty.any(axis=1)):
        if faulty[leg].sum() == 1:
            missing[leg] = faulty[leg]
            continue
        for line in LINES:
            if not (faulty[leg] & ~line).any():
                missing[leg] = line
    return missing


def floating_pf(capacitance_pf: Vector, opened: Mask) -> Vector:
    """Return what rows that nothing drives add to the readings of the other rows [pF], shape (legs, 9).

    A row whose three elements are open has lost its line. Its electrodes float, and each column sees them in series
    with their small capacitance to ground whichever row is selected: as much as the open element itself reads. An open
    element under the converter's range is on a board that grounds unselected columns: nothing is added there.

    Args:
        capacitance_pf: Readings, stray included [pF], shape (legs, 9), NaN under the range.
        opened: Open elements, shape (legs, 9).
    """
    floating = opened.reshape(-1, 3, 3).all(axis=2, keepdims=True)
    readings_pf = capacitance_pf.reshape(-1, 3, 3)
    per_column_pf = np.where(floating & ~np.isnan(readings_pf), readings_pf, 0.0).sum(axis=1, keepdims=True)
    added_pf: Vector = np.where(floating, 0.0, per_column_pf).reshape(-1, ELEMENTS)
    return added_pf
