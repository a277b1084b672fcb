"""Reduction of one press to a calibration load: dwell, means over it, reasons for rejection.

The dwell is the longest span in which neither the reference force nor the foot's capacitances moved.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from footsense.calibration.loads.calibration_load import CalibrationLoad, Press, Rejection, column_means
from footsense.calibration.loads.reference_lag import lag_s
from footsense.calibration.loads.steady_span import longest_steady
from footsense.frames import ELEMENTS, Mask, Reading, Stamps, Vector

_NS_PER_S = 1_000_000_000

#: Shortest dwell of a load [s]: 60 samples of a slow sensor, 12 scans, 3 of the slowest converter.
MIN_DWELL_S = 0.3
_MIN_DWELL_NS = round(MIN_DWELL_S * _NS_PER_S)
#: Half width of the mean of the reference about a scan [ns].
_BESIDE_NS = 60_000_000
#: Largest range in a dwell, of the force and of the largest change of capacitance [1]; rubber creeps by 2 % a second.
_FORCE_REL, _CAPACITANCE_REL = 0.04, 0.05
#: Range of some dozen noisy values [standard deviations].
_NOISE_RANGE = 5.0
#: Smallest force of a load [N]: a sensor for 80 N resolves 0.12 N, averaged over a dwell a tenth of that.
MIN_FORCE_N = 0.1
#: Least share of the expected samples and scans.
_PRESENT_REL = 0.9


class _Unloaded(NamedTuple):
    """Means and standard deviations of the readings over an unloaded span, and the span's mean time."""

    t_ns: float
    capacitance_pf: Vector
    noise_pf: Vector
    force_n: Vector
    noise_n: Vector
    n_samples: int


