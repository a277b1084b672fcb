"""Sets of missing elements for which the network is trained: none, any single one, any row or column."""

import numpy as np
from numpy.typing import NDArray

from footsense.frames import ELEMENTS, ROWS, Mask

_ELEMENT = np.arange(ELEMENTS)
#: The elements of each row, and of each column, shape (3, 9) each.
ROW_SETS: Mask = np.arange(ROWS)[:, None] == _ELEMENT // ROWS
COLUMN_SETS: Mask = np.arange(ROWS)[:, None] == _ELEMENT % ROWS
#: Every set, the empty one first, then the single elements, rows, and columns, shape (16, 9).
MISSING_SETS: Mask = np.concatenate(
    [np.zeros((1, ELEMENTS), bool), np.eye(ELEMENTS, dtype=bool), ROW_SETS, COLUMN_SETS]
)

# Bit of each element in a pattern of elements.
_BITS = (1 << _ELEMENT).astype(np.uint16)
_PATTERNS = (np.arange(1 << ELEMENTS)[:, None] & _BITS) > 0
# Index of the set of each pattern; 0 also where it is no set.
_SET_INDEX = np.zeros(1 << ELEMENTS, np.intp)
_SET_INDEX[MISSING_SETS @ _BITS] = np.arange(len(MISSING_SETS))
# Smallest set that contains each pattern, the first of those; the empty one where no set does.
_CONTAINS = ~(_PATTERNS[:, None] & ~MISSING_SETS).any(axis=2)
_SMALLEST_SUPERSET: Mask = MISSING_SETS[_CONTAINS.argmax(axis=1)]


def missing_set_index(missing: Mask) -> NDArray[np.intp]:
    """Return the index of the set of each leg's missing elements, shape (legs,); 0 for an untrained set.

    Example:
        >>> MISSING_SETS[missing_set_index(np.array([[1, 1, 1, 0, 0, 0, 0, 0, 0]], bool))[0]].astype(int).tolist()
        [1, 1, 1, 0, 0, 0, 0, 0, 0]
    """
    index: NDArray[np.intp] = _SET_INDEX[missing @ _BITS]
    return index


def missing_sets_containing(faulty: Mask) -> Mask:
    """Return the mask of elements left out, shape (legs, elements): a faulty one, or the whole line of several.

    A leg whose faulty elements do not lie in one row or column gets none: the network is not trained for that.

    Example:
        >>> two_of_row_0 = np.zeros((1, 9), bool)
        >>> two_of_row_0[0, [0, 2]] = True
        >>> missing_sets_containing(two_of_row_0)[0].astype(int).tolist()
        [1, 1, 1, 0, 0, 0, 0, 0, 0]
    """
    missing: Mask = _SMALLEST_SUPERSET[faulty @ _BITS]
    return missing


def fault_mask(unusable: Mask) -> NDArray[np.uint16]:
    """Return a bit mask of each leg's unusable elements (bit e for element e), shape (legs,).

    Example:
        >>> unusable = np.zeros((1, 9), bool)
        >>> unusable[0, [0, 8]] = True
        >>> bin(int(fault_mask(unusable)[0]))
        '0b100000001'
    """
    masks: NDArray[np.uint16] = unusable @ _BITS
    return masks
