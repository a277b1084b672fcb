"""Sensitivity of the estimated force to small gap closures, by finite differences of the network."""

from typing import NamedTuple

import numpy as np

from footsense.estimation.contact import trimmed_means
from footsense.estimation.network import steady_windows
from footsense.frames import Vector
from footsense.ports import Estimator

#: Largest closures of the loads at which the sensitivity is taken [1], and the step of the differences [1].
_CLOSURE_LEVELS_REL = (0.02, 0.2)
_DIFFERENCE_STEP_REL = 1e-3

#: Share of a drift that differs between the elements; the rest is common to all. An assumption: no foot was heated.
_ASSUMED_UNEVEN_DRIFT_SHARE = 0.2


class Sensitivity(NamedTuple):
    """Change of estimated load and force per gap closure [N].

    Attributes:
        load_n_per_mean_closure: Load along the leg over the trimmed mean of the closures [N].
        force_sigma_n_per_baseline_error: Standard deviation of each component of the force if every baseline is off by
            one gap, a fifth of that differing between the elements [N], shape (3,).
    """

    load_n_per_mean_closure: float
    force_sigma_n_per_baseline_error: Vector


def _jacobian_n(estimator: Estimator, n_rows: int, closure_rel: Vector) -> Vector:
    """Return the derivative of the force by each element's closure [N], shape (9, rows, 3), by central differences.

    Args:
        estimator: The network.
        n_rows: Rows that it estimates at once.
        closure_rel: Closures over the gap at which it is taken [1], shape (elements,).
    """
    n = len(closure_rel)
    steps = _DIFFERENCE_STEP_REL * np.concatenate((np.eye(n), -np.eye(n)))
    forces_n = np.array(
        [estimator.estimate(steady_windows(np.tile(row, (n_rows, 1)))).force_n for row in closure_rel + steps]
    )
    slopes_n: Vector = (forces_n[:n] - forces_n[n:]) / (2 * _DIFFERENCE_STEP_REL)
    return slopes_n


def sensitivity(estimator: Estimator, n_rows: int, moments: Vector) -> Sensitivity:
    """Return the largest sensitivity over light and heavy loads, for even closures and for the principal pattern.

    Args:
        estimator: The network.
        n_rows: Rows that it estimates at once.
        moments: Second moments of the closures of its loads, shape (elements, elements).
    """
    axes, directions = np.linalg.eigh(moments)
    # The most common closure pattern: the principal component, its largest entry 1.
    stance_rel = np.abs(directions[:, axes.argmax()])
    stance_rel /= stance_rel.max()
    errors_n = []
    for level in _CLOSURE_LEVELS_REL:
        for pattern in (stance_rel, np.ones(len(moments))):
            slopes_n = _jacobian_n(estimator, n_rows, level * pattern)[:, 0]
            errors_n.append(
                np.hypot(slopes_n.sum(axis=0), _ASSUMED_UNEVEN_DRIFT_SHARE * np.linalg.norm(slopes_n, axis=0))
            )
    stance_rel = _CLOSURE_LEVELS_REL[-1] * stance_rel
    rows = np.tile(stance_rel, (n_rows, 1))
    force_n = estimator.estimate(steady_windows(rows)).force_n
    return Sensitivity(
        load_n_per_mean_closure=float(force_n[0, 2] / trimmed_means(stance_rel[None])[0]),
        force_sigma_n_per_baseline_error=np.max(errors_n, axis=0),
    )
