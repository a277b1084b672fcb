"""One press of a foot, as arrays: where it was held still, and what it tells.

A press is worth as much as its hold: the time in which neither the reference's force nor the foot's capacitances
moved. The means over the longest such time are the load; what went wrong has a reason and no numbers.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from footsense.calibration.loads.press import CalibrationLoad, Press, Rejection
from footsense.calibration.loads.steady_span import longest_steady
from footsense.calibration.session.reference_lag import lag_s
from footsense.frames import ELEMENTS, Reading

__all__ = ["weigh"]

Vector = NDArray[np.float64]

_NS_PER_S = 1_000_000_000

#: Shortest hold that counts [s]: 60 samples of a slow sensor, 12 scans, 3 of the slowest converter.
HOLD_S = 0.3
_HOLD_NS = round(HOLD_S * _NS_PER_S)
#: The reference is averaged over this much on either side of a scan before its steadiness is judged [ns].
_BESIDE_NS = 60_000_000
#: Largest change in a hold: of the force, of the largest change of capacitance. Rubber creeps by 2 % in a second.
_FORCE_REL, _CAPACITANCE_REL = 0.04, 0.05
#: What noise makes of the range of some dozen values, in standard deviations.
_NOISE_RANGE = 5.0
#: A force below is not a press [N]: a sensor for 80 N steps by 0.12 N, averaged over a hold by a tenth of that.
LEAST_FORCE_N = 0.1
#: Share of the samples and scans that have to be there.
_PRESENT_REL = 0.9


class _Rest(NamedTuple):
    """What stood in a time of rest: means, standard deviations, and when that was."""

    t_ns: float
    capacitance_pf: Vector
    noise_pf: Vector
    force_n: Vector
    noise_n: Vector
    n_samples: int


def weigh(press: Press) -> CalibrationLoad:
    """Return what a press tells, or why it does not count."""
    before = _rest(press, press.before_ns)
    after = None if press.after_ns is None else _rest(press, press.after_ns)
    dwell_ns = _longest_hold(press, before)
    spoilt = next(_spoils(press, before, dwell_ns), None)
    return _held(press, dwell_ns, before, after) if spoilt is None else _refused(press, *spoilt)


def _spoils(press: Press, before: _Rest, dwell_ns: tuple[int, int]) -> Iterator[tuple[Rejection, str]]:
    """Yield what keeps a press from counting, the cause before what it entails."""
    reading = press.reading[_within(press.t_ns, press.pressed_ns)]
    over, silent = reading == Reading.OVER_RANGE, (reading != Reading.OK).mean(axis=0) > 1 - _PRESENT_REL
    # Nor is anything known of one that was not read at rest, or in the hold.
    held_pf = press.capacitance_pf[_within(press.t_ns, dwell_ns)]
    silent |= np.isnan(before.capacitance_pf) | (len(held_pf) > 0) & np.isnan(held_pf).all(axis=0)
    if over.any():
        words = f"element {_elements(over.any(axis=0))} at the end of the converter's range"
        yield Rejection.OVER_RANGE, words
    if silent.any():
        yield Rejection.NOT_READ, f"element {_elements(silent)} did not answer"
    if before.n_samples == 0:
        yield (
            Rejection.REFERENCE_MISSING,
            "no sample of the reference just before it that is no end of its range",
        )
    dwell_s, lasted_s = _seconds(dwell_ns), _seconds(press.pressed_ns)
    held = dwell_s >= HOLD_S
    samples = _within(press.sample_ns, dwell_ns if held else press.pressed_ns)
    if press.saturated[samples].any():
        most_n = np.abs(press.force_n[samples]).max()
        yield Rejection.REFERENCE_SATURATED, f"an axis stands at its end, {most_n:.1f} N"
    expected = round((dwell_s if held else lasted_s) * _NS_PER_S / _sample_period_ns(press))
    if samples.sum() < _PRESENT_REL * expected:
        words = f"{samples.sum()} of about {expected} samples are there"
        yield Rejection.REFERENCE_MISSING, words
    if not held:
        words = f"held still for {dwell_s:.2f} s of {lasted_s:.2f} s, at least {HOLD_S:g} s are needed"
        yield Rejection.TOO_SHORT if lasted_s < 2 * HOLD_S else Rejection.SLIPPED, words


def _held(press: Press, dwell_ns: tuple[int, int], before: _Rest, after: _Rest | None) -> CalibrationLoad:
    """Return the means over a hold, what rest says of the zeros taken off."""
    scans, samples = _within(press.t_ns, dwell_ns), _within(press.sample_ns, dwell_ns)
    middle_ns = (dwell_ns[0] + dwell_ns[1]) // 2
    rest_pf, zero_sum_n, zero_samples = before.capacitance_pf, press.zero_sum_n, press.zero_samples
    shift_pf = np.full(ELEMENTS, np.nan)
    if after is not None and after.n_samples and not np.isnan(after.capacitance_pf).any():
        share = (middle_ns - before.t_ns) / (after.t_ns - before.t_ns)
        shift_pf = after.capacitance_pf - before.capacitance_pf
        rest_pf = rest_pf + share * shift_pf
        zero_sum_n = zero_sum_n + after.n_samples * after.force_n
        zero_samples += after.n_samples
    zero_n = zero_sum_n / zero_samples
    force_n = press.force_n[samples].mean(axis=0) - zero_n
    load = CalibrationLoad(
        t_ns=middle_ns,
        dwell_s=_seconds(dwell_ns),
        force_n=force_n,
        force_noise_n=press.force_n[samples].std(axis=0),
        capacitance_pf=_mean(press.capacitance_pf[scans]),
        rest_pf=rest_pf,
        shift_pf=shift_pf,
        estimate_n=_mean(press.estimate_n[scans]),
        n_samples=int(samples.sum()),
        n_scans=int(scans.sum()),
        saturated=False,
    )
    magnitude_n = float(np.linalg.norm(force_n))
    if magnitude_n < LEAST_FORCE_N:
        words = f"the reference felt {magnitude_n:.3f} N, at least {LEAST_FORCE_N:g} N are needed"
        return load._replace(rejection=Rejection.TOO_LIGHT, words=words)
    return load._replace(lag_s=lag_s(press, dwell_ns, rest_pf, zero_n, force_n))


def _longest_hold(press: Press, before: _Rest) -> tuple[int, int]:
    """Return from and until when nothing moved for longest [ns]; a moment if something always did."""
    t_ns = press.t_ns[pressed := _within(press.t_ns, press.pressed_ns)]
    force_n = _beside(press, t_ns) - before.force_n
    change_pf = press.capacitance_pf[pressed] - before.capacitance_pf
    # A mean of some samples has less noise than each.
    n_beside = max(2 * _BESIDE_NS / _sample_period_ns(press), 1.0)
    noise_n = _NOISE_RANGE * before.noise_n / np.sqrt(n_beside)
    noise_pf = _NOISE_RANGE * before.noise_pf
    limit_n = _FORCE_REL * np.linalg.norm(force_n, axis=1, keepdims=True) + noise_n
    largest_pf = np.fmax.reduce(np.abs(change_pf), axis=1, keepdims=True)
    limit_pf = _CAPACITANCE_REL * largest_pf + noise_pf
    best = longest_steady(t_ns, force_n, change_pf, limit_n, limit_pf)
    # The first and the last of it may be the ends of moves that were not over.
    begin_ns, end_ns = int(t_ns[best[0]]), int(t_ns[best[1]])
    edge_ns = min(_BESIDE_NS, max((end_ns - begin_ns - _HOLD_NS) // 2, 0))
    return begin_ns + edge_ns, end_ns - edge_ns


def _beside(press: Press, t_ns: NDArray[np.int64]) -> Vector:
    """Return the mean of the reference about each time [N], shape (times, 3); NaN where no sample was."""
    first = np.searchsorted(press.sample_ns, t_ns - _BESIDE_NS)
    last = np.searchsorted(press.sample_ns, t_ns + _BESIDE_NS)
    total_n = np.vstack([np.zeros(3), np.cumsum(press.force_n, axis=0)])
    n = (last - first)[:, None]
    return np.where(n > 0, (total_n[last] - total_n[first]) / np.maximum(n, 1), np.nan)


def _sample_period_ns(press: Press) -> float:
    """Return the time between two samples of the reference [ns]; a second where there are not two."""
    if len(press.sample_ns) < 2:
        return float(_NS_PER_S)
    return max(float(np.median(np.diff(press.sample_ns))), 1.0)


def _rest(press: Press, span_ns: tuple[int, int]) -> _Rest:
    rested = _within(press.t_ns, span_ns)
    scans = press.capacitance_pf[rested]
    samples = press.force_n[_within(press.sample_ns, span_ns) & ~press.saturated]
    n = len(samples)
    nothing = np.full(3, np.nan)
    return _Rest(
        t_ns=float(press.t_ns[rested].mean()) if rested.any() else sum(span_ns) / 2,
        capacitance_pf=_mean(scans),
        noise_pf=np.sqrt(_mean((scans - _mean(scans)) ** 2)),
        force_n=samples.mean(axis=0) if n else nothing,
        noise_n=samples.std(axis=0) if n else nothing,
        n_samples=n,
    )


def _refused(press: Press, why: Rejection, words: str) -> CalibrationLoad:
    samples = _within(press.sample_ns, press.pressed_ns)
    nothing, none_pf = np.full(3, np.nan), np.full(ELEMENTS, np.nan)
    return CalibrationLoad(
        t_ns=sum(press.pressed_ns) // 2,
        dwell_s=0.0,
        force_n=nothing,
        force_noise_n=nothing,
        capacitance_pf=none_pf,
        rest_pf=none_pf,
        shift_pf=none_pf,
        estimate_n=nothing,
        n_samples=int(samples.sum()),
        n_scans=int(_within(press.t_ns, press.pressed_ns).sum()),
        saturated=bool(press.saturated[samples].any()),
        rejection=why,
        words=words,
    )


def _seconds(span_ns: tuple[int, int]) -> float:
    return (span_ns[1] - span_ns[0]) / _NS_PER_S


def _within(t_ns: NDArray[np.int64], span_ns: tuple[int, int]) -> NDArray[np.bool_]:
    inside: NDArray[np.bool_] = (t_ns >= span_ns[0]) & (t_ns <= span_ns[1])
    return inside


def _mean(values: Vector) -> Vector:
    """Return the mean of each column over the rows that have it, NaN where none has."""
    there = ~np.isnan(values)
    n = there.sum(axis=0)
    total = np.where(there, values, 0.0).sum(axis=0)
    return np.where(n > 0, total / np.maximum(n, 1), np.nan)


def _elements(which: NDArray[np.bool_]) -> str:
    return ", ".join(str(element) for element in np.flatnonzero(which))
