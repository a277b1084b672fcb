"""A force for every conversion: all nine elements predicted to the time of sending, then read by the network."""

import math

import numpy as np
from numpy.typing import NDArray

from footsense.estimation.alignment.prediction import Prediction
from footsense.estimation.alignment.scan_by_scan import Moment
from footsense.estimation.faults.imputation import Filling
from footsense.estimation.faults.missing_sets import KNOWN_MISSING, known_missing
from footsense.frames import ELEMENTS
from footsense.ports import Estimator

Vector = NDArray[np.float64]
Mask = NDArray[np.bool_]
Stamps = NDArray[np.int64]

#: A leg's nine readings that are spread over more than this many scans do not belong together.
_SPREAD_SCANS = 1.5
#: By what the filter's own idea of its error is too small, over measured and made-up walks: velocities do not wander
#: evenly, they jump at touchdown.
_JUMPS_REL = 1.5
#: Mean closure at which the network's sensitivity is taken [1]: where a stance is.
_STANCE_REL = 0.2
_DIFFERENCE_REL = 1e-3


class ElementByElement:
    """Forces of single conversions.

    Args:
        estimator: The network, for as many rows as there are legs.
        n_legs: Legs.
        moments: As `Filling` has them.
        order: Flat index of the elements in the order of the scan.
        step_ns: Time from one element to the next [ns].
        noise_rel: Standard deviation of one reading of a distance over the gap [1].
    """

    def __init__(
        self,
        estimator: Estimator,
        n_legs: int,
        moments: Vector,
        order: tuple[int, ...],
        step_ns: int,
        noise_rel: float,
    ) -> None:
        self._estimator = estimator
        self._filling = Filling(moments)
        step_s = step_ns * 1e-9
        # From the middle of a conversion to its end, and then the read-out of all legs.
        self._prediction = Prediction(n_legs, moments, order, step_s, 1.2 * step_s, noise_rel)
        self._spread_ns = round(_SPREAD_SCANS * len(order) * step_ns)
        self._seen_ns = np.zeros((n_legs, ELEMENTS), np.int64)
        self._fresh_from_ns = np.zeros(n_legs, np.int64)
        self._whole: Mask = np.zeros(n_legs, bool)
        self._running = np.zeros(n_legs, bool)
        self._legs = np.arange(n_legs)
        self._variance_n2 = self._force_variance(moments, n_legs)
        self._sets = np.zeros(n_legs, np.intp)
        self._next = order[0]
        self._following = dict(zip(order, order[1:] + order[:1], strict=True))

    def align(self, values: Vector, t_ns: Stamps, now_ns: int, missing: Mask) -> Moment:
        """Take what is new in a frame, and predict all elements to `now_ns`; arguments as of `ScanByScan.align`."""
        element = self._next
        if self._is_next(values, t_ns, missing):
            newest_ns: Stamps = t_ns[:, element]
            self._prediction.observe_all(element, values[:, element], newest_ns)
            self._seen_ns = t_ns
            at = self._prediction.at(now_ns)
            return Moment(at, values, self._running, newest_ns, t_ns.min(axis=1))
        return self._align_any(values, t_ns, now_ns, missing)

    def _is_next(self, values: Vector, t_ns: Stamps, missing: Mask) -> bool:
        """Tell whether a frame is what almost all are: the next element is new on all legs, and nothing is amiss."""
        new = t_ns != self._seen_ns
        element = self._next
        self._next = self._following[element]
        return bool(
            new.sum() == len(new)
            and new[:, element].all()
            and self._running.all()
            and math.isfinite(values.sum())
            and not (missing.any() or self._sets.any())
        )

    def _align_any(self, values: Vector, t_ns: Stamps, now_ns: int, missing: Mask) -> Moment:
        self._sets = known_missing(missing)
        readable = np.isfinite(values)
        new = (t_ns > self._seen_ns) & readable
        newest_ns = t_ns.max(axis=1)
        whole: Mask = np.asarray((readable | missing).all(axis=1))
        # A reading that fails breaks the sequence: what was read before it is not mixed with what comes after.
        breaks = self._whole & ~whole
        self._fresh_from_ns[breaks] = newest_ns[breaks]
        self._whole = whole
        spread_ns = newest_ns - np.where(missing, newest_ns[:, None], t_ns).min(axis=1)
        fresh = (missing | (t_ns > self._fresh_from_ns[:, None])).all(axis=1)
        complete = whole & fresh & (spread_ns <= self._spread_ns)
        going_on = complete & self._running
        self._take(values, t_ns, new & going_on[:, None])
        for leg in np.flatnonzero(complete & ~self._running).tolist():
            self._prediction.begin(leg, np.where(missing[leg], np.nan, values[leg]), int(newest_ns[leg]))
        self._running = complete
        self._seen_ns = t_ns
        self._next = self._following[int(t_ns.max(axis=0).argmax())]
        return Moment(self._prediction.at(now_ns), values, complete, newest_ns, t_ns.min(axis=1))

    def estimate(
        self, closure_rel: Vector, rest_rel: Vector, usable: Mask, missing: Mask
    ) -> tuple[Vector, Vector]:
        """Return force and sigma of what was aligned last [N]; arguments as of `ScanByScan.estimate`."""
        del rest_rel
        filled = self._filling.fill(np.where(usable[:, None], closure_rel, 0.0), missing)
        force_n, sigma_n = self._estimator.estimate(filled, missing)
        speed, newest = self._prediction.speed()
        moving_n2 = speed[:, None] * self._variance_n2[self._legs, self._sets, newest]
        return force_n, np.sqrt(sigma_n * sigma_n + moving_n2)

    def _take(self, values: Vector, t_ns: Stamps, new: Mask) -> None:
        """Hand the new readings to the filter, each leg's in the order of their stamps."""
        while new.any():
            legs = np.flatnonzero(new.any(axis=1))
            elements = np.where(new[legs], t_ns[legs], np.iinfo(np.int64).max).argmin(axis=1)
            at = (legs, elements)
            self._prediction.observe(legs, elements, values[at], t_ns[at], self._sets[legs])
            new[at] = False

    def _force_variance(self, moments: Vector, n_legs: int) -> Vector:
        """Return the variance of the force that the filter's covariance makes, at speed 1.

        Returns:
            That [N2], shape (legs, sets, 9, 3): each leg may have a foot of its own.
        """
        axes, directions = np.linalg.eigh(moments)
        stance_rel = np.abs(directions[:, axes.argmax()])
        stance_rel *= _STANCE_REL / stance_rel.max()
        shifts = np.concatenate((np.eye(ELEMENTS), -np.eye(ELEMENTS))) * _DIFFERENCE_REL
        whole = np.zeros((n_legs, ELEMENTS), bool)
        forces_n = np.array(
            [self._estimator.estimate(np.tile(row, (n_legs, 1)), whole)[0] for row in stance_rel + shifts]
        )
        sensitivity = (forces_n[:ELEMENTS] - forces_n[ELEMENTS:]).transpose(1, 2, 0) / (2 * _DIFFERENCE_REL)
        covariance = self._prediction.position_covariance
        variance_n2 = np.empty((n_legs, len(KNOWN_MISSING), ELEMENTS, 3))
        for number, missing in enumerate(KNOWN_MISSING):
            filled = sensitivity @ self._filling.matrix(missing)
            variance_n2[:, number] = np.einsum("lai,eij,laj->lea", filled, covariance[number], filled)
        return _JUMPS_REL**2 * variance_n2
