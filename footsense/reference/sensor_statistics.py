"""Counters of a force sensor's data stream."""

from dataclasses import dataclass


@dataclass(slots=True)
class SensorStatistics:
    """Counters of a force sensor's data stream: samples, missing, bad, saturated, clock jumps.

    Attributes:
        n_samples: Samples received.
        n_missing: Samples lost, by their times and sequence numbers.
        n_bad: Lines, records or packets that could not be decoded.
        n_saturated: Samples with a saturated axis.
        n_clock_jumps: Jumps of its clock.
        n_opened: Openings of its line.
        residual_ms: Uncertainty of the times [ms].
    """

    n_samples: int = 0
    n_missing: int = 0
    n_bad: int = 0
    n_saturated: int = 0
    n_clock_jumps: int = 0
    n_opened: int = 0
    residual_ms: float = 0.0
