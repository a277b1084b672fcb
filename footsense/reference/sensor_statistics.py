"""Counters of a force sensor's data stream."""

from dataclasses import dataclass


@dataclass(slots=True)
class SensorStatistics:
    """Statistics of a force sensor's data stream: counts of samples and faults, and the error of its times.

    Attributes:
        n_samples: Samples received.
        n_missing: Samples lost, by their times and sequence numbers.
        n_bad_records: Lines, records or packets that could not be decoded.
        n_saturated: Samples with a saturated axis.
        n_clock_jumps: Jumps of its clock.
        n_stream_starts: Openings of its line.
        clock_fit_residual_ms: Uncertainty of the times [ms].
    """

    n_samples: int = 0
    n_missing: int = 0
    n_bad_records: int = 0
    n_saturated: int = 0
    n_clock_jumps: int = 0
    n_stream_starts: int = 0
    clock_fit_residual_ms: float = 0.0
