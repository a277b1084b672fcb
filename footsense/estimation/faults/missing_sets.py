"""Which sets of missing elements the network knows: none, any single one, any row or column."""

import numpy as np
from numpy.typing import NDArray

from footsense.frames import ELEMENTS

Mask = NDArray[np.bool_]

_ELEMENTS = np.arange(ELEMENTS)

#: Every set, the empty one first, shape (16, 9).
KNOWN_MISSING: Mask = np.array(
    [np.zeros(ELEMENTS, bool)]
    + [n == _ELEMENTS for n in range(ELEMENTS)]
    + [n == _ELEMENTS // 3 for n in range(3)]
    + [n == _ELEMENTS % 3 for n in range(3)]
)
_BITS = 1 << _ELEMENTS
_NUMBER_OF = np.zeros(1 << ELEMENTS, np.intp)
_NUMBER_OF[KNOWN_MISSING @ _BITS] = np.arange(len(KNOWN_MISSING))


def known_missing(missing: Mask) -> NDArray[np.intp]:
    """Return the index in KNOWN_MISSING of what each leg lacks, shape (legs,); 0 also for a set that is not known.

    Example:
        >>> KNOWN_MISSING[known_missing(np.array([[1, 1, 1, 0, 0, 0, 0, 0, 0]], bool))[0]].astype(int).tolist()
        [1, 1, 1, 0, 0, 0, 0, 0, 0]
    """
    numbers: NDArray[np.intp] = _NUMBER_OF[missing @ _BITS]
    return numbers
