"""A force for every scan: all nine elements aligned to the scan's middle, then read by the network.

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
from collections import deque
from typing import NamedTuple

import numpy as np

from footsense.estimation.faults.imputation import Imputation
from footsense.frames import ELEMENTS, Mask, Stamps, Vector
from footsense.ports import Estimator

#: Largest move of an element, in its own scan periods. Even steps need 0.44; more means that the scan stalled. As an
#: array, as the next one: numpy would convert Python's numbers in every call.
_FARTHEST_REL = np.array(0.75)
_ONE_NS = np.array(1)


class AlignedSample(NamedTuple):
    """The elements of all legs as of one time each.

    Attributes:
        distance_rel: Plate distances over the gap at that time [1], shape (legs, 9).
        measured_rel: The same as measured, where `distance_rel` are predicted; None where they are measured.
        time_aligned: Whether they could be brought to that time, shape (legs,).
        t_ns: Published time of the measurement [ns], shape (legs,).
        oldest_ns: Stamp of the oldest reading that went into it [ns], shape (legs,); 0 without one.
    """

    distance_rel: Vector
    measured_rel: Vector | None
    time_aligned: Mask
    t_ns: Stamps
    oldest_ns: Stamps


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
    time_aligned: Mask
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

    def apply(self, values: Vector, t_ns: Stamps, ignored: Mask | None = None) -> AlignedScan:
        """Return a scan with every value moved in time to the mean time stamp of its leg.

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


class ScanByScan:
    """Aligns each whole scan to one time per leg and estimates the force at that time.

    Each leg is estimated two ways, its elements moved along parabolas and along lines: the distance between the two
    forces estimates the error by motion on any axis; of one axis alone it may vanish by chance.

    Args:
        estimator: The network, for twice the legs.
        n_legs: Legs.
        moments: As of `Imputation`.
        n_averaged: Scans whose elements are averaged before they are read.
    """

    def __init__(self, estimator: Estimator, n_legs: int, moments: Vector, n_averaged: int = 1) -> None:
        self._estimator = estimator
        self._imputation = Imputation(moments)
        self._skew = SkewRemoval(n_legs, ELEMENTS)
        self._scans: deque[tuple[AlignedScan, Stamps]] = deque(maxlen=n_averaged)
        self._coarser = np.zeros((n_legs, ELEMENTS))
        self._both_rel = np.zeros((2 * n_legs, ELEMENTS))
        self._none_missing: Mask = np.zeros((2 * n_legs, ELEMENTS), bool)

    def align(self, distance_rel: Vector, t_ns: Stamps, now_ns: int, missing: Mask) -> AlignedSample:
        """Align a scan to its middle.

        Args:
            distance_rel: Plate distances over the gap, shape (legs, 9), NaN where there is none to be used.
            t_ns: Their stamps [ns], shape (legs, 9).
            now_ns: Time at which the force will be sent [ns].
            missing: Missing elements, shape (legs, 9).
        """
        del now_ns
        aligned = self._skew.apply(distance_rel, t_ns, missing)
        oldest_ns = np.minimum.reduce(t_ns, axis=1)
        self._scans.append((aligned, oldest_ns))
        if len(self._scans) == 1:
            self._coarser = aligned.coarser
            return AlignedSample(aligned.values, None, aligned.time_aligned, aligned.t_ns, oldest_ns)
        scans, all_oldest_ns = zip(*self._scans, strict=True)
        self._coarser = np.mean([scan.coarser for scan in scans], axis=0)
        return AlignedSample(
            distance_rel=np.mean([scan.values for scan in scans], axis=0),
            measured_rel=None,
            time_aligned=np.all([scan.time_aligned for scan in scans], axis=0),
            t_ns=np.sum([scan.t_ns for scan in scans], axis=0) // len(scans),
            oldest_ns=np.min(all_oldest_ns, axis=0),
        )

    def estimate(
        self, closure_rel: Vector, unloaded_rel: Vector, usable: Mask, missing: Mask
    ) -> tuple[Vector, Vector]:
        """Return force and sigma of the sample that was aligned last [N], shape (legs, 3) each; any where not usable.

        Args:
            closure_rel: Closures of the sample over the gap [1], shape (legs, 9).
            unloaded_rel: Unloaded plate distances over the gap [1], shape (legs, 9).
            usable: Legs whose force is wanted, shape (legs,).
            missing: Elements to impute, shape (legs, 9).
        """
        n_legs = len(usable)
        both_rel, both_missing = self._both_rel, self._none_missing
        both_rel[:n_legs] = closure_rel
        np.subtract(unloaded_rel, self._coarser, out=both_rel[n_legs:])
        if np.count_nonzero(usable) < n_legs:
            both_rel[~np.concatenate((usable, usable))] = 0.0
        if np.count_nonzero(missing):
            both_missing = np.concatenate((missing, missing))
            both_rel = self._imputation.impute(both_rel, both_missing)
        both_n, both_sigma_n = self._estimator.estimate(both_rel, both_missing)
        force_n = both_n[:n_legs]
        difference_n = force_n - both_n[n_legs:]
        motion_n = np.sqrt(np.einsum("ij,ij->i", difference_n, difference_n))
        return force_n, np.hypot(both_sigma_n[:n_legs], motion_n[:, None])
