"""Open elements: which inputs count as missing, and the crosstalk of a floating row.

Pressing only adds capacitance, so an element that has lost half of its unloaded capacitance is an open line.
"""

import numpy as np

from footsense.estimation.faults.missing_sets import LINES
from footsense.frames import ELEMENTS, Mask, Vector

#: Capacitance below which an element is open, over its unloaded capacitance [1].
OPEN_REL = 0.5


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
    """Return the crosstalk of undriven rows into the readings of the other rows [pF], shape (legs, 9).

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
