"""Data types of a press: its samples, the calibration load reduced from it, or the reason for its rejection."""

from enum import StrEnum
from typing import NamedTuple

from footsense.frames import Codes, ReferenceSamples, Stamps, Vector


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
        reference_lag_s: Delay of the reference behind the capacitances [s]; NaN if unknown.
    """

    dwell_ns: tuple[int, int]
    force_n: Vector
    sigma_n: Vector
    capacitance_pf: Vector
    baseline_pf: Vector
    reference_lag_s: float


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
    unloaded_before_ns: tuple[int, int]
    pressed_span_ns: tuple[int, int]
    unloaded_after_ns: tuple[int, int] | None
    reference_offset_samples_n: Vector