def reduce_press(press: Press) -> CalibrationLoad:
    """Return one calibration load for a recorded press, accepted, or rejected with the reason."""
    before = _unloaded(press, press.before_ns)
    dwell_ns = _longest_dwell(press, before)
    rejection = next(_rejections(press, before, dwell_ns), None)
    if rejection is None:
        return _means(press, dwell_ns, before)
    samples = _within(press.sample_ns, press.pressed_ns)
    n_scans = int(_within(press.t_ns, press.pressed_ns).sum())
    counts = (int(samples.sum()), n_scans, bool(press.saturated[samples].any()))
    return CalibrationLoad.rejected(sum(press.pressed_ns) // 2, *rejection, counts)


def _rejections(
    press: Press, before: _Unloaded, dwell_ns: tuple[int, int]
) -> Iterator[tuple[Rejection, str]]:
    """Yield why a press gives no load, causes before their consequences."""
    reading = press.reading[_within(press.t_ns, press.pressed_ns)]
    over = (reading == Reading.OVER_RANGE).any(axis=0)
    silent = (reading != Reading.OK).mean(axis=0) > 1 - _PRESENT_REL
    # An element that was not read unloaded, or not in the dwell, is unknown as well.
    dwell_pf = press.capacitance_pf[_within(press.t_ns, dwell_ns)]
    silent |= np.isnan(before.capacitance_pf) | (len(dwell_pf) > 0) & np.isnan(dwell_pf).all(axis=0)
    if over.any():
        yield Rejection.OVER_RANGE, f"element {_elements(over)} at the end of the converter's range"
    if silent.any():
        yield Rejection.NOT_READ, f"element {_elements(silent)} did not answer"
    if before.n_samples == 0:
        yield Rejection.REFERENCE_MISSING, "no unsaturated reference sample just before the press"
    dwell_s, pressed_s = _seconds(dwell_ns), _seconds(press.pressed_ns)
    dwelt = dwell_s >= MIN_DWELL_S
    samples = _within(press.sample_ns, dwell_ns if dwelt else press.pressed_ns)
    if press.saturated[samples].any():
        largest_n = np.abs(press.force_n[samples]).max()
        yield Rejection.REFERENCE_SATURATED, f"an axis is at the end of its range, {largest_n:.1f} N"
    expected = round((dwell_s if dwelt else pressed_s) * _NS_PER_S / _sample_period_ns(press))
    if samples.sum() < _PRESENT_REL * expected:
        yield Rejection.REFERENCE_MISSING, f"{samples.sum()} of about {expected} samples are there"
    if not dwelt:
        reason = f"still for {dwell_s:.2f} s of {pressed_s:.2f} s, at least {MIN_DWELL_S:g} s are needed"
        yield Rejection.TOO_SHORT if pressed_s < 2 * MIN_DWELL_S else Rejection.SLIPPED, reason


def _means(press: Press, dwell_ns: tuple[int, int], before: _Unloaded) -> CalibrationLoad:
    """Return the means over a dwell minus the means of the unloaded spans before and after it."""
    scans, samples = _within(press.t_ns, dwell_ns), _within(press.sample_ns, dwell_ns)
    middle_ns = (dwell_ns[0] + dwell_ns[1]) // 2
    baseline_pf, offset_sum_n, offset_samples = (
        before.capacitance_pf,
        press.offset_sum_n,
        press.offset_samples,
    )
    shift_pf = np.full(ELEMENTS, np.nan)
    after = None if press.after_ns is None else _unloaded(press, press.after_ns)
    if after is not None and after.n_samples and not np.isnan(after.capacitance_pf).any():
        share = (middle_ns - before.t_ns) / (after.t_ns - before.t_ns)
        shift_pf = after.capacitance_pf - before.capacitance_pf
        baseline_pf = baseline_pf + share * shift_pf
        offset_sum_n = offset_sum_n + after.n_samples * after.force_n
        offset_samples += after.n_samples
    offset_n = offset_sum_n / offset_samples
    force_n = press.force_n[samples].mean(axis=0) - offset_n
    load = CalibrationLoad(
        t_ns=middle_ns,
        dwell_s=_seconds(dwell_ns),
        force_n=force_n,
        force_noise_n=press.force_n[samples].std(axis=0),
        capacitance_pf=column_means(press.capacitance_pf[scans]),
        baseline_pf=baseline_pf,
        shift_pf=shift_pf,
        estimate_n=column_means(press.estimate_n[scans]),
        n_samples=int(samples.sum()),
        n_scans=int(scans.sum()),
        saturated=False,
    )
    magnitude_n = float(np.linalg.norm(force_n))
    if magnitude_n < MIN_FORCE_N:
        reason = f"the reference measured {magnitude_n:.3f} N, at least {MIN_FORCE_N:g} N are needed"
        return load._replace(rejection=Rejection.TOO_LIGHT, reason=reason)
    return load._replace(lag_s=lag_s(press, dwell_ns, baseline_pf, offset_n, force_n))


def _longest_dwell(press: Press, before: _Unloaded) -> tuple[int, int]:
    """Return begin and end of the longest span without motion [ns], equal if there is none."""
    t_ns = press.t_ns[pressed := _within(press.t_ns, press.pressed_ns)]
    force_n = _beside(press, t_ns) - before.force_n
    change_pf = press.capacitance_pf[pressed] - before.capacitance_pf
    # A mean of n samples has less noise than each of them.
    n_beside = max(2 * _BESIDE_NS / _sample_period_ns(press), 1.0)
    noise_n = _NOISE_RANGE * before.noise_n / np.sqrt(n_beside)
    noise_pf = _NOISE_RANGE * before.noise_pf
    limit_n = _FORCE_REL * np.linalg.norm(force_n, axis=1, keepdims=True) + noise_n
    largest_pf = np.fmax.reduce(np.abs(change_pf), axis=1, keepdims=True)
    limit_pf = _CAPACITANCE_REL * largest_pf + noise_pf
    first, last = longest_steady(t_ns, force_n, change_pf, limit_n, limit_pf)
    # Its first and last scans may be the ends of motions.
    begin_ns, end_ns = int(t_ns[first]), int(t_ns[last])
    edge_ns = min(_BESIDE_NS, max((end_ns - begin_ns - _MIN_DWELL_NS) // 2, 0))
    return begin_ns + edge_ns, end_ns - edge_ns


def _beside(press: Press, t_ns: Stamps) -> Vector:
    """Return the mean of the reference about each time [N], shape (times, 3); NaN without a sample."""
    first = np.searchsorted(press.sample_ns, t_ns - _BESIDE_NS)
    last = np.searchsorted(press.sample_ns, t_ns + _BESIDE_NS)
    total_n = np.vstack([np.zeros(3), np.cumsum(press.force_n, axis=0)])
    n = (last - first)[:, None]
    return np.where(n > 0, (total_n[last] - total_n[first]) / np.maximum(n, 1), np.nan)


def _sample_period_ns(press: Press) -> float:
    """Return the median time between two reference samples [ns]; 1 s if there are fewer than two."""
    if len(press.sample_ns) < 2:
        return float(_NS_PER_S)
    return max(float(np.median(np.diff(press.sample_ns))), 1.0)


def _unloaded(press: Press, span_ns: tuple[int, int]) -> _Unloaded:
    inside = _within(press.t_ns, span_ns)
    scans = press.capacitance_pf[inside]
    samples = press.force_n[_within(press.sample_ns, span_ns) & ~press.saturated]
    n, unknown = len(samples), np.full(3, np.nan)
    return _Unloaded(
        t_ns=float(press.t_ns[inside].mean()) if inside.any() else sum(span_ns) / 2,
        capacitance_pf=column_means(scans),
        noise_pf=np.sqrt(column_means((scans - column_means(scans)) ** 2)),
        force_n=samples.mean(axis=0) if n else unknown,
        noise_n=samples.std(axis=0) if n else unknown,
        n_samples=n,
    )


def _seconds(span_ns: tuple[int, int]) -> float:
    return (span_ns[1] - span_ns[0]) / _NS_PER_S


def _within(t_ns: Stamps, span_ns: tuple[int, int]) -> Mask:
    inside: Mask = (t_ns >= span_ns[0]) & (t_ns <= span_ns[1])
    return inside


def _elements(which: Mask) -> str:
    return ", ".join(map(str, np.flatnonzero(which)))
