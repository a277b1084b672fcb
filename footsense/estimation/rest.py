"""Windows of feet at rest: the same reading three times."""

import numpy as np

from footsense.frames import ELEMENTS, Mask, Vector
from footsense.ports import Window

#: Conversions since each reading, at the end of a scan in the order of the magic square.
_CONVERSIONS_SINCE_READING = np.array((7, 2, 3, 0, 4, 8, 5, 6, 1)) + ELEMENTS * np.arange(3)[:, None]
#: Ages of the readings of a foot that is read at 400 conversions a second [s], shape (3, 9).
REST_AGE_S = 3.2e-3 + 2.7e-3 * _CONVERSIONS_SINCE_READING


def at_rest(closure_rel: Vector, missing: Mask | None = None) -> Window:
    """Return the windows of feet whose closures have been the same for a while.

    Args:
        closure_rel: Closures over the gap, missing ones imputed [1], shape (rows, 9).
        missing: The imputed ones, same shape; None for none.
    """
    rows = len(closure_rel)
    return Window(
        np.repeat(closure_rel[:, None], 3, axis=1),
        np.broadcast_to(REST_AGE_S, (rows, *REST_AGE_S.shape)),
        np.zeros(closure_rel.shape, bool) if missing is None else missing,
    )
