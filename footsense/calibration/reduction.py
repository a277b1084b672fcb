"""Reduce one press to a calibration load: find its dwell, check for rejection, and average over the dwell.

The dwell is the longest span of a press in which reference force and capacitances stay constant.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from footsense.calibration.loads import (
    CalibrationLoad,
    Press,
    RejectedPress,
    Rejection,
    Span,
    column_deviations,
    column_means,
    is_in_span,
    unsaturated_samples_n,
)
from footsense.frames import Mask, Reading, ReferenceSamples, Stamps, Vector

#: Shortest dwell of a load [s]: 60 samples of a slow sensor, 12 scans, 3 of the slowest converter.
_MIN_DWELL_S = 0.3
_MIN_DWELL_NS = round(_MIN_DWELL_S * 1e9)
#: Half width of the mean of the reference about a scan [ns].
_HALF_WINDOW_NS = 60_000_000
#: Largest range in a dwell, of the force and of the largest change of capacitance [1]; rubber creeps by 2 % a second.
_FORCE_TOLERANCE_REL, _CAPACITANCE_TOLERANCE_REL = 0.04, 0.05
#: Range of some dozen noisy values [standard deviations].
_NOISE_PEAK_TO_PEAK_SIGMAS = 5.0
#: Smallest force of a load [N]: a sensor for 80 N resolves 0.12 N, averaged over a dwell a tenth of that.
_MIN_FORCE_N = 0.1
#: Least share of the expected samples and scans.
_MIN_ANSWERED_SCANS_REL = 0.9


class _UnloadedSpan(NamedTuple):
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


def reduce_press(press: Press) -> CalibrationLoad | RejectedPress:
    """Return the calibration load of a press, or the reason for its rejection."""
    before = _average_unloaded_span(press, press.unloaded_before_ns)
    dwell_ns = _longest_dwell(press, before)
    return next(_rejection_reasons(press, before, dwell_ns), None) or _mean_load(press, dwell_ns, before)


def _rejection_reasons(press: Press, before: _UnloadedSpan, dwell_ns: Span) -> Iterator[RejectedPress]:
    """Yield the reasons to reject a press, causes before their consequences."""
    reading = press.reading[is_in_span(press.t_ns, press.pressed_span_ns)]
    over = (reading == Reading.OVER_RANGE).any(axis=0)
    silent = (reading != Reading.OK).mean(axis=0) > 1 - _MIN_ANSWERED_SCANS_REL
    # An element that was not read unloaded, or not in the dwell, is unknown as well.
    dwell_pf = press.capacitance_pf[is_in_span(press.t_ns, dwell_ns)]
    silent |= np.isnan(before.capacitance_pf) | (len(dwell_pf) > 0) & np.isnan(dwell_pf).all(axis=0)
    if over.any():
        reason = f"element {_element_list_text(over)} at the end of the converter's range"
        yield RejectedPress(Rejection.OVER_RANGE, reason)
    if silent.any():
        yield RejectedPress(Rejection.NOT_READ, f"element {_element_list_text(silent)} did not answer")
    if not len(before.reference_samples_n):
        yield RejectedPress(
            Rejection.REFERENCE_MISSING, "no unsaturated reference sample just before the press"
        )
    dwell_s, pressed_s = ((end_ns - begin_ns) / 1e9 for begin_ns, end_ns in (dwell_ns, press.pressed_span_ns))
    dwelt = dwell_s >= _MIN_DWELL_S
    samples = is_in_span(press.reference.t_ns, dwell_ns if dwelt else press.pressed_span_ns)
    if press.reference.saturated[samples].any():
        largest_n = np.abs(press.reference.force_n[samples]).max()
        yield RejectedPress(
            Rejection.REFERENCE_SATURATED, f"an axis is at the end of its range, {largest_n:.1f} N"
        )
    expected = round((dwell_s if dwelt else pressed_s) * 1e9 / _sample_period_ns(press.reference))
    if samples.sum() < _MIN_ANSWERED_SCANS_REL * expected:
        yield RejectedPress(
            Rejection.REFERENCE_MISSING, f"{samples.sum()} of about {expected} samples are there"
        )
    if not dwelt:
        reason = f"still for {dwell_s:.2f} s of {pressed_s:.2f} s, at least {_MIN_DWELL_S:g} s are needed"
        rejection = Rejection.TOO_SHORT if pressed_s < 2 * _MIN_DWELL_S else Rejection.SLIPPED
        yield RejectedPress(rejection, reason)


def _mean_load(press: Press, dwell_ns: Span, before: _UnloadedSpan) -> CalibrationLoad | RejectedPress:
    """Return the means over the dwell relative to the unloaded spans before and after it, or a rejection."""
    scans, samples = is_in_span(press.t_ns, dwell_ns), is_in_span(press.reference.t_ns, dwell_ns)
    baseline_pf, offsets_n = before.capacitance_pf, press.reference_offset_samples_n
    after = (
        None if press.unloaded_after_ns is None else _average_unloaded_span(press, press.unloaded_after_ns)
    )
    if after is not None and len(after.reference_samples_n) and not np.isnan(after.capacitance_pf).any():
        share = (sum(dwell_ns) // 2 - before.mean_t_ns) / (after.mean_t_ns - before.mean_t_ns)
        baseline_pf = baseline_pf + share * (after.capacitance_pf - before.capacitance_pf)
        offsets_n = np.concatenate([offsets_n, after.reference_samples_n])
    reference_offset_n = offsets_n.mean(axis=0)
    dwell_n = press.reference.force_n[samples]
    force_n = dwell_n.mean(axis=0) - reference_offset_n
    magnitude_n = float(np.linalg.norm(force_n))
    if magnitude_n < _MIN_FORCE_N:
        reason = f"the reference measured {magnitude_n:.3f} N, at least {_MIN_FORCE_N:g} N are needed"
        return RejectedPress(Rejection.TOO_LIGHT, reason)
    return CalibrationLoad(
        dwell_ns=dwell_ns,
        force_n=force_n,
        sigma_n=dwell_n.std(axis=0) / np.sqrt(len(dwell_n)),
        capacitance_pf=column_means(press.capacitance_pf[scans]),
        baseline_pf=baseline_pf,
    )


def _element_list_text(which: Mask) -> str:
    """Return the numbers of the selected elements as text."""
    return ", ".join(map(str, np.flatnonzero(which)))


def _average_unloaded_span(press: Press, span_ns: Span) -> _UnloadedSpan:
    """Return mean readings, their noise and the reference samples over an unloaded span [ns] of a press."""
    inside = is_in_span(press.t_ns, span_ns)
    scans = press.capacitance_pf[inside]
    t_ns = float(press.t_ns[inside].mean()) if inside.any() else sum(span_ns) / 2
    return _UnloadedSpan(
        t_ns, column_means(scans), column_deviations(scans), unsaturated_samples_n(press.reference, span_ns)
    )


def _longest_dwell(press: Press, before: _UnloadedSpan) -> Span:
    """Return start and end of the longest constant span of a press [ns]; equal if there is none."""
    t_ns = press.t_ns[pressed := is_in_span(press.t_ns, press.pressed_span_ns)]
    force_n = _reference_means_n(press.reference, t_ns) - column_means(before.reference_samples_n)
    change_pf = press.capacitance_pf[pressed] - before.capacitance_pf
    # A mean of n samples has less noise than each of them.
    n_beside = max(2 * _HALF_WINDOW_NS / _sample_period_ns(press.reference), 1.0)
    noise_n = _NOISE_PEAK_TO_PEAK_SIGMAS * column_deviations(before.reference_samples_n) / np.sqrt(n_beside)
    noise_pf = _NOISE_PEAK_TO_PEAK_SIGMAS * before.noise_pf
    limit_n = _FORCE_TOLERANCE_REL * np.linalg.norm(force_n, axis=1, keepdims=True) + noise_n
    largest_pf = np.fmax.reduce(np.abs(change_pf), axis=1, keepdims=True)
    limit_pf = _CAPACITANCE_TOLERANCE_REL * largest_pf + noise_pf
    first, last = longest_steady_range(t_ns, force_n, change_pf, limit_n, limit_pf)
    # The first and the last scan may be the ends of motions.
    start_ns, end_ns = int(t_ns[first]), int(t_ns[last])
    edge_ns = min(_HALF_WINDOW_NS, max((end_ns - start_ns - _MIN_DWELL_NS) // 2, 0))
    return start_ns + edge_ns, end_ns - edge_ns


def longest_steady_range(
    t_ns: Stamps, force_n: Vector, change_pf: Vector, limit_n: Vector, limit_pf: Vector
) -> tuple[int, int]:
    """Return the first and last scan of the longest constant span; the same scan if there is none.

    Args:
        t_ns: Time of each scan [ns], shape (scans,), at least one.
        force_n: Reference force about each [N], shape (scans, 3); no span contains a NaN.
        change_pf: Change of each element [pF], shape (scans, 9); NaN, not read, is ignored.
        limit_n: Largest range of the force in a span that ends at each scan [N], shape (scans, 3).
        limit_pf: The same of the elements [pF], shape (scans, 9); NaN for no limit.
    """
    first, best = 0, (0, 0)
    for last in range(len(t_ns)):
        while first < last:
            span = slice(first, last + 1)
            moved_pf = np.fmax.reduce(change_pf[span]) - np.fmin.reduce(change_pf[span])
            if (np.ptp(force_n[span], axis=0) <= limit_n[last]).all() and not (
                moved_pf > limit_pf[last]
            ).any():
                break
            first += 1
        if t_ns[last] - t_ns[first] > t_ns[best[1]] - t_ns[best[0]]:
            best = first, last
    return best


def _reference_means_n(reference: ReferenceSamples, t_ns: Stamps) -> Vector:
    """Return the moving average of the reference force at given times [N], shape (times, 3); NaN without samples."""
    first = np.searchsorted(reference.t_ns, t_ns - _HALF_WINDOW_NS)
    last = np.searchsorted(reference.t_ns, t_ns + _HALF_WINDOW_NS)
    total_n = np.vstack([np.zeros(3), np.cumsum(reference.force_n, axis=0)])
    n = (last - first)[:, None]
    return np.where(n > 0, (total_n[last] - total_n[first]) / np.maximum(n, 1), np.nan)


def _sample_period_ns(reference: ReferenceSamples) -> float:
    """Return the median period of the reference samples [ns]; 1 s if there are fewer than two."""
    if len(reference.t_ns) < 2:
        return 1e9
    return max(float(np.median(np.diff(reference.t_ns))), 1.0)
