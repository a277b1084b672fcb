"""Sets of missing elements that the network is trained for: none, any single one, any row or column."""

import numpy as np
from numpy.typing import NDArray

from footsense.frames import ELEMENTS, Mask

_ELEMENTS = np.arange(ELEMENTS)

#: The rows, then the columns, as sets of elements, shape (6, 9).
LINES: Mask = np.array([n == _ELEMENTS // 3 for n in range(3)] + [n == _ELEMENTS % 3 for n in range(3)])
ROWS, COLUMNS = LINES[:3], LINES[3:]
#: Every set, the empty one first, shape (16, 9).
MISSING_SETS: Mask = np.concatenate([np.zeros((1, ELEMENTS), bool), np.eye(ELEMENTS, dtype=bool), LINES])

_BITS = 1 << _ELEMENTS
_INDEX_OF = np.zeros(1 << ELEMENTS, np.intp)
_INDEX_OF[MISSING_SETS @ _BITS] = np.arange(len(MISSING_SETS))


def missing_set_index(missing: Mask) -> NDArray[np.intp]:
    """Return the index in `MISSING_SETS` of each leg's missing elements, shape (legs,); 0 also for any other set.

    Example:
        >>> MISSING_SETS[missing_set_index(np.array([[1, 1, 1, 0, 0, 0, 0, 0, 0]], bool))[0]].astype(int).tolist()
        [1, 1, 1, 0, 0, 0, 0, 0, 0]
    """
    index: NDArray[np.intp] = _INDEX_OF[missing @ _BITS]
    return index
