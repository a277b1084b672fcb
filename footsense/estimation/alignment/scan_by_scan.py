"""A force for every scan: all nine elements brought to the scan's middle, then read by the network."""

from collections import deque
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from footsense.estimation.alignment.skew_removal import Aligned, SkewRemoval
from footsense.estimation.faults.imputation import Filling
from footsense.frames import ELEMENTS
from footsense.ports import Estimator

Vector = NDArray[np.float64]
Mask = NDArray[np.bool_]
Stamps = NDArray[np.int64]


class Moment(NamedTuple):
    """The elements of all legs as of one time each.

    Attributes:
        values: Distances of the plates over the gap [1], shape (legs, 9).
        judged: Those by which an element is said to be shut or out of range: as measured, where `values` are predicted.
        together: Whether they could be brought to that time, shape (legs,).
        t_ns: Which the consumer is told: how far the measurement reaches [ns], shape (legs,).
        oldest_ns: Stamp of the oldest reading that went into it [ns], shape (legs,); 0 without one.
    """

    values: Vector
    judged: Vector
    together: Mask
    t_ns: NDArray[np.int64]
    oldest_ns: NDArray[np.int64]


class ScanByScan:
    """Forces of whole scans.

    Each leg is estimated two ways, its elements moved along parabolas and along lines: how far the two forces lie apart
    tells what the motion may have left on any axis; of one axis alone it may vanish by chance.

    Args:
        estimator: The network, for twice the legs.
        n_legs: Legs.
        moments: As `Filling` has them.
        n_averaged: Scans whose elements are averaged before they are read.
    """

    def __init__(self, estimator: Estimator, n_legs: int, moments: Vector, n_averaged: int = 1) -> None:
        self._estimator = estimator
        self._filling = Filling(moments)
        self._skew = SkewRemoval(n_legs, ELEMENTS)
        self._scans: deque[tuple[Aligned, Stamps]] = deque(maxlen=n_averaged)
        self._coarser = np.zeros((n_legs, ELEMENTS))
        self._both_rel = np.zeros((2 * n_legs, ELEMENTS))
        self._none_missing: Mask = np.zeros((2 * n_legs, ELEMENTS), bool)

    def align(self, values: Vector, t_ns: NDArray[np.int64], now_ns: int, missing: Mask) -> Moment:
        """Bring a scan to its middle.

        Args:
            values: Distances over the gap, shape (legs, 9), NaN where there is none to be used.
            t_ns: Their stamps [ns], shape (legs, 9).
            now_ns: When the force will be sent [ns].
            missing: Elements that nobody asks for, shape (legs, 9).
        """
        del now_ns
        aligned = self._skew.apply(values, t_ns, missing)
        oldest_ns = np.minimum.reduce(t_ns, axis=1)
        self._scans.append((aligned, oldest_ns))
        if len(self._scans) == 1:
            self._coarser = aligned.coarser
            return Moment(aligned.values, aligned.values, aligned.together, aligned.t_ns, oldest_ns)
        all_aligned, all_oldest_ns = zip(*self._scans, strict=True)
        self._coarser = np.mean([one.coarser for one in all_aligned], axis=0)
        averaged = np.mean([one.values for one in all_aligned], axis=0)
        return Moment(
            values=averaged,
            judged=averaged,
            together=np.all([one.together for one in all_aligned], axis=0),
            t_ns=np.sum([one.t_ns for one in all_aligned], axis=0) // len(self._scans),
            oldest_ns=np.min(all_oldest_ns, axis=0),
        )

    def estimate(
        self, closure_rel: Vector, rest_rel: Vector, usable: Mask, missing: Mask
    ) -> tuple[Vector, Vector]:
        """Return force and sigma of what was aligned last [N], shape (legs, 3) each; anything where not usable.

        Args:
            closure_rel: Closures of the moment over the gap [1], shape (legs, 9).
            rest_rel: Distances at rest over the gap [1], shape (legs, 9).
            usable: Legs whose force is wanted, shape (legs,).
            missing: Elements to be filled in, shape (legs, 9).
        """
        n_legs = len(usable)
        both_rel, both_missing = self._both_rel, self._none_missing
        both_rel[:n_legs] = closure_rel
        np.subtract(rest_rel, self._coarser, out=both_rel[n_legs:])
        if np.count_nonzero(usable) < n_legs:
            both_rel[~np.concatenate((usable, usable))] = 0.0
        if np.count_nonzero(missing):
            both_missing = np.concatenate((missing, missing))
            both_rel = self._filling.fill(both_rel, both_missing)
        both_n, both_sigma_n = self._estimator.estimate(both_rel, both_missing)
        force_n = both_n[:n_legs]
        apart_n = force_n - both_n[n_legs:]
        moved_n = np.sqrt(np.einsum("ij,ij->i", apart_n, apart_n))
        return force_n, np.hypot(both_sigma_n[:n_legs], moved_n[:, None])
