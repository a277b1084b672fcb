"""A press of a foot as arrays, and the load that is made of it."""

import math
from enum import StrEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["CalibrationLoad", "Press", "Rejection"]

Vector = NDArray[np.float64]


class Rejection(StrEnum):
    """Why a press does not count."""

    SLIPPED = "slipped"
    TOO_SHORT = "too short"
    TOO_LONG = "too long"
    TOO_LIGHT = "too light"
    NOT_LET_GO = "not let go"
    REFERENCE_SATURATED = "reference saturated"
    REFERENCE_MISSING = "reference missing"
    OVER_RANGE = "capacitance over range"
    NOT_READ = "element not read"


class CalibrationLoad(NamedTuple):
    """One press. Where `rejection` is given, the values are what is known of it, NaN where nothing is.

    Attributes:
        t_ns: Middle of the hold, or of the press [ns].
        dwell_s: How long it was held still [s].
        force_n: Mean force of the reference, its zero of the last rests taken off [N], shape (3,), foot frame.
        force_noise_n: Standard deviation of a single sample of it [N], shape (3,).
        capacitance_pf: Mean of each element, stray included [pF], shape (9,).
        rest_pf: The same unloaded: of just before and after, at the time of the hold [pF], shape (9,).
        shift_pf: By how much it was more after than before: drift and creep [pF], shape (9,); NaN if pressed again at
            once.
        estimate_n: Mean force that the daemon made of it [N], shape (3,); NaN where the foot was not usable.
        n_samples: Samples of the reference in the hold.
        n_scans: Scans in the hold.
        saturated: Whether an axis of the reference stood at its end.
        rejection: Why it does not count; None if it does.
        words: The same with the numbers that decided it.
        lag_s: By how much the reference was later than the capacitances [s]; NaN if that cannot be told.
    """

    t_ns: int
    dwell_s: float
    force_n: Vector
    force_noise_n: Vector
    capacitance_pf: Vector
    rest_pf: Vector
    shift_pf: Vector
    estimate_n: Vector
    n_samples: int
    n_scans: int
    saturated: bool
    rejection: Rejection | None = None
    words: str = ""
    lag_s: float = math.nan


class Press(NamedTuple):
    """A press and the rest around it, oldest first.

    Attributes:
        t_ns: Time of each scan of the leg [ns], shape (scans,), int64.
        capacitance_pf: Its elements [pF], shape (scans, 9).
        reading: How they answered, shape (scans, 9), uint8 of `Reading`.
        estimate_n: What the daemon made of it [N], shape (scans, 3).
        sample_ns: Time of each sample of the reference [ns], shape (samples,), int64.
        force_n: The samples [N], shape (samples, 3).
        saturated: Whether an axis stood at its end, shape (samples,).
        before_ns: Rest before it, from and until [ns].
        pressed_ns: From and until when it was pressed [ns].
        after_ns: Rest after it [ns]; None if there was none.
        zero_sum_n: Sum of the reference's samples in the rests of the last seconds, that before it included [N],
            shape (3,): its zero drifts less than one short rest can tell.
        zero_samples: How many these are.
    """

    t_ns: NDArray[np.int64]
    capacitance_pf: Vector
    reading: NDArray[np.uint8]
    estimate_n: Vector
    sample_ns: NDArray[np.int64]
    force_n: Vector
    saturated: NDArray[np.bool_]
    before_ns: tuple[int, int]
    pressed_ns: tuple[int, int]
    after_ns: tuple[int, int] | None
    zero_sum_n: Vector
    zero_samples: int
