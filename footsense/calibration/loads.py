"""A press with its samples, the calibration load reduced from it or the reason for its rejection, and sets of loads."""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from enum import StrEnum
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from footsense.foot.directions import normalized
from footsense.frames import ELEMENTS, Codes, Mask, ReferenceSamples, Stamps, Vector

#: Start and end of a time span [ns], both included.
Span = tuple[int, int]


class Rejection(StrEnum):
    """Reason why a press gives no calibration load."""

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
    """Means over the dwell of one press: reference force and element capacitances.

    Attributes:
        dwell_ns: Start and end of the dwell, the longest time without motion [ns].
        force_n: Mean reference force minus its offset [N], shape (3,), foot frame.
        sigma_n: Standard deviation of that mean by noise alone [N], shape (3,).
        capacitance_pf: Mean reading of each element, stray included [pF], shape (9,).
        baseline_pf: Unloaded reading before and after, interpolated to the dwell [pF], shape (9,).
    """

    dwell_ns: Span
    force_n: Vector
    sigma_n: Vector
    capacitance_pf: Vector
    baseline_pf: Vector


class RejectedPress(NamedTuple):
    """Press that gives no calibration load, with the reason.

    Attributes:
        rejection: Why it gives none.
        reason: The same with the numbers that decided it.
    """

    rejection: Rejection
    reason: str


class Press(NamedTuple):
    """Samples of one press and of the unloaded spans before and after it, oldest first.

    Attributes:
        t_ns: Time of each scan of the leg [ns], shape (scans,), int64.
        capacitance_pf: Reading of each element [pF], shape (scans, 9).
        reading: State of each reading, shape (scans, 9), uint8 of `Reading`.
        reference: Samples of the reference sensor.
        unloaded_before_ns: Start and end of the unloaded span before it [ns].
        pressed_span_ns: Start and end of the press [ns].
        unloaded_after_ns: Start and end of the unloaded span after it [ns]; None if there is none.
        reference_offset_samples_n: Unsaturated reference samples in the unloaded spans of the last seconds,
            `unloaded_before_ns` included [N], shape (n, 3): the offset drifts less than one span's noise.
    """

    t_ns: Stamps
    capacitance_pf: Vector
    reading: Codes
    reference: ReferenceSamples
    unloaded_before_ns: Span
    pressed_span_ns: Span
    unloaded_after_ns: Span | None
    reference_offset_samples_n: Vector


def column_means(values: Vector) -> Vector:
    """Return the mean of each column over its non-NaN rows, shape (columns,); NaN if there are none."""
    n = (~np.isnan(values)).sum(axis=0)
    return np.where(n > 0, np.nansum(values, axis=0) / np.maximum(n, 1), np.nan)


def column_deviations(values: Vector) -> Vector:
    """Return the standard deviation of each column over its non-NaN rows, shape (columns,)."""
    deviations: Vector = np.sqrt(column_means((values - column_means(values)) ** 2))
    return deviations


def is_in_span(t_ns: Stamps, span_ns: Span) -> Mask:
    """Return the mask of the times within a span."""
    is_inside: Mask = (t_ns >= span_ns[0]) & (t_ns <= span_ns[1])
    return is_inside


def unsaturated_samples_n(reference: ReferenceSamples, span_ns: Span) -> Vector:
    """Return the reference samples within a span without saturated axes [N], shape (n, 3)."""
    return reference.force_n[is_in_span(reference.t_ns, span_ns) & ~reference.saturated]


@dataclass(frozen=True, slots=True, eq=False)
class LoadedFoot:
    """Readings of one foot under loads, one row per load.

    Attributes:
        capacitance_pf: Reading of each element, stray included [pF], shape (n, 9).
        baseline_pf: Unloaded reading at that time [pF], shape (n, 9).
    """

    capacitance_pf: Vector
    baseline_pf: Vector

    def __len__(self) -> int:
        """Return the number of loads."""
        return len(self.capacitance_pf)

    @property
    def median_baseline_pf(self) -> Vector:
        """Median unloaded reading of each element over the loads [pF], shape (9,)."""
        unloaded_pf: Vector = np.median(self.baseline_pf, axis=0)
        return unloaded_pf

    @property
    def drift_corrected_pf(self) -> Vector:
        """Readings under load, corrected for drift of the unloaded reading [pF], shape (n, 9)."""
        return self.capacitance_pf - self.baseline_pf + self.median_baseline_pf


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LoadSet(LoadedFoot):
    """Accepted calibration loads of one foot as arrays, one row per load.

    Attributes:
        force_n: Reference force [N], shape (n, 3), leg frame.
        sigma_n: Standard deviation of that mean by noise alone [N], shape (n, 3).
    """

    force_n: Vector
    sigma_n: Vector

    @classmethod
    def from_loads(cls, loads: Sequence[CalibrationLoad]) -> Self:
        """Return a list of calibration loads in array form."""
        widths = {"force_n": 3, "sigma_n": 3, "capacitance_pf": ELEMENTS, "baseline_pf": ELEMENTS}
        return cls(
            **{
                name: np.array([getattr(load, name) for load in loads]).reshape(-1, width)
                for name, width in widths.items()
            }
        )

    @classmethod
    def joined(cls, sets: Sequence[Self]) -> Self:
        """Return the loads of several sets, one behind the other."""
        return cls(
            **{one.name: np.concatenate([getattr(of, one.name) for of in sets]) for one in fields(cls)}
        )

    def subset(self, which: NDArray[np.intp] | Mask) -> Self:
        """Return the selected loads, by index or by mask."""
        return type(self)(**{one.name: getattr(self, one.name)[which] for one in fields(self)})

    def space_filling_order(self) -> NDArray[np.intp]:
        """Return an order of the loads, shape (n,), whose first k cover the forces evenly for any k.

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
