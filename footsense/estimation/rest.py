"""Windows of feet at rest: the same reading three times."""

import math
from functools import cache

import numpy as np

from firmware_interface.conversion_order import conversion_order
from footsense.frames import ELEMENTS, Mask, Vector
from footsense.ports import Window


@cache
def rest_age_s(n_elements: int) -> Vector:
    """Return the ages of the readings of a foot that is read at 400 conversions a second [s], shape (3, elements).

    They are those at the end of a scan in the order of the magic square.
    """
    order = conversion_order("lo_shu", math.isqrt(n_elements))
    conversions_ago = n_elements - 1 - np.argsort(order) + n_elements * np.arange(3)[:, None]
    return np.asarray(3.2e-3 + 2.7e-3 * conversions_ago, np.float64)


#: These ages for the paper's foot, shape (3, 9).
REST_AGE_S = rest_age_s(ELEMENTS)


def at_rest(closure_rel: Vector, missing: Mask | None = None) -> Window:
    """Return the windows of feet whose closures have been the same for a while.

    Args:
        closure_rel: Closures over the gap, missing ones imputed [1], shape (rows, elements).
        missing: The imputed ones, same shape; None for none.
    """
    rows, age_s = len(closure_rel), rest_age_s(closure_rel.shape[1])
    return Window(
        np.repeat(closure_rel[:, None], 3, axis=1),
        np.broadcast_to(age_s, (rows, *age_s.shape)),
        np.zeros(closure_rel.shape, bool) if missing is None else missing,
    )
