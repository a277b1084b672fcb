"""Open elements (lost electrodes), and the crosstalk that a floating row causes.

Pressing only adds capacitance, so an element that has lost half of its unloaded capacitance is an open line.
"""

import numpy as np

from footsense.frames import ROWS, Mask, Vector

#: Capacitance below which an element is open, over its unloaded capacitance [1].
OPEN_ELEMENT_THRESHOLD_REL = 0.5


def floating_row_crosstalk_pf(capacitance_pf: Vector, opened: Mask) -> Vector:
    """Return the crosstalk of floating rows into the readings of the others [pF], shape (legs, elements).

    A row whose elements are open has lost its line. Its electrodes float, and each column sees them in series
    with their small capacitance to ground whichever row is selected: as much as the open element itself reads. An open
    element under the converter's range is on a board that grounds unselected columns: nothing is added there.

    Args:
        capacitance_pf: Readings, stray included [pF], shape (legs, elements), NaN under the range.
        opened: Open elements, shape (legs, elements).
    """
    floating = opened.reshape(-1, ROWS, ROWS).all(axis=2, keepdims=True)
    readings_pf = capacitance_pf.reshape(-1, ROWS, ROWS)
    per_column_pf = np.where(floating & ~np.isnan(readings_pf), readings_pf, 0.0).sum(axis=1, keepdims=True)
    added_pf: Vector = np.where(floating, 0.0, per_column_pf).reshape(opened.shape)
    return added_pf
