"""Network inputs of feet under a constant load: the same reading of each element three times."""

import math
from functools import cache

import numpy as np

from firmware_interface.conversion_order import conversion_order
from footsense.frames import ELEMENTS, Mask, Vector
from footsense.ports import Window


@cache
def steady_ages_s(n_elements: int) -> Vector:
    """Return the usual ages of each element's three readings at 400 conversions a second [s], shape (3, elements).

    They are those at the end of a scan in the order of the magic square.
    """
    order = conversion_order("lo_shu", math.isqrt(n_elements))
    conversions_ago = n_elements - 1 - np.argsort(order) + n_elements * np.arange(3)[:, None]
    return np.asarray(3.2e-3 + 2.7e-3 * conversions_ago, np.float64)


#: These ages for the paper's foot, shape (3, 9).
STEADY_AGES_S = steady_ages_s(ELEMENTS)


def steady_windows(closure_rel: Vector, missing: Mask | None = None) -> Window:
    """Return the network inputs of feet whose gap closures have been constant for three scans.

    Args:
        closure_rel: Closures over the gap, missing ones imputed [1], shape (rows, elements).
        missing: The imputed ones, same shape; None for none.
    """
    rows, age_s = len(closure_rel), steady_ages_s(closure_rel.shape[1])
    return Window(
        np.repeat(closure_rel[:, None], 3, axis=1),
        np.broadcast_to(age_s, (rows, *age_s.shape)),
        np.zeros(closure_rel.shape, bool) if missing is None else missing,
    )
