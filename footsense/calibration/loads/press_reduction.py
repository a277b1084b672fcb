"""Reduce one press to a calibration load: check for rejection, and average over the dwell."""

from collections.abc import Iterator

import numpy as np

from footsense.calibration.loads import dwell
from footsense.calibration.loads.calibration_load import CalibrationLoad, Press, RejectedPress, Rejection
from footsense.calibration.loads.reference_lag import reference_lag_s
from footsense.calibration.loads.span_means import column_means, is_in_span
from footsense.frames import Mask, Reading

#: Smallest force of a load [N]: a sensor for 80 N resolves 0.12 N, averaged over a dwell a tenth of that.
_MIN_FORCE_N = 0.1
#: Least share of the expected samples and scans.
_MIN_ANSWERED_SCANS_REL = 0.9


def reduce_press(press: Press) -> CalibrationLoad | RejectedPress:
    """Return the calibration load of a press, or the reason for its rejection."""
    before = dwell.average_unloaded_span(press, press.unloaded_before_ns)
    dwell_ns = dwell.longest_dwell(press, before)
    return next(_rejection_reasons(press, before, dwell_ns), None) or _mean_load(press, dwell_ns, before)


def _rejection_reasons(
    press: Press, before: dwell.UnloadedSpan, dwell_ns: tuple[int, int]
) -> Iterator[RejectedPress]:
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
    dwell_s, pressed_s = _duration_s(dwell_ns), _duration_s(press.pressed_span_ns)
    dwelt = dwell_s >= dwell.MIN_DWELL_S
    samples = is_in_span(press.reference.t_ns, dwell_ns if dwelt else press.pressed_span_ns)
    if press.reference.saturated[samples].any():
        largest_n = np.abs(press.reference.force_n[samples]).max()
        yield RejectedPress(
            Rejection.REFERENCE_SATURATED, f"an axis is at the end of its range, {largest_n:.1f} N"
        )
    expected = round((dwell_s if dwelt else pressed_s) * 1e9 / dwell.sample_period_ns(press.reference))
    if samples.sum() < _MIN_ANSWERED_SCANS_REL * expected:
        yield RejectedPress(
            Rejection.REFERENCE_MISSING, f"{samples.sum()} of about {expected} samples are there"
        )
    if not dwelt:
        reason = (
            f"still for {dwell_s:.2f} s of {pressed_s:.2f} s, at least {dwell.MIN_DWELL_S:g} s are needed"
        )
        rejection = Rejection.TOO_SHORT if pressed_s < 2 * dwell.MIN_DWELL_S else Rejection.SLIPPED
        yield RejectedPress(rejection, reason)


def _mean_load(
    press: Press, dwell_ns: tuple[int, int], before: dwell.UnloadedSpan
) -> CalibrationLoad | RejectedPress:
    """Return the means over the dwell relative to the unloaded spans before and after it, or a rejection."""
    scans, samples = is_in_span(press.t_ns, dwell_ns), is_in_span(press.reference.t_ns, dwell_ns)
    baseline_pf, offsets_n = before.capacitance_pf, press.reference_offset_samples_n
    after = (
        None
        if press.unloaded_after_ns is None
        else dwell.average_unloaded_span(press, press.unloaded_after_ns)
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
        reference_lag_s=reference_lag_s(press, dwell_ns, baseline_pf, reference_offset_n, force_n),
    )


def _duration_s(span_ns: tuple[int, int]) -> float:
    """Return the duration of a time span [s]."""
    return (span_ns[1] - span_ns[0]) / 1e9


def _element_list_text(which: Mask) -> str:
    """Return the numbers of the selected elements as text."""
    return ", ".join(map(str, np.flatnonzero(which)))
