"""Brings the elements of a scan, which are converted one after the other, to one common time.

A foot's elements are read over 22 ms, and while a heel strikes the load changes by a sixth in that time. The order of
the scan cancels the false tilt of a force that grows evenly on all elements, but a leaning foot loads one row far more
than the others, and its shear is a small difference of large closures. So each element is moved along its own slope,
taken from its last two readings, to the mean time of the scan: those read before it by extrapolation, those after it
by interpolation. What grows linearly comes out exact; noise grows by 7 % rms over a scan of nine even steps.
"""

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]
Stamps = NDArray[np.int64]


class SkewRemoval:
    """Remembers each element's last reading.

    Args:
        n_legs: Legs in a scan.
        n_elements: Elements of a leg.
    """

    def __init__(self, n_legs: int, n_elements: int) -> None:
        self._closure = np.full((n_legs, n_elements), np.nan)
        self._t_ns = np.zeros((n_legs, n_elements), np.int64)

    def apply(self, closure: Vector, t_ns: Stamps) -> Vector:
        """Return every closure as of the mean stamp of its leg.

        Args:
            closure: Closures of a scan in any unit, shape (legs, elements), NaN where there is none.
            t_ns: Stamp of each [ns], same shape.

        Returns:
            Same shape; an element without a reading before it is taken as it is.

        Example:
            >>> skew = SkewRemoval(1, 2)
            >>> _ = skew.apply(np.array([[0.0, 1.0]]), np.array([[0, 10]]))
            >>> skew.apply(np.array([[2.0, 3.0]]), np.array([[20, 30]])).tolist()
            [[2.5, 2.5]]
        """
        elapsed_ns = np.maximum(t_ns - self._t_ns, 1)
        to_mean_ns = t_ns.sum(axis=1, keepdims=True) // t_ns.shape[1] - t_ns
        step = (closure - self._closure) * (to_mean_ns / elapsed_ns)
        self._closure, self._t_ns = closure, t_ns
        moved: Vector = closure + np.where(np.isfinite(step), step, 0.0)
        return moved
