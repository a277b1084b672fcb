"""What a small closure is worth in newtons, asked of the network itself: one number for loads, three for errors."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from footsense.frames import ELEMENTS
from footsense.ports import Estimator

#: Where it is asked, and by how much one element is moved there: small loads, but not in the kink at zero.
_PROBE_REL = 0.02
_MOVED_REL = 0.001

#: Share of a drift that differs between the elements; the rest is common to all.
#: An assumption: no foot was heated.
_UNEVEN_REL = 0.2


class Sensitivity(NamedTuple):
    """Forces for each gap of closure.

    Attributes:
        load_n: Load along the leg if all elements close by it [N]. Real loads from 30 to 90 deg of elevation agree with
            it within a sixth: the designed foot's middle mean closure gives 2.4 to 2.6 N, even closures 2.55 N.
        zero_n: Standard deviation of each component of the force if every zero is off by it, a fifth of that
            differing between the elements [N], shape (3,).
    """

    load_n: float
    zero_n: NDArray[np.float64]


def sensitivity(estimator: Estimator, n_rows: int) -> Sensitivity:
    """Ask an estimator.

    Args:
        estimator: The network.
        n_rows: How many feet it estimates at once.
    """
    whole = np.zeros((n_rows, ELEMENTS), bool)

    def force_n(closure_rel: NDArray[np.float64]) -> NDArray[np.float64]:
        forces_n, _ = estimator.estimate(np.tile(closure_rel, (n_rows, 1)), whole)
        first_n: NDArray[np.float64] = forces_n[0].copy()
        return first_n

    even_n = force_n(np.full(ELEMENTS, _PROBE_REL))
    slopes = np.array(
        [(force_n(_PROBE_REL + _MOVED_REL * one) - even_n) / _MOVED_REL for one in np.eye(ELEMENTS)]
    )
    uneven_n = _UNEVEN_REL * np.linalg.norm(slopes, axis=0)
    return Sensitivity(float(even_n[2]) / _PROBE_REL, np.hypot(slopes.sum(axis=0), uneven_n))
