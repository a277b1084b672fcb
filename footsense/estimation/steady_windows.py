"""Network inputs of feet under a constant load: the same reading of each element three times."""

import numpy as np

from firmware_interface.conversion_order import CONVERSION_ORDERS
from footsense.frames import ELEMENTS, Mask, Vector
from footsense.ports import Window

#: Usual ages of each element's three readings at 400 conversions a second [s], shape (3, 9): those at the end of a scan
#: in the order of the magic square.
_CONVERSIONS_AGO = ELEMENTS - 1 - np.argsort(CONVERSION_ORDERS["lo_shu"]) + ELEMENTS * np.arange(3)[:, None]
STEADY_AGES_S: Vector = np.asarray(3.2e-3 + 2.7e-3 * _CONVERSIONS_AGO, np.float64)


def steady_windows(closure_rel: Vector, missing: Mask | None = None) -> Window:
    """Return the network inputs of feet whose gap closures have been constant for three scans.

    Args:
        closure_rel: Closures over the gap, missing ones imputed [1], shape (rows, elements).
        missing: The imputed ones, same shape; None for none.
    """
    return Window(
        np.repeat(closure_rel[:, None], 3, axis=1),
        np.broadcast_to(STEADY_AGES_S, (len(closure_rel), *STEADY_AGES_S.shape)),
        np.zeros(closure_rel.shape, bool) if missing is None else missing,
    )
