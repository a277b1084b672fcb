"""References for the network: the paper's errors, least-squares force estimators, coverage of sigma."""

from collections.abc import Callable

import numpy as np

from footsense.foot.capacitor import Capacitor
from footsense.frames import Vector
from footsense.lab.training.load_cases import Cases

#: The paper's errors on its verification cases: section III F (simulation) [deg, gf].
PAPER_DIRECTION_DEG, PAPER_MAGNITUDE_GF = 2.4, 5.3
#: The paper's mean errors on its fabricated foot: section V C (experiment) [deg, gf].
MEASURED_DIRECTION_DEG, MEASURED_MAGNITUDE_GF = 15.9, 18.7

#: Makes forces [N], shape (n, 3), of closures [um], shape (n, 9).
ForceEstimator = Callable[[Vector], Vector]


def rms(values: Vector) -> float:
    """Return the root mean square of all values."""
    return float(np.sqrt(np.mean(values**2)))


def _fit_least_squares(features: Vector, force_n: Vector) -> Vector:
    """Return the least-squares matrix from features to forces, without offset."""
    matrix, *_ = np.linalg.lstsq(features, force_n, rcond=None)
    return np.asarray(matrix, dtype=np.float64)


def capacitance_based_force_estimator(design: Capacitor, training: Cases) -> ForceEstimator:
    """Return the least-squares force estimator from capacitance changes, the inputs of the paper's network."""

    def change_pf(closure_um: Vector) -> Vector:
        """Return the capacitance changes [pF] of closures [um]."""
        return design.capacitance_pf(closure_um) - design.unloaded_pf

    matrix = _fit_least_squares(change_pf(training.closure_um), training.force_n)
    return lambda closure_um: change_pf(closure_um) @ matrix


def elastance_based_force_estimator(training: Cases) -> ForceEstimator:
    """Return the least-squares force estimator from gap closures, which elastance (1/C) measures."""
    matrix = _fit_least_squares(training.closure_um, training.force_n)
    return lambda closure_um: closure_um @ matrix


def sigma_coverage_shares(truth_n: Vector, estimate_n: Vector, sigma_n: Vector) -> dict[str, list[float]]:
    """Return the shares of errors within one and two sigma, per axis; 0.683 and 0.954 if Gaussian.

    Args:
        truth_n: True forces [N], shape (n, 3).
        estimate_n: Estimates [N], shape (n, 3).
        sigma_n: Standard deviations that the estimator states [N], shape (n, 3).
    """
    off = np.abs(estimate_n - truth_n) / sigma_n
    return {f"within_{k}_sigma": np.mean(off < k, axis=0).round(4).tolist() for k in (1, 2)}
