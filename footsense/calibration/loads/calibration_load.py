"""A press as arrays, the calibration load reduced from it, and the loads of a foot as arrays."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from footsense.foot.directions import normalized
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


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LoadSet:
    """The accepted calibration loads of a foot as arrays.

    Attributes:
        force_n: Reference force [N], shape (n, 3), leg frame.
        sigma_n: Standard deviation of that mean by noise alone [N], shape (n, 3).
        capacitance_pf: Reading of each element, stray included [pF], shape (n, 9).
        baseline_pf: Unloaded reading at that time [pF], shape (n, 9).
    """

    force_n: Vector
    sigma_n: Vector
    capacitance_pf: Vector
    baseline_pf: Vector

    @classmethod
    def of(cls, loads: Sequence[CalibrationLoad]) -> Self:
        """Return the accepted ones of some loads."""
        accepted = [load for load in loads if load.rejection is None]
        return cls(
            force_n=np.array([load.force_n for load in accepted]).reshape(-1, 3),
            sigma_n=np.array([load.force_noise_n / np.sqrt(load.n_samples) for load in accepted]).reshape(
                -1, 3
            ),
            capacitance_pf=np.array([load.capacitance_pf for load in accepted]).reshape(-1, 9),
            baseline_pf=np.array([load.baseline_pf for load in accepted]).reshape(-1, 9),
        )

    def __len__(self) -> int:
        """Return the number of loads."""
        return len(self.force_n)

    def subset(self, which: NDArray[np.intp] | Mask) -> Self:
        """Return some of the loads, by index or by mask."""
        return type(self)(**{name: getattr(self, name)[which] for name in self.__slots__})

    @property
    def unloaded_pf(self) -> Vector:
        """Unloaded reading of each element [pF], shape (9,): the median over the loads."""
        unloaded_pf: Vector = np.median(self.baseline_pf, axis=0)
        return unloaded_pf

    @property
    def undrifted_pf(self) -> Vector:
        """Readings minus the drift of the unloaded reading since its median [pF], shape (n, 9)."""
        return self.capacitance_pf - self.baseline_pf + self.unloaded_pf

    def spread_order(self) -> NDArray[np.intp]:
        """Return an order of the loads, shape (n,), of which any beginning covers the forces well.

        The first load is the nearest to the mean; each next one is the farthest from all before it, by direction and
        magnitude (farthest-point sampling).
        """
        log_magnitude = np.log(np.linalg.norm(self.force_n, axis=1, keepdims=True))
        points = np.hstack([normalized(self.force_n), 0.5 * log_magnitude])
        order = [int(np.argmin(((points - points.mean(axis=0)) ** 2).sum(axis=1)))]
        distance = np.full(len(self), np.inf)
        while len(order) < len(self):
            distance = np.minimum(distance, ((points - points[order[-1]]) ** 2).sum(axis=1))
            distance[order[-1]] = -1.0
            order.append(int(np.argmax(distance)))
        return np.array(order, dtype=np.intp)


def column_means(values: Vector) -> Vector:
    """Return the mean of each column over the rows that are not NaN, shape (columns,); NaN where all are."""
    n = (~np.isnan(values)).sum(axis=0)
    return np.where(n > 0, np.nansum(values, axis=0) / np.maximum(n, 1), np.nan)
