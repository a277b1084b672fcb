"""A force for every scan: all nine elements aligned to the scan's middle, then read by the network."""

from collections import deque
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from footsense.estimation.alignment.skew_removal import AlignedScan, SkewRemoval
from footsense.estimation.faults.imputation import Imputation
from footsense.frames import ELEMENTS
from footsense.ports import Estimator

Vector = NDArray[np.float64]
Mask = NDArray[np.bool_]
Stamps = NDArray[np.int64]


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


class ScanByScan:
    """Forces of whole scans.

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
