"""Imputation (linear prediction) of missing closures from the foot's other elements.

Of all linear estimates x_m = A x_o the one with the least squared error over the loads of a foot is
A = S_mo S_oo^-1, with S = E[x x^T] of the closures. A linear read-out of the imputed closures is then the best linear
estimate from those that remain; the network gets the mask of the imputed ones and does the rest.
"""

import numpy as np

from footsense.frames import Mask, Vector


class Imputation:
    """Linear imputation of missing closures from the foot's other elements.

    Args:
        moments: S, second moments of the closures of all elements over the gap [1], symmetric and positive
            definite, shape (elements, elements); its scale does not matter.
    """

    def __init__(self, moments: Vector) -> None:
        self._moments = moments
        self._matrices: dict[bytes, Vector] = {}

    def matrix(self, missing: Mask) -> Vector:
        """Return the matrix F, shape (elements, elements), that gives the imputed closures F @ closures.

        Args:
            missing: Missing elements, shape (elements,). Their entries of x have no influence, but must be finite.
        """
        key = missing.tobytes()
        if key not in self._matrices:
            kept = ~missing
            matrix = np.diag(kept.astype(float))
            if missing.any() and kept.any():
                read = self._moments[np.ix_(kept, kept)]
                matrix[np.ix_(missing, kept)] = np.linalg.solve(read, self._moments[np.ix_(kept, missing)]).T
            self._matrices[key] = matrix
        return self._matrices[key]

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
