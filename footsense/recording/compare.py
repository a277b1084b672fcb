"""Comparison of recomputed forces with recorded ones."""

from collections.abc import Mapping, Sequence
from operator import attrgetter

import numpy as np

from footsense.frames import ContactFrame, Mask, Vector
from footsense.recording.cycle_fields import FIELDS, NOT_RECORDED

#: Largest difference of a force computed on another processor or with other library versions [N].
TOLERANCE_N = 1e-3

#: Largest difference of a baseline offset then [pF]: half a code of the converter.
TOLERANCE_PF = 1e-6

#: Compared fields of the forces in their order; the later ones are not in recordings from before causes.
_FIRST_FIELDS = ("state", "t_ns", "fault_mask", "flags", "force_n", "sigma_n")
_LATER_FIELDS = ("cause", "baseline.status", "baseline.moved_ns", "baseline.mean_pf", "baseline.worst_pf")


def same_machine(header: Mapping[str, str], here: Mapping[str, str]) -> bool:
    """Return whether a recording's header names this processor and these library versions, as bits depend on them."""
    return all(header.get(key) == value for key, value in here.items())


def compare(
    recorded: ContactFrame, recomputed: ContactFrame, *, exact: bool, legs: Sequence[str]
) -> str | None:
    """Return a message about the first difference between two frames.

    Args:
        recorded: The published frame.
        recomputed: The frame computed from the same readings now.
        exact: Whether forces and sigmas have to be equal bit for bit (NaN equals NaN), else to 1 mN.
        legs: Name of each row.

    Returns:
        The cycle, leg, field and both values; None if there is no difference.
    """
    for field in ("sequence", "t_sent_ns"):
        then, now = getattr(recorded, field), getattr(recomputed, field)
        if then != now:
            return f"cycle {recorded.sequence}: {field} was {then}, is now {now}"
    for row, leg in enumerate(legs):
        difference = _leg_difference(recorded, recomputed, row, exact=exact)
        if difference:
            t_s = recorded.t_sent_ns * 1e-9
            return f"cycle {recorded.sequence}, sent at {t_s:.3f} s, leg {leg}: {difference}"
    return None


def _leg_difference(recorded: ContactFrame, recomputed: ContactFrame, row: int, *, exact: bool) -> str | None:
    """Return the first difference of a leg: the field's key and both values."""
    is_old = recorded.cause[row] == NOT_RECORDED
    for name in _FIRST_FIELDS if is_old else (*_FIRST_FIELDS, *_LATER_FIELDS):
        field = FIELDS[f"forces.{name}"]
        then, now = (np.atleast_1d(attrgetter(name)(frame)[row]) for frame in (recorded, recomputed))
        tolerance = TOLERANCE_PF if field.keys[0].endswith("_pf") else TOLERANCE_N
        same = then == now if field.kind != "<f8" else _equal(then, now, None if exact else tolerance)
        for k in np.flatnonzero(~same).tolist():
            words = [
                str(value) if field.names is None else field.names(value).name for value in (then[k], now[k])
            ]
            return f"{field.keys[k]} was {words[0]}, is now {words[1]}"
    return None


def _equal(a: Vector, b: Vector, tolerance: float | None) -> Mask:
    if tolerance is not None:
        return np.isclose(a, b, rtol=0.0, atol=tolerance, equal_nan=True)
    same_bits = a.view(np.uint64) == b.view(np.uint64)
    return np.asarray(same_bits | (np.isnan(a) & np.isnan(b)))
