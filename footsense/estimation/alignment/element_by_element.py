"""A force for every conversion: all nine elements predicted to the time of sending, then read by the network."""

import math

import numpy as np

from footsense.estimation.alignment.prediction import Prediction
from footsense.estimation.alignment.scan_by_scan import AlignedSample
from footsense.estimation.faults.imputation import Imputation
from footsense.estimation.faults.missing_sets import MISSING_SETS, missing_set_index
from footsense.estimation.sensitivity import jacobian_n
from footsense.frames import ELEMENTS, Mask, Stamps, Vector
from footsense.ports import Estimator

#: Largest spread of a leg's nine readings that can be aligned, in scans.
_SPREAD_SCANS = 1.5
#: Measured error of the filter over its own covariance, for measured and made-up walks [1]: velocities jump at
#: touchdown, where the model has them wander evenly.
_JUMPS_REL = 1.5
#: Mean closure of a stance, at which the network's sensitivity is taken [1].
_STANCE_REL = 0.2


class ElementByElement:
    """Aligns the elements and estimates the force after every single conversion.

    Args:
        estimator: The network, for as many rows as there are legs.
        n_legs: Legs.
        moments: As of `Imputation`.
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
        self._imputation = Imputation(moments)
        step_s = step_ns * 1e-9
        # The lead: from the middle of a conversion to its end, and the read-out of all legs.
        self._prediction = Prediction(n_legs, moments, order, step_s, 1.2 * step_s, noise_rel)
        self._spread_ns = round(_SPREAD_SCANS * len(order) * step_ns)
        self._last_ns = np.zeros((n_legs, ELEMENTS), np.int64)
        self._fresh_from_ns = np.zeros(n_legs, np.int64)
        self._whole: Mask = np.zeros(n_legs, bool)
        self._running = np.zeros(n_legs, bool)
        self._legs = np.arange(n_legs)
        self._variance_n2 = self._force_variance(moments, n_legs)
        self._sets = np.zeros(n_legs, np.intp)
        self._next = order[0]
        self._following = dict(zip(order, order[1:] + order[:1], strict=True))

    def align(self, distance_rel: Vector, t_ns: Stamps, now_ns: int, missing: Mask) -> AlignedSample:
        """Feed a frame's new readings to the filter, and predict all elements to `now_ns`; as `ScanByScan.align`."""
        element = self._next
        if self._is_next(distance_rel, t_ns, missing):
            newest_ns: Stamps = t_ns[:, element]
            self._prediction.observe_all(element, distance_rel[:, element], newest_ns)
            self._last_ns = t_ns
            at = self._prediction.at(now_ns)
            return AlignedSample(at, distance_rel, self._running, newest_ns, t_ns.min(axis=1))
        return self._align_any(distance_rel, t_ns, now_ns, missing)

    def _is_next(self, distance_rel: Vector, t_ns: Stamps, missing: Mask) -> bool:
        """Tell whether only the next element is new, on every leg, and no element is missing: almost every frame."""
        new = t_ns != self._last_ns
        element = self._next
        self._next = self._following[element]
        return bool(
            new.sum() == len(new)
            and new[:, element].all()
            and self._running.all()
            and math.isfinite(distance_rel.sum())
            and not (missing.any() or self._sets.any())
        )

    def _align_any(self, distance_rel: Vector, t_ns: Stamps, now_ns: int, missing: Mask) -> AlignedSample:
        self._sets = missing_set_index(missing)
        readable = np.isfinite(distance_rel)
        new = (t_ns > self._last_ns) & readable
        newest_ns = t_ns.max(axis=1)
        whole: Mask = np.asarray((readable | missing).all(axis=1))
        # A failed reading breaks the sequence: older readings are not mixed with newer ones.
        breaks = self._whole & ~whole
        self._fresh_from_ns[breaks] = newest_ns[breaks]
        self._whole = whole
        spread_ns = newest_ns - np.where(missing, newest_ns[:, None], t_ns).min(axis=1)
        fresh = (missing | (t_ns > self._fresh_from_ns[:, None])).all(axis=1)
        complete = whole & fresh & (spread_ns <= self._spread_ns)
        continuing = complete & self._running
        self._take(distance_rel, t_ns, new & continuing[:, None])
        for leg in np.flatnonzero(complete & ~self._running).tolist():
            self._prediction.begin(
                leg, np.where(missing[leg], np.nan, distance_rel[leg]), int(newest_ns[leg])
            )
        self._running = complete
        self._last_ns = t_ns
        self._next = self._following[int(t_ns.max(axis=0).argmax())]
        return AlignedSample(self._prediction.at(now_ns), distance_rel, complete, newest_ns, t_ns.min(axis=1))

    def estimate(
        self, closure_rel: Vector, unloaded_rel: Vector, usable: Mask, missing: Mask
    ) -> tuple[Vector, Vector]:
        """Return force and sigma of the sample that was aligned last [N]; arguments as of `ScanByScan.estimate`."""
        del unloaded_rel
        imputed = self._imputation.impute(np.where(usable[:, None], closure_rel, 0.0), missing)
        force_n, sigma_n = self._estimator.estimate(imputed, missing)
        speed, newest = self._prediction.speed()
        moving_n2 = speed[:, None] * self._variance_n2[self._legs, self._sets, newest]
        return force_n, np.sqrt(sigma_n * sigma_n + moving_n2)

    def _take(self, distance_rel: Vector, t_ns: Stamps, new: Mask) -> None:
        """Feed new readings to the filter, each leg's in the order of their stamps."""
        while new.any():
            legs = np.flatnonzero(new.any(axis=1))
            elements = np.where(new[legs], t_ns[legs], np.iinfo(np.int64).max).argmin(axis=1)
            at = (legs, elements)
            self._prediction.observe(legs, elements, distance_rel[at], t_ns[at], self._sets[legs])
            new[at] = False

    def _force_variance(self, moments: Vector, n_legs: int) -> Vector:
        """Return the variance of the force by the filter's covariance at speed 1 [N2], shape (legs, sets, 9, 3)."""
        axes, directions = np.linalg.eigh(moments)
        stance_rel = np.abs(directions[:, axes.argmax()])
        stance_rel *= _STANCE_REL / stance_rel.max()
        sensitivity = jacobian_n(self._estimator, n_legs, stance_rel).transpose(1, 2, 0)
        covariance = self._prediction.position_covariance
        variance_n2 = np.empty((n_legs, len(MISSING_SETS), ELEMENTS, 3))
        for number, missing in enumerate(MISSING_SETS):
            imputed = sensitivity @ self._imputation.matrix(missing)
            variance_n2[:, number] = np.einsum("lai,eij,laj->lea", imputed, covariance[number], imputed)
        return _JUMPS_REL**2 * variance_n2
