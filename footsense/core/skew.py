"""Brings the elements of a scan, which are converted one after the other, to one common time.

A foot's elements are read over 22 ms, and while a heel strikes the load changes by a sixth in that time. The order of
the scan cancels the false tilt of a force that grows evenly on all elements, but a leaning foot loads one row far more
than the others, and its shear is a small difference of large closures. So each element is moved along the parabola
through its last three readings to the mean time of the scan: those read before it by extrapolation, those after it by
interpolation. What changes with the square of time comes out exact. docs/adr/0005 has the figures.
"""

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]
Stamps = NDArray[np.int64]


class SkewRemoval:
    """Remembers each element's last two readings.

    Args:
        n_legs: Legs in a scan.
        n_elements: Elements of a leg.
    """

    def __init__(self, n_legs: int, n_elements: int) -> None:
        shape = (n_legs, n_elements)
        self._closure = np.full(shape, np.nan)
        self._t_ns = np.zeros(shape, np.int64)
        self._slope = np.full(shape, np.nan)
        self._t_before_ns = np.zeros(shape, np.int64)

    def apply(self, closure: Vector, t_ns: Stamps) -> Vector:
        """Return every closure as of the mean stamp of its leg.

        Args:
            closure: Closures of a scan in any unit, shape (legs, elements), NaN where there is none.
            t_ns: Stamp of each [ns], same shape.

        Returns:
            Same shape; with one reading before it an element is moved along a line, with none it is taken as it is.

        Example:
            >>> skew = SkewRemoval(1, 2)
            >>> _ = skew.apply(np.array([[0.0, 1.0]]), np.array([[0, 10]]))
            >>> skew.apply(np.array([[2.0, 3.0]]), np.array([[20, 30]])).tolist()
            [[2.5, 2.5]]
        """
        # Newton's divided differences; a stamp that did not move belongs to a reading that is NaN.
        elapsed_ns = np.maximum(t_ns - self._t_ns, 1)
        slope = (closure - self._closure) / elapsed_ns
        bend = (slope - self._slope) / np.maximum(t_ns - self._t_before_ns, 1)
        ahead_ns = t_ns.sum(axis=1, keepdims=True) // t_ns.shape[1] - t_ns
        line, parabola = slope * ahead_ns, bend * (ahead_ns * (ahead_ns + elapsed_ns))
        self._t_before_ns, self._t_ns = self._t_ns, t_ns
        self._closure, self._slope = closure, slope
        moved: Vector = closure + _known(line) + _known(parabola)
        return moved


def _known(term: Vector) -> Vector:
    return np.where(np.isfinite(term), term, 0.0)
