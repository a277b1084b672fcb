"""Feet as they were made, read by the network of their design: one call for all, what is a foot's own behind it."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from footsense.foot.parameters import FEATURES, FootParameters, features
from footsense.foot.temperature import CalibratedAt, effect
from footsense.ports import Estimator

Vector = NDArray[np.float64]


class CalibratedFeet:
    """An estimator for feet that were measured on a bench; strays, gaps and gains are matter of who asks it.

    As long as nobody calls `warm`, the feet are read as on the bench.

    Args:
        network: Of the design.
        feet: The foot on each leg, None for one that is taken as designed.
        n_rows: Feet that are estimated at once: all legs, once or more times over.

    Raises:
        ValueError: The rows are no multiple of the legs.
    """

    def __init__(self, network: Estimator, feet: Sequence[FootParameters | None], n_rows: int) -> None:
        if n_rows % len(feet):
            raise ValueError(f"{n_rows} rows are no multiple of {len(feet)} legs")
        times = n_rows // len(feet)
        self._network = network
        self._bench_matrix = np.tile(
            [np.eye(3) if foot is None else foot.force_matrix for foot in feet], (times, 1, 1)
        )
        self._bench_correction = np.tile(
            [np.zeros((3, FEATURES)) if foot is None else foot.correction for foot in feet], (times, 1, 1)
        )
        self._corrected = bool(self._bench_correction.any())
        self._bench_error_rel = np.tile([0.0 if foot is None else foot.error_rel for foot in feet], times)
        self._times = times
        self._read_with(np.ones(len(feet)), np.zeros(len(feet)))

    def warm(self, temperature_c: Vector, calibrated_at: Sequence[CalibratedAt | None]) -> None:
        """Read the feet as warm as they are now.

        Args:
            temperature_c: Of each leg's foot [degC], shape (legs,), NaN where nothing measures it.
            calibrated_at: What is known of each foot on the bench, None for one that is taken as designed.
        """
        known = [effect(*leg) for leg in zip(temperature_c.tolist(), calibrated_at, strict=True)]
        gain, unknown_rel = np.array(known).T
        self._read_with(gain, unknown_rel)

    def _read_with(self, gain: Vector, unknown_rel: Vector) -> None:
        """Take the temperatures into what a force is made of, so that they cost nothing in each one."""
        gains = np.tile(gain, self._times)[:, None, None]
        self._matrix, self._correction = gains * self._bench_matrix, gains * self._bench_correction
        self._error_rel = np.hypot(self._bench_error_rel, np.tile(unknown_rel, self._times))[:, None]

    def estimate(self, closure_rel: Vector, missing: NDArray[np.bool_]) -> tuple[Vector, Vector]:
        """Return force and sigma of every row [N], shape (rows, 3) each; arguments as of the network.

        The network's sigma is turned and scaled with the force; what the bench left unexplained comes on top.
        """
        designed_n, designed_sigma_n = self._network.estimate(closure_rel, missing)
        force_n = np.einsum("rij,rj->ri", self._matrix, designed_n)
        if self._corrected:
            force_n += np.einsum("rij,rj->ri", self._correction, features(designed_n))
        own_variance = np.einsum("rij,rj->ri", self._matrix**2, designed_sigma_n**2)
        left_n = self._error_rel * np.linalg.norm(force_n, axis=1, keepdims=True)
        return force_n, np.sqrt(own_variance + left_n**2)
