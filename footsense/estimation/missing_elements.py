"""Missing elements: the sets that the network is trained for, and the imputation of their closures from the others.

The sets are none, any single element, any row and any column.

Of all linear estimates x_m = A x_o of the missing closures the one with the least squared error over the loads of a
foot is A = S_mo S_oo^-1, with S = E[x x^T] of the closures. A linear read-out of the imputed closures is then the best
linear estimate from those that remain; the network gets the mask of the imputed ones and does the rest.
"""

import math
from collections.abc import Callable
from functools import lru_cache, wraps
from itertools import product
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from footsense.frames import ELEMENTS, ROWS, Mask, Vector

_ELEMENT = np.arange(ELEMENTS)
#: The elements of each row, and of each column, shape (3, 9) each.
ROW_SETS: Mask = np.arange(ROWS)[:, None] == _ELEMENT // ROWS
COLUMN_SETS: Mask = np.arange(ROWS)[:, None] == _ELEMENT % ROWS
#: Every set, the empty one first, then the single elements, rows, and columns, shape (16, 9).
MISSING_SETS: Mask = np.concatenate(
    [np.zeros((1, ELEMENTS), bool), np.eye(ELEMENTS, dtype=bool), ROW_SETS, COLUMN_SETS]
)

#: Elements of a foot that may be overloaded under a force: as many as in the windows of the training.
MAX_OVERLOADED = 3

_PATTERNS: Mask = np.array(list(product((False, True), repeat=ELEMENTS)))[:, ::-1]
#: Which sets contain each pattern, shape (512, 16).
CONTAINING: Mask = np.logical_and.reduce(_PATTERNS[:, None] <= MISSING_SETS, axis=2)
#: Number of the smallest set that contains each pattern, the first of those; 0, the empty one, where no set does.
SMALLEST_CONTAINING: NDArray[np.intp] = CONTAINING.argmax(axis=1)


def patterns_of(elements: Mask) -> NDArray[np.uint16]:
    """Return masks of elements, shape (..., elements), as numbers, shape (...): bit e for element e.

    Example:
        >>> elements = np.zeros((1, 9), bool)
        >>> elements[0, [0, 8]] = True
        >>> bin(int(patterns_of(elements)[0]))
        '0b100000001'
    """
    patterns: NDArray[np.uint16] = np.packbits(elements, axis=-1, bitorder="little").view("<u2")[..., 0]
    return patterns


_R = TypeVar("_R")


def remembered(function: Callable[..., _R]) -> Callable[..., _R]:
    """Return a function of masks of shape (legs, elements) that remembers its last results, which are not written to.

    What is found of elements seldom changes, and to look it up takes less than one operation of numpy.
    """

    @lru_cache
    def of_bytes(*masks: bytes) -> _R:
        return function(*(np.frombuffer(mask, np.bool_).reshape(-1, ELEMENTS) for mask in masks))

    return wraps(function)(lambda *masks: of_bytes(*map(np.ndarray.tobytes, masks)))


@remembered
def missing_sets_containing(*faulty: Mask) -> Mask:
    """Return the mask of elements left out, shape (legs, elements): a faulty one, or the whole line of several.

    An element is faulty that is in any of the masks. A leg whose faulty elements do not lie in one row or column gets
    none: the network is not trained for that.

    Example:
        >>> two_of_row_0 = np.zeros((1, 9), bool)
        >>> two_of_row_0[0, [0, 2]] = True
        >>> missing_sets_containing(two_of_row_0)[0].astype(int).tolist()
        [1, 1, 1, 0, 0, 0, 0, 0, 0]
    """
    return MISSING_SETS[SMALLEST_CONTAINING[patterns_of(np.logical_or.reduce(faulty))]]


def _residual_matrices(moments: Vector) -> Vector:
    """Return the matrices that give residuals of closures, one for each pattern of unknown elements."""
    known = ~_PATTERNS
    are_known = known[:, :, None] & known[:, None, :]
    ones = _PATTERNS[..., None] * np.eye(ELEMENTS)
    precision = np.linalg.inv(np.where(are_known, moments, ones))
    of_known = np.where(are_known, precision, 0.0)
    predicting = np.where(_PATTERNS[:, :, None] & known[:, None, :], moments, 0.0) @ of_known
    scale = np.diagonal(precision, axis1=-2, axis2=-1)[..., None]
    matrices: Vector = of_known / scale + ones - predicting
    return matrices


class Imputation:
    """Linear prediction of closures from the foot's other elements.

    Args:
        moments: S, second moments of the closures of all elements over the gap [1], symmetric and positive
            definite, shape (elements, elements); its scale does not matter.
    """

    def __init__(self, moments: Vector) -> None:
        self._moments = moments
        # The matrices of each mask of missing elements.
        self._imputing: dict[bytes, Vector] = {}
        #: Amplification by each of `MISSING_SETS`.
        self.error_amplification = np.array([self._error_amplification(each) for each in MISSING_SETS])
        #: The matrices that give the differences of closures from their predictions by those that are known, one for
        #: each pattern of unknown elements, shape (512, 9, 9).
        self.residuals = _residual_matrices(moments)

    def matrix(self, missing: Mask) -> Vector:
        """Return the matrix F, shape (elements, elements), that gives the imputed closures F @ closures.

        Args:
            missing: Missing elements, shape (elements,). Their entries of x have no influence, but must be finite.
        """
        key = missing.tobytes()
        if key not in self._imputing:
            kept = ~missing
            self._imputing[key] = matrix = np.diag(kept.astype(float))
            if missing.any() and kept.any():
                read = self._moments[np.ix_(kept, kept)]
                matrix[np.ix_(missing, kept)] = np.linalg.solve(read, self._moments[np.ix_(kept, missing)]).T
        return self._imputing[key]

    def _error_amplification(self, missing: Mask) -> float:
        # How far one wrong reading moves the closures at most, those imputed from it included, over itself [1].
        # With the paper's foot 1.7 at most beside a missing element, 1.2 beside a middle line, 4.0 beside an outer one.
        return float(np.linalg.norm(self.matrix(missing), axis=0).max())

    def impute(self, closure_rel: Vector, missing: Mask) -> Vector:
        """Return the closures with the missing ones imputed, same shape.

        Args:
            closure_rel: Closures over the gap [1], shape (n, elements); anything where missing, NaN included.
            missing: Missing elements, shape (elements,).
        """
        imputed: Vector = np.where(missing, 0.0, closure_rel) @ self.matrix(missing).T
        return imputed


def trimmed_means(closure_rel: Vector) -> list[float]:
    """Return each leg's mean gap closure [1], without the leg's largest and smallest closure.

    Args:
        closure_rel: Closures over the gap [1], shape (legs, elements), NaN where there is none.

    Returns:
        Mean of each leg [1]; NaN for a leg with fewer than three closures.

    Example:
        >>> import numpy as np
        >>> trimmed_means(np.array([[0.0, 1.0, 2.0, 9.0, np.nan]]))
        [1.5]
    """
    means_rel = []
    for closures_rel in closure_rel.tolist():
        finite = closures_rel
        if not math.isfinite(sum(closures_rel)):
            finite = [closure for closure in closures_rel if math.isfinite(closure)]
        finite.sort()
        means_rel.append(sum(finite[1:-1]) / (len(finite) - 2) if len(finite) > 2 else math.nan)
    return means_rel
