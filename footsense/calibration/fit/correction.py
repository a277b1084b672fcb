"""What the physics leaves: a small linear layer on the network's forces, as strong as the loads tell and no stronger.

For the designed forces p of loads whose reference felt f, ridge regression of the relative errors

    (f - M p) / |f| = C phi(p) / |f|

Its strength is chosen by leaving out one side of the ball at one magnitude after the other: neighbours err alike, so
that leaving out one load alone would believe what is only true where it was pressed. Between two strengths that do
about as well the weaker is taken, and no correction at all if none is clearly better.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from footsense.foot.parameters import FEATURES, features

Vector = NDArray[np.float64]

#: Weights of the penalty that are tried, per load, for features that are scaled to a root mean square of one.
_PENALTIES = np.logspace(-4.0, 1.0, 11)
#: CalibrationLoads, and sides and magnitudes among them, without which nothing is believed that physics does not say.
_LEAST_POKES, _LEAST_GROUPS = 40, 6


class Correction(NamedTuple):
    """What was learnt.

    Attributes:
        matrix: C above, shape (3, FEATURES); zeros if nothing was worth it.
        left_rel: Error of each load by a layer that did not know it, over its force [1], shape (n, 3).
    """

    matrix: Vector
    left_rel: Vector


def learn(designed_n: Vector, physical_n: Vector, force_n: Vector) -> Correction:
    """Learn what is left.

    Args:
        designed_n: p above [N], shape (n, 3).
        physical_n: M p [N], shape (n, 3).
        force_n: What the reference felt [N], shape (n, 3).
    """
    size_n = np.linalg.norm(force_n, axis=1, keepdims=True)
    wanted = (force_n - physical_n) / size_n
    terms = features(designed_n) / size_n
    scale = np.sqrt((terms**2).mean(axis=0))
    terms = terms / scale
    group = _groups(force_n)
    none = Correction(np.zeros((3, FEATURES)), wanted)
    if len(force_n) < _LEAST_POKES or len(set(group.tolist())) < _LEAST_GROUPS:
        return none
    tried = []
    for penalty in _PENALTIES * len(terms):
        unknown = wanted.copy()
        for out in set(group.tolist()):
            unknown[group == out] -= terms[group == out] @ _ridge(
                terms[group != out], wanted[group != out], penalty
            )
        tried.append((penalty, unknown, _score(unknown)))
    least, chance = min(score for *_, score in tried)
    if least + chance > _score(wanted)[0]:
        return none
    # The last is the weakest.
    penalty, unknown, _ = next(one for one in reversed(tried) if one[2][0] <= least + 0.5 * chance)
    return Correction(_ridge(terms, wanted, penalty).T / scale, unknown)


def _ridge(terms: Vector, wanted: Vector, penalty: float) -> Vector:
    solved = np.linalg.solve(terms.T @ terms + penalty * np.eye(FEATURES), terms.T @ wanted)
    return np.asarray(solved, dtype=np.float64)


def _groups(force_n: Vector) -> NDArray[np.intp]:
    """Return which side of the ball, and lighter or heavier than most, shape (n,)."""
    size_n = np.linalg.norm(force_n, axis=1)
    sector = np.floor((np.arctan2(force_n[:, 1], force_n[:, 0]) / np.pi + 1.0) * 3.999)
    groups: NDArray[np.intp] = (2 * sector + (size_n > np.median(size_n))).astype(np.intp)
    return groups


def _score(error_rel: Vector) -> tuple[float, float]:
    """Return the mean size of errors and its standard error, a load that slipped counting no more than a bad one."""
    size = np.linalg.norm(error_rel, axis=1)
    size = np.minimum(size, 5.0 * np.median(size))
    return float(size.mean()), float(size.std() / np.sqrt(len(size)))
