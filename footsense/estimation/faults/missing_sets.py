"""Sets of missing elements that the network is trained for: none, any single one, any row or column."""

import numpy as np
from numpy.typing import NDArray

from footsense.frames import ELEMENTS, Mask

_ELEMENTS = np.arange(ELEMENTS)

#: The rows, then the columns, as sets of elements, shape (6, 9).
ROWS_AND_COLUMNS: Mask = np.array(
    [n == _ELEMENTS // 3 for n in range(3)] + [n == _ELEMENTS % 3 for n in range(3)]
)
ROWS, COLUMNS = ROWS_AND_COLUMNS[:3], ROWS_AND_COLUMNS[3:]
#: Every set, the empty one first, shape (16, 9).
MISSING_SETS: Mask = np.concatenate(
    [np.zeros((1, ELEMENTS), bool), np.eye(ELEMENTS, dtype=bool), ROWS_AND_COLUMNS]
)

#: Bit of each element in a pattern of elements.
_ELEMENT_BITS = (1 << _ELEMENTS).astype(np.uint16)
_SET_INDEX_OF_PATTERN = np.zeros(1 << ELEMENTS, np.intp)
_SET_INDEX_OF_PATTERN[MISSING_SETS @ _ELEMENT_BITS] = np.arange(len(MISSING_SETS))
#: Smallest set that contains each of the 512 patterns; the empty one where no set does.
_PATTERNS = (np.arange(1 << ELEMENTS)[:, None] & _ELEMENT_BITS) > 0
_SMALLEST_CONTAINING_SET = MISSING_SETS[(~(_PATTERNS[:, None] & ~MISSING_SETS).any(axis=2)).argmax(axis=1)]


def missing_set_index(missing: Mask) -> NDArray[np.intp]:
    """Return the index in `MISSING_SETS` of each leg's missing elements, shape (legs,); 0 also for any other set.

    Example:
        >>> MISSING_SETS[missing_set_index(np.array([[1, 1, 1, 0, 0, 0, 0, 0, 0]], bool))[0]].astype(int).tolist()
        [1, 1, 1, 0, 0, 0, 0, 0, 0]
    """
    index: NDArray[np.intp] = _SET_INDEX_OF_PATTERN[missing @ _ELEMENT_BITS]
    return index


def missing_elements(faulty: Mask) -> Mask:
    """Return the elements that the network has to do without, shape (legs, 9): a faulty one, or the faulty ones' line.

    A leg whose faulty elements do not lie in one row or column gets none: the network is not trained for that.

    Example:
        >>> two_of_row_0 = np.zeros((1, 9), bool)
        >>> two_of_row_0[0, [0, 2]] = True
        >>> missing_elements(two_of_row_0)[0].astype(int).tolist()
        [1, 1, 1, 0, 0, 0, 0, 0, 0]
    """
    missing: Mask = _SMALLEST_CONTAINING_SET[faulty @ _ELEMENT_BITS]
    return missing


def fault_mask(unusable: Mask) -> NDArray[np.uint16]:
    """Return bit e for each unusable element e of each leg, shape (legs,).

    Example:
        >>> unusable = np.zeros((1, 9), bool)
        >>> unusable[0, [0, 8]] = True
        >>> bin(int(fault_mask(unusable)[0]))
        '0b100000001'
    """
    masks: NDArray[np.uint16] = unusable @ _ELEMENT_BITS
    return masks
