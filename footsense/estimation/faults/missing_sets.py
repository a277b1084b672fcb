"""Sets of missing elements for which the network is trained: none, any single one, any row or column."""

import math
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from footsense.frames import ELEMENTS, Mask


class MissingSets(NamedTuple):
    """Trained sets of missing elements of a foot, as masks of its elements.

    Attributes:
        sets: Every set, the empty one first, then the single elements, rows, and columns, shape (1 + n + 2 r, n).
        row_sets: The elements of each row, shape (r, n).
        column_sets: The elements of each column, shape (r, n).
        bit_of_element: Bit of each element in a pattern of elements, shape (n,).
        set_index_of_pattern: Index in `sets` of each of the 2^n patterns; 0 also where it is no set.
        smallest_superset: Smallest set that contains each pattern; the empty one where no set does, shape (2^n, n).
    """

    sets: Mask
    row_sets: Mask
    column_sets: Mask
    bit_of_element: NDArray[np.uint16]
    set_index_of_pattern: NDArray[np.intp]
    smallest_superset: Mask


@cache
def trained_missing_sets(n_elements: int) -> MissingSets:
    """Return the trained sets of missing elements for a foot with this number of elements (at most 16)."""
    element, n_rows = np.arange(n_elements), math.isqrt(n_elements)
    rows, columns = (np.array([n == line for n in range(n_rows)]) for line in divmod(element, n_rows))
    none = np.zeros((1, n_elements), bool)
    sets: Mask = np.concatenate([none, np.eye(n_elements, dtype=bool), rows, columns])
    bits = (1 << element).astype(np.uint16)
    set_index_of_pattern = np.zeros(1 << n_elements, np.intp)
    set_index_of_pattern[sets @ bits] = np.arange(len(sets))
    patterns = (np.arange(1 << n_elements)[:, None] & bits) > 0
    # Set by set, the smaller ones last: all pairs at once would take a gigabyte of 16 elements.
    smallest = np.zeros(1 << n_elements, np.intp)
    for number in range(len(sets))[::-1]:
        smallest[~(patterns & ~sets[number]).any(axis=1)] = number
    return MissingSets(sets, rows, columns, bits, set_index_of_pattern, sets[smallest])


#: Every set of the paper's foot, shape (16, 9).
MISSING_SETS: Mask = trained_missing_sets(ELEMENTS).sets


def missing_set_index(missing: Mask) -> NDArray[np.intp]:
    """Return the index of the set of each leg's missing elements, shape (legs,); 0 for an untrained set.

    Example:
        >>> MISSING_SETS[missing_set_index(np.array([[1, 1, 1, 0, 0, 0, 0, 0, 0]], bool))[0]].astype(int).tolist()
        [1, 1, 1, 0, 0, 0, 0, 0, 0]
    """
    known = trained_missing_sets(missing.shape[1])
    index: NDArray[np.intp] = known.set_index_of_pattern[missing @ known.bit_of_element]
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
    known = trained_missing_sets(faulty.shape[1])
    missing: Mask = known.smallest_superset[faulty @ known.bit_of_element]
    return missing


def fault_mask(unusable: Mask) -> NDArray[np.uint16]:
    """Return a bit mask of each leg's unusable elements (bit e for element e), shape (legs,).

    Example:
        >>> unusable = np.zeros((1, 9), bool)
        >>> unusable[0, [0, 8]] = True
        >>> bin(int(fault_mask(unusable)[0]))
        '0b100000001'
    """
    masks: NDArray[np.uint16] = unusable @ trained_missing_sets(unusable.shape[1]).bit_of_element
    return masks
