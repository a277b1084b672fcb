"""Residual correction: a small linear layer behind the network, fitted to the remaining force errors.

Ridge regression of the relative errors of the physical forces M p, with the reference f and the network's forces p:

    P (f - M p) / |f| = C phi(p) / |f|

P leaves out the part along f: creep and play change a magnitude by a share that depends on the loads before, and which
does not come again in another session.

The penalty is chosen by cross-validation over sectors of the ball and halves of the magnitude: neighbouring loads share
errors, so leaving out single loads would overfit. Within half a standard error of the best score the largest penalty
wins; if none beats no correction by a standard error, there is none.

Source:
    Hastie, Tibshirani, Friedman, The Elements of Statistical Learning, 2nd edition, section 7.10 (one-standard-error
    rule).
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from footsense.foot.correction_terms import N_CORRECTION_TERMS, correction_terms
from footsense.frames import Vector

#: Penalties per load, for features scaled to a root mean square of one.
_RIDGE_PENALTIES = np.logspace(-4.0, 1.0, 11)
#: Fewest loads, and groups of them, for a correction.
_MIN_LOADS, _MIN_GROUPS = 40, 6


class Correction(NamedTuple):
    """Fitted linear correction of the estimated force, with its residuals.

    Attributes:
        term_coefficients: C above, shape (3, N_CORRECTION_TERMS); zeros for none.
        cross_validated_residual_rel: Cross-validated error of each load over its magnitude [1], shape (n, 3), its part
            along the force included.
    """

    term_coefficients: Vector
    cross_validated_residual_rel: Vector


def fit_correction(designed_n: Vector, physical_n: Vector, force_n: Vector) -> Correction:
    """Fit and return the linear correction of the estimated force (ridge regression).

    Args:
        designed_n: p above, the network's forces [N], shape (n, 3).
        physical_n: M p above [N], shape (n, 3).
        force_n: Forces of the reference [N], shape (n, 3).
    """
    magnitude_n = np.linalg.norm(force_n, axis=1, keepdims=True)
    error_rel = (force_n - physical_n) / magnitude_n
    along = np.einsum("ni,ni->n", error_rel, force_n)[:, None] * force_n / magnitude_n**2
    target = error_rel - along
    terms = correction_terms(designed_n) / magnitude_n
    scale = np.sqrt((terms**2).mean(axis=0))
    terms = terms / scale
    group = _cross_validation_groups(force_n)
    none = Correction(np.zeros((3, N_CORRECTION_TERMS)), error_rel)
    if len(force_n) < _MIN_LOADS or len(np.unique(group)) < _MIN_GROUPS:
        return none
    tried = []
    for penalty in _RIDGE_PENALTIES * len(terms):
        residual = target.copy()
        for left_out in (group == one for one in np.unique(group)):
            residual[left_out] -= terms[left_out] @ _ridge_regression(
                terms[~left_out], target[~left_out], penalty
            )
        tried.append((penalty, residual, _mean_clipped_error(residual)))
    best, standard_error = min(score for *_, score in tried)
    if best + standard_error > _mean_clipped_error(target)[0]:
        return none
    penalty, residual, _ = next(one for one in reversed(tried) if one[2][0] <= best + 0.5 * standard_error)
    return Correction(_ridge_regression(terms, target, penalty).T / scale, residual + along)


def _ridge_regression(terms: Vector, target: Vector, penalty: float) -> Vector:
    """Return the coefficients of a ridge regression of `target` on `terms`."""
    solution = np.linalg.solve(terms.T @ terms + penalty * np.eye(N_CORRECTION_TERMS), terms.T @ target)
    return np.asarray(solution, np.float64)


def _cross_validation_groups(force_n: Vector) -> NDArray[np.intp]:
    """Return the cross-validation group of each load, shape (n,): eight azimuth sectors, each halved by magnitude."""
    magnitude_n = np.linalg.norm(force_n, axis=1)
    sector = np.floor((np.arctan2(force_n[:, 1], force_n[:, 0]) / np.pi + 1.0) * 3.999)
    groups: NDArray[np.intp] = (2 * sector + (magnitude_n > np.median(magnitude_n))).astype(np.intp)
    return groups


def _mean_clipped_error(error_rel: Vector) -> tuple[float, float]:
    """Return the mean absolute error [1] and its standard error [1]; errors are clipped at five times the median."""
    size = np.linalg.norm(error_rel, axis=1)
    size = np.minimum(size, 5.0 * np.median(size))
    return float(size.mean()), float(size.std() / np.sqrt(len(size)))
