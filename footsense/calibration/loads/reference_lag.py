"""Time lag of the reference sensor behind the foot's capacitances, measured at the start and end of presses.

Both rise from unloaded to the dwell and fall back. The area between the two normalised curves is the delay, with
opposite signs on the way up and on the way down; what is not linear between force and capacitance cancels.
"""

from collections.abc import Sequence

import numpy as np

from footsense.calibration.loads.calibration_load import Press
from footsense.calibration.loads.span_means import is_in_span
from footsense.frames import Vector

#: Span of unloaded foot and of dwell used beside each edge, and the least of the unloaded span after it [ns].
_HALF_WINDOW_NS, _MIN_AFTER_NS = 200_000_000, 100_000_000
_RESAMPLING_STEP_NS = 1_000_000
#: Smallest lag that is reported [s]: less than one scan of the slowest board, 0.1 s.
_MIN_REPORTED_LAG_S = 0.06
_MIN_PRESSES = 5


def reference_lag_s(
    press: Press, dwell_ns: tuple[int, int], baseline_pf: Vector, reference_offset_n: Vector, force_n: Vector
) -> float:
    """Return the time lag of the reference sensor behind the foot [s]; NaN if the end of the press is missing.

    Args:
        press: The press.
        dwell_ns: Start and end of its dwell [ns].
        baseline_pf: Unloaded reading of each element [pF], shape (9,).
        reference_offset_n: Unloaded reading of the reference [N], shape (3,).
        force_n: Force in the dwell minus the offset [N], shape (3,).
    """
    # Closures are nearly linear in the force; strays bend the curve a little.
    closure = (1.0 - baseline_pf / press.capacitance_pf).mean(axis=1)
    read = np.isfinite(closure)
    dwelling = read & is_in_span(press.t_ns, dwell_ns)
    reference_rel = (press.reference.force_n - reference_offset_n) @ force_n / (force_n @ force_n)
    ends_ns = min(press.t_ns[-1], press.reference.t_ns[-1])
    if not dwelling.any() or ends_ns < press.pressed_span_ns[1] + _MIN_AFTER_NS:
        return np.nan
    inside_ns = min(_HALF_WINDOW_NS, (dwell_ns[1] - dwell_ns[0]) // 2)
    area_ns = 0.0
    for start_ns, end_ns, sign in (
        (press.unloaded_before_ns[1] - _HALF_WINDOW_NS, dwell_ns[0] + inside_ns, 1),
        (dwell_ns[1] - inside_ns, ends_ns, -1),
    ):
        t_ns = np.arange(start_ns, end_ns, _RESAMPLING_STEP_NS)
        closure_rel = np.interp(t_ns, press.t_ns[read], closure[read] / closure[dwelling].mean())
        ahead_rel = closure_rel - np.interp(t_ns, press.reference.t_ns, reference_rel)
        area_ns += sign * _RESAMPLING_STEP_NS * float(ahead_rel.sum())
    return area_ns / 2 * 1e-9


def lag_message(lags_s: Sequence[float]) -> str:
    """Return a warning about a session's median reference lag [s]; empty if small or from too few presses."""
    known = [lag for lag in lags_s if np.isfinite(lag)]
    median_s = float(np.median(known)) if len(known) >= _MIN_PRESSES else 0.0
    if abs(median_s) < _MIN_REPORTED_LAG_S:
        return ""
    side, size = ("behind", "small") if median_s > 0 else ("ahead of", "large")
    ms = f"{1e3 * abs(median_s):.0f} ms"
    return f"the reference is {ms} {side} the foot: latency_ms in the test stand's file is too {size} by that"
