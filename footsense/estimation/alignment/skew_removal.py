"""Removal of scan skew: elements that are converted one after the other, extrapolated to one common time.

A foot's elements are read over 22 ms, and at heel strike the load changes by a sixth in that time. The order of the
scan cancels the false tilt of a force that grows evenly on all elements, but a leaning foot loads one row far more than
the others, and its shear is a small difference of large closures. So each element is moved along the parabola through
its last three readings to the mean time of the scan: those read before it by extrapolation, those after it by
interpolation. Motion up to the square of time comes out exact. docs/adr/0005 has the figures.

All elements of a leg are moved the same way: along a parabola if each has three readings, along a line if each has two.
The difference between the best two of these ways estimates the error, as embedded methods for differential equations
do. A leg whose elements cannot be moved, after a gap or a stall, is not time-aligned.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]
Stamps = NDArray[np.int64]

#: Largest move of an element, in its own scan periods. Even steps need 0.44; more means that the scan stalled. As an
#: array, as the next one: numpy would convert Python's numbers in every call.
_FARTHEST_REL = np.array(0.75)
_ONE_NS = np.array(1)


class AlignedScan(NamedTuple):
    """A scan as of one time.

    Attributes:
        values: Moved the best way that each leg allows, shape (legs, elements).
        coarser: Moved the next simpler way, same shape.
        time_aligned: Whether the leg's elements could be moved, shape (legs,).
        t_ns: Common time of each leg [ns], shape (legs,).
    """

    values: Vector
    coarser: Vector
    time_aligned: NDArray[np.bool_]
    t_ns: Stamps


class SkewRemoval:
    """Keeps each element's last two readings.

    Args:
        n_legs: Legs in a scan.
        n_elements: Elements of a leg.
    """

    def __init__(self, n_legs: int, n_elements: int) -> None:
        shape = (n_legs, n_elements)
        self._values = np.full(shape, np.nan)
        self._t_ns = np.zeros(shape, np.int64)
        self._slope = np.full(shape, np.nan)
        self._t_before_ns = np.zeros(shape, np.int64)
        self._n_elements = np.array(n_elements)
        self._all_legs = np.ones(n_legs, bool)

    def apply(self, values: Vector, t_ns: Stamps, ignored: NDArray[np.bool_] | None = None) -> AlignedScan:
        """Return every value as of the mean stamp of its leg.

        Args:
            values: One scan in any unit, shape (legs, elements), NaN where there is no reading.
            t_ns: Stamp of each [ns], same shape.
            ignored: Elements that need no value, same shape; None: none.

        Example:
            >>> skew = SkewRemoval(1, 2)
            >>> _ = skew.apply(np.array([[0.0, 1.0]]), np.array([[0, 10]]))
            >>> aligned = skew.apply(np.array([[2.0, 3.0]]), np.array([[20, 30]]))
            >>> aligned.values.tolist(), aligned.coarser.tolist(), aligned.time_aligned.tolist()
            ([[2.5, 2.5]], [[2.0, 3.0]], [True])
        """
        # Newton's divided differences, in float: a leg without readings has stamps of 0, and ns squared overflow.
        elapsed_ns = np.maximum(t_ns - self._t_ns, _ONE_NS).astype(np.float64)
        slope = (values - self._values) / elapsed_ns
        bend = (slope - self._slope) / np.maximum(t_ns - self._t_before_ns, _ONE_NS).astype(np.float64)
        middle_ns: Stamps = np.add.reduce(t_ns, axis=1) // self._n_elements
        ahead_ns = (middle_ns[:, None] - t_ns).astype(np.float64)
        self._t_before_ns, self._t_ns = self._t_ns, t_ns
        self._values, self._slope = values, slope
        line = values + slope * ahead_ns
        parabola = line + bend * (ahead_ns * (ahead_ns + elapsed_ns))
        near = np.abs(ahead_ns) <= _FARTHEST_REL * elapsed_ns
        # In almost every scan, every element of every leg has three readings.
        if np.count_nonzero(near) == near.size and math.isfinite(np.add.reduce(parabola, axis=None)):
            return AlignedScan(parabola, line, self._all_legs, middle_ns)
        exempt = np.False_ if ignored is None else ignored
        has_two = (np.isfinite(line) | exempt).all(axis=1, keepdims=True)
        has_three = (np.isfinite(parabola) | exempt).all(axis=1, keepdims=True)
        return AlignedScan(
            values=np.where(has_three, parabola, np.where(has_two, line, values)),
            coarser=np.where(has_three, line, values),
            time_aligned=has_two[:, 0] & near.all(axis=1),
            t_ns=middle_ns,
        )
