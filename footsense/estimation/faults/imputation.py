"""An element that cannot be read: its closure is filled in with what the others say of it.

Of all linear guesses x_m = A x_o the one with the least squared error over the loads that a foot may see is
A = S_mo S_oo^-1, with S = E[x x^T] of the closures. Whoever reads the force linearly from the filled closures then
reads the best linear estimate from those that remain; the network is told what was filled in and does the rest.
"""

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]


class Filling:
    """Fills in missing closures.

    Args:
        moments: S, second moments of the closures of all nine elements over the gap [1], symmetric and positive
            definite, shape (9, 9); its scale does not matter.
    """

    def __init__(self, moments: Vector) -> None:
        self._moments = moments
        self._known: dict[bytes, Vector] = {}

    def matrix(self, missing: NDArray[np.bool_]) -> Vector:
        """Return the matrix that makes filled closures of those with anything in the missing places.

        Args:
            missing: Elements that cannot be read, shape (9,).

        Returns:
            Matrix F for F @ x, shape (9, 9); what stands in the missing places of x has no influence, but has to be
            a number.
        """
        key = missing.tobytes()
        if key not in self._known:
            kept = ~missing
            matrix = np.diag(kept.astype(float))
            if missing.any() and kept.any():
                read = self._moments[np.ix_(kept, kept)]
                matrix[np.ix_(missing, kept)] = np.linalg.solve(read, self._moments[np.ix_(kept, missing)]).T
            self._known[key] = matrix
        return self._known[key]

    def fill(self, closure_rel: Vector, missing: NDArray[np.bool_]) -> Vector:
        """Return closures with the missing ones filled in, shape (n, 9).

        Args:
            closure_rel: Closures over the gap [1], shape (n, 9); anything, NaN included, where missing.
            missing: Elements that cannot be read, shape (n, 9).
        """
        if not missing.any():
            return closure_rel
        filled = np.where(missing, 0.0, closure_rel)
        for row in np.flatnonzero(missing.any(axis=1)):
            filled[row] = self.matrix(missing[row]) @ filled[row]
        return filled
