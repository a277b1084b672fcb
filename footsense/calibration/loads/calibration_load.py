"""A press as arrays, and the calibration load reduced from it."""

import math
from enum import StrEnum
from typing import NamedTuple, Self

import numpy as np

from footsense.frames import Codes, Mask, Stamps, Vector


class Rejection(StrEnum):
    """Why a press gives no calibration load."""

    SLIPPED = "slipped"
    TOO_SHORT = "too short"
    TOO_LONG = "too long"
    TOO_LIGHT = "too light"
    NOT_RELEASED = "not released"
    REFERENCE_SATURATED = "reference saturated"
    REFERENCE_MISSING = "reference missing"
    OVER_RANGE = "capacitance over range"
    NOT_READ = "element not read"


class CalibrationLoad(NamedTuple):
    """The means over one press's dwell. Of a rejected press, values that are unknown are NaN.

    Attributes:
        t_ns: Middle of the dwell; of a rejected press, of the press [ns].
        dwell_s: Longest time without motion [s].
        force_n: Mean reference force minus its offset [N], shape (3,), foot frame.
        force_noise_n: Standard deviation of one reference sample [N], shape (3,).
        capacitance_pf: Mean reading of each element, stray included [pF], shape (9,).
        baseline_pf: Unloaded reading before and after, interpolated to the dwell [pF], shape (9,).
        shift_pf: Change of the unloaded reading from before to after, by drift and creep [pF], shape (9,); NaN if the
            next press followed at once.
        estimate_n: Mean force that the daemon estimated [N], shape (3,); NaN where the leg was not usable.
        n_samples: Reference samples in the dwell.
        n_scans: Scans in the dwell.
        saturated: Whether an axis of the reference was at the end of its range.
        rejection: Why the press gives no load; None if it does.
        reason: The same with the numbers that decided it.
        lag_s: Delay of the reference behind the capacitances [s]; NaN if unknown.
    """

    t_ns: int
    dwell_s: float
    force_n: Vector
    force_noise_n: Vector
    capacitance_pf: Vector
    baseline_pf: Vector
    shift_pf: Vector
    estimate_n: Vector
    n_samples: int
    n_scans: int
    saturated: bool
    rejection: Rejection | None = None
    reason: str = ""
    lag_s: float = math.nan

    @classmethod
    def rejected(
        cls, t_ns: int, rejection: Rejection, reason: str, counts: tuple[int, int, bool] = (0, 0, False)
    ) -> Self:
        """Return a rejected press; `counts` are n_samples, n_scans and saturated."""
        force, capacitance = np.full(3, np.nan), np.full(9, np.nan)
        values = (force, force, capacitance, capacitance, capacitance, force)
        return cls(t_ns, 0.0, *values, *counts, rejection, reason)


class Press(NamedTuple):
    """A press and the unloaded spans around it, oldest first.

    Attributes:
        t_ns: Time of each scan of the leg [ns], shape (scans,), int64.
        capacitance_pf: Its elements [pF], shape (scans, 9).
        reading: State of each reading, shape (scans, 9), uint8 of `Reading`.
        estimate_n: Force that the daemon estimated [N], shape (scans, 3).
        sample_ns: Time of each reference sample [ns], shape (samples,), int64.
        force_n: The samples [N], shape (samples, 3).
        saturated: Whether an axis was at the end of its range, shape (samples,).
        before_ns: Start and end of the unloaded span before it [ns].
        pressed_ns: Start and end of the press [ns].
        after_ns: Start and end of the unloaded span after it [ns]; None if there is none.
        offset_sum_n: Sum of the reference samples in the unloaded spans of the last seconds, `before_ns` included [N],
            shape (3,): the offset drifts less than one span's noise.
        offset_samples: Number of those samples.
    """

    t_ns: Stamps
    capacitance_pf: Vector
    reading: Codes
    estimate_n: Vector
    sample_ns: Stamps
    force_n: Vector
    saturated: Mask
    before_ns: tuple[int, int]
    pressed_ns: tuple[int, int]
    after_ns: tuple[int, int] | None
    offset_sum_n: Vector
    offset_samples: int


def column_means(values: Vector) -> Vector:
    """Return the mean of each column over the rows that are not NaN, shape (columns,); NaN where all are."""
    n = (~np.isnan(values)).sum(axis=0)
    return np.where(n > 0, np.nansum(values, axis=0) / np.maximum(n, 1), np.nan)
