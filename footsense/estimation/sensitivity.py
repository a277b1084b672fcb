"""What a small closure is worth in newtons, asked of the network itself: one number for loads, three for errors."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from footsense.estimation.baseline.contact import middle_mean
from footsense.frames import ELEMENTS
from footsense.ports import Estimator

Vector = NDArray[np.float64]

#: Largest closures of the loads at which the network is asked, and by how much one element is moved there [1].
_LEVELS_REL = (0.02, 0.2)
_MOVED_REL = 1e-3

#: Share of a drift that differs between the elements; the rest is common to all. An assumption: no foot was heated.
_UNEVEN_REL = 0.2


class Sensitivity(NamedTuple):
    """Forces for each gap of closure.

    Attributes:
        load_n: Load along the leg over the middle mean of the closures [N].
        zero_n: Standard deviation of each component of the force if every zero is off by one gap, a fifth of that
            differing between the elements [N], shape (3,).
    """

    load_n: float
    zero_n: Vector


def sensitivity(estimator: Estimator, n_rows: int, moments: Vector) -> Sensitivity:
    """Ask an estimator: for the errors under light and heavy loads, even and as most common, and take the worst.

    Args:
        estimator: The network.
        n_rows: How many feet it estimates at once.
        moments: Second moments of the closures of its loads, shape (9, 9).
    """
    whole = np.zeros((n_rows, ELEMENTS), bool)

    def force_n(closure_rel: Vector) -> Vector:
        forces_n, _ = estimator.estimate(np.tile(closure_rel, (n_rows, 1)), whole)
        first_n: Vector = forces_n[0].copy()
        return first_n

    axes, directions = np.linalg.eigh(moments)
    stance_rel = np.abs(directions[:, axes.argmax()])
    stance_rel /= stance_rel.max()
    shifts = _MOVED_REL * np.eye(ELEMENTS)
    errors_n = []
    for loaded_rel in (
        level * pattern for level in _LEVELS_REL for pattern in (stance_rel, np.ones(ELEMENTS))
    ):
        slopes = np.array(
            [(force_n(loaded_rel + one) - force_n(loaded_rel - one)) / (2 * _MOVED_REL) for one in shifts]
        )
        errors_n.append(np.hypot(slopes.sum(axis=0), _UNEVEN_REL * np.linalg.norm(slopes, axis=0)))
    stance_rel *= _LEVELS_REL[-1]
    return Sensitivity(
        load_n=float(force_n(stance_rel)[2] / middle_mean(stance_rel[None])[0]),
        zero_n=np.max(errors_n, axis=0),
    )
