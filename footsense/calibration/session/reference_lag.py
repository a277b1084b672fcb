"""How far a reference lags behind its foot: the force against the capacitances as a foot is pressed and let go.

Both go from rest to the hold and back. Of two such courses the area between tells by how much one is later, on the way
up with the other sign than on the way down; what is not linear between the two cancels.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from footsense.calibration.loads.press import Press

__all__ = ["lag_s", "lag_words"]

Vector = NDArray[np.float64]

#: How far rest and hold are looked at beside a move, and what there has to be of the rest after it [ns].
_BESIDE_NS, _LEAST_AFTER_NS = 200_000_000, 100_000_000
_STEP_NS = 1_000_000
#: From so much on it is said: a sensor that is described well lags by no scan, of which the slowest last 0.1 s.
_SAID_S = 0.06
#: So many presses have to say it.
_LEAST_PRESSES = 5


def lag_s(press: Press, dwell_ns: tuple[int, int], rest_pf: Vector, zero_n: Vector, force_n: Vector) -> float:
    """Return by how much the reference is later than the capacitances [s]; NaN if the press was not seen to its end.

    Args:
        press: The press.
        dwell_ns: From and until when it was held still [ns].
        rest_pf: What the elements read unloaded [pF], shape (9,).
        zero_n: What the reference says unloaded [N], shape (3,).
        force_n: The force in the hold [N], shape (3,), its zero taken off.
    """
    # Closures are nearly linear in the force; strays bend them a little.
    closed = (1.0 - rest_pf / press.capacitance_pf).mean(axis=1)
    read = np.isfinite(closed)
    holding = read & (press.t_ns >= dwell_ns[0]) & (press.t_ns <= dwell_ns[1])
    felt = (press.force_n - zero_n) @ force_n / (force_n @ force_n)
    ends_ns = min(press.t_ns[-1], press.sample_ns[-1])
    if not holding.any() or ends_ns < press.pressed_ns[1] + _LEAST_AFTER_NS:
        return np.nan
    inside_ns = min(_BESIDE_NS, (dwell_ns[1] - dwell_ns[0]) // 2)
    apart_ns = 0.0
    for begin_ns, end_ns, sign in (
        (press.before_ns[1] - _BESIDE_NS, dwell_ns[0] + inside_ns, 1),
        (dwell_ns[1] - inside_ns, ends_ns, -1),
    ):
        t_ns = np.arange(begin_ns, end_ns, _STEP_NS)
        moved = np.interp(t_ns, press.t_ns[read], closed[read] / closed[holding].mean())
        apart_ns += sign * _STEP_NS * float((moved - np.interp(t_ns, press.sample_ns, felt)).sum())
    return apart_ns / 2 * 1e-9


def lag_words(lags_s: Sequence[float]) -> str:
    """Return what to say of the lags of a session's presses [s]; nothing if they are none, or too few to tell."""
    known = [lag for lag in lags_s if np.isfinite(lag)]
    median_s = float(np.median(known)) if len(known) >= _LEAST_PRESSES else 0.0
    if abs(median_s) < _SAID_S:
        return ""
    side, size = ("behind", "small") if median_s > 0 else ("ahead of", "large")
    ms = f"{1e3 * abs(median_s):.0f} ms"
    return f"the reference is {ms} {side} the foot: latency_ms in the bench's file is too {size} by that"
