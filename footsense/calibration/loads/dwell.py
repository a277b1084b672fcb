"""Find the dwell of a press: its longest span in which reference force and capacitances stay constant."""

from typing import NamedTuple

import numpy as np

from footsense.calibration.loads.calibration_load import Press
from footsense.calibration.loads.span_means import (
    column_deviations,
    column_means,
    is_in_span,
    unsaturated_samples_n,
)
from footsense.calibration.loads.steady_span import longest_steady_scan_range
from footsense.frames import ReferenceSamples, Stamps, Vector

#: Shortest dwell of a load [s]: 60 samples of a slow sensor, 12 scans, 3 of the slowest converter.
MIN_DWELL_S = 0.3
_MIN_DWELL_NS = round(MIN_DWELL_S * 1e9)
#: Half width of the mean of the reference about a scan [ns].
_HALF_WINDOW_NS = 60_000_000
#: Largest range in a dwell, of the force and of the largest change of capacitance [1]; rubber creeps by 2 % a second.
_FORCE_TOLERANCE_REL, _CAPACITANCE_TOLERANCE_REL = 0.04, 0.05
#: Range of some dozen noisy values [standard deviations].
_NOISE_PEAK_TO_PEAK_SIGMAS = 5.0


class UnloadedSpan(NamedTuple):
    """Mean readings and reference samples over a span in which the foot is unloaded.

    Attributes:
        mean_t_ns: Mean time of the scans [ns].
        capacitance_pf: Mean reading of each element [pF], shape (9,).
        noise_pf: Standard deviation of the readings [pF], shape (9,).
        reference_samples_n: Unsaturated reference samples [N], shape (n, 3).
    """

    mean_t_ns: float
    capacitance_pf: Vector
    noise_pf: Vector
    reference_samples_n: Vector


def average_unloaded_span(press: Press, span_ns: tuple[int, int]) -> UnloadedSpan:
    """Return mean readings, their noise and the reference samples over an unloaded span [ns] of a press."""
    inside = is_in_span(press.t_ns, span_ns)
    scans = press.capacitance_pf[inside]
    t_ns = float(press.t_ns[inside].mean()) if inside.any() else sum(span_ns) / 2
    return UnloadedSpan(
        t_ns, column_means(scans), column_deviations(scans), unsaturated_samples_n(press.reference, span_ns)
    )


def longest_dwell(press: Press, before: UnloadedSpan) -> tuple[int, int]:
    """Return start and end of the longest constant span of a press [ns]; equal if there is none."""
    t_ns = press.t_ns[pressed := is_in_span(press.t_ns, press.pressed_span_ns)]
    force_n = _reference_means_n(press.reference, t_ns) - column_means(before.reference_samples_n)
    change_pf = press.capacitance_pf[pressed] - before.capacitance_pf
    # A mean of n samples has less noise than each of them.
    n_beside = max(2 * _HALF_WINDOW_NS / sample_period_ns(press.reference), 1.0)
    noise_n = _NOISE_PEAK_TO_PEAK_SIGMAS * column_deviations(before.reference_samples_n) / np.sqrt(n_beside)
    noise_pf = _NOISE_PEAK_TO_PEAK_SIGMAS * before.noise_pf
    limit_n = _FORCE_TOLERANCE_REL * np.linalg.norm(force_n, axis=1, keepdims=True) + noise_n
    largest_pf = np.fmax.reduce(np.abs(change_pf), axis=1, keepdims=True)
    limit_pf = _CAPACITANCE_TOLERANCE_REL * largest_pf + noise_pf
    first, last = longest_steady_scan_range(t_ns, force_n, change_pf, limit_n, limit_pf)
    # The first and the last scan may be the ends of motions.
    start_ns, end_ns = int(t_ns[first]), int(t_ns[last])
    edge_ns = min(_HALF_WINDOW_NS, max((end_ns - start_ns - _MIN_DWELL_NS) // 2, 0))
    return start_ns + edge_ns, end_ns - edge_ns


def _reference_means_n(reference: ReferenceSamples, t_ns: Stamps) -> Vector:
    """Return the moving average of the reference force at given times [N], shape (times, 3); NaN without samples."""
    first = np.searchsorted(reference.t_ns, t_ns - _HALF_WINDOW_NS)
    last = np.searchsorted(reference.t_ns, t_ns + _HALF_WINDOW_NS)
    total_n = np.vstack([np.zeros(3), np.cumsum(reference.force_n, axis=0)])
    n = (last - first)[:, None]
    return np.where(n > 0, (total_n[last] - total_n[first]) / np.maximum(n, 1), np.nan)


def sample_period_ns(reference: ReferenceSamples) -> float:
    """Return the median period of the reference samples [ns]; 1 s if there are fewer than two."""
    if len(reference.t_ns) < 2:
        return 1e9
    return max(float(np.median(np.diff(reference.t_ns))), 1.0)
