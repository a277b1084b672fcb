"""Missing elements: the sets that the network is trained for, and the imputation of their closures from the others.

The sets are none, any single element, any row and any column.

Of all linear estimates x_m = A x_o of the missing closures the one with the least squared error over the loads of a
foot is A = S_mo S_oo^-1, with S = E[x x^T] of the closures. A linear read-out of the imputed closures is then the best
linear estimate from those that remain; the network gets the mask of the imputed ones and does the rest.
"""

import math

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

# Bit of each element in a pattern of elements.
_BITS = (1 << _ELEMENT).astype(np.uint16)
_PATTERNS = (np.arange(1 << ELEMENTS)[:, None] & _BITS) > 0
# Smallest set that contains each pattern, the first of those; the empty one where no set does.
_CONTAINS = ~(_PATTERNS[:, None] & ~MISSING_SETS).any(axis=2)
_SMALLEST_SUPERSET: Mask = MISSING_SETS[_CONTAINS.argmax(axis=1)]


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
        self._residual: dict[bytes, Vector] = {}

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

    def residual_matrix(self, missing: Mask) -> Vector:
        """Return the matrix R, shape (elements, elements), that gives the residuals R @ closures of the others.

        Each is the difference of a closure from its prediction by all others that are not missing.

        Args:
            missing: Missing elements, shape (elements,).
        """
        key = missing.tobytes()
        if key not in self._residual:
            kept = np.flatnonzero(~missing)
            self._residual[key] = matrix = np.zeros_like(self._moments)
            precision = np.linalg.inv(self._moments[np.ix_(kept, kept)])
            matrix[np.ix_(kept, kept)] = precision / precision.diagonal()[:, None]
        return self._residual[key]

    def impute(self, closure_rel: Vector, missing: Mask) -> Vector:
        """Return the closures with the missing ones imputed, same shape.

        Args:
            closure_rel: Closures over the gap [1], shape (n, k, elements) or (n, elements);
                anything where missing, NaN included.
            missing: Missing elements, shape (n, elements).
        """
        if not missing.any():
            return closure_rel
        imputed = np.where(missing if closure_rel.ndim == 2 else missing[:, None], 0.0, closure_rel)
        for row in np.flatnonzero(missing.any(axis=1)):
            imputed[row] = imputed[row] @ self.matrix(missing[row]).T
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
