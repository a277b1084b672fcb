"""Comparison of recomputed forces with recorded ones."""

from collections.abc import Mapping, Sequence

import numpy as np

from footsense.frames import BaselineDrift, BaselineStatus, Cause, ContactFrame, Mask, State, Vector
from footsense.recording.messages import NOT_RECORDED

__all__ = ["TOLERANCE_N", "compare", "same_machine"]

#: Largest difference of a force computed on another processor or with other library versions [N].
TOLERANCE_N = 1e-3

#: Largest difference of a baseline offset then [pF]: half a code of the converter.
TOLERANCE_PF = 1e-6

#: Entries of the header that have to be equal for bits to be equal.
MACHINE_KEYS = ("processor", "python", "numpy", "onnxruntime")

_AXES = "xyz"


def same_machine(header: Mapping[str, str], here: Mapping[str, str]) -> bool:
    """Return whether a recording was made by this processor and these library versions."""
    return all(key in header and header[key] == here.get(key) for key in MACHINE_KEYS)


def compare(
    recorded: ContactFrame, recomputed: ContactFrame, *, exact: bool, legs: Sequence[str]
) -> str | None:
    """Return a message about the first difference between two frames.

    Args:
        recorded: The published frame.
        recomputed: The frame computed from the same scan now.
        exact: Whether forces and sigmas have to be equal bit for bit (NaN equals NaN), else to 1 mN.
        legs: Name of each row.

    Returns:
        The scan, leg, field and both values; None if there is no difference.
    """
    for field in ("sequence", "t_sent_ns"):
        then, now = getattr(recorded, field), getattr(recomputed, field)
        if then != now:
            return f"scan {recorded.sequence}: {field} was {then}, is now {now}"
    for row, leg in enumerate(legs):
        difference = _leg_difference(recorded, recomputed, row, exact=exact)
        if difference:
            t_s = recorded.t_sent_ns * 1e-9
            return f"scan {recorded.sequence}, sent at {t_s:.3f} s, leg {leg}: {difference}"
    return None


def _leg_difference(recorded: ContactFrame, recomputed: ContactFrame, row: int, *, exact: bool) -> str | None:
    then, now = int(recorded.state[row]), int(recomputed.state[row])
    if then != now:
        return f"state was {State(then).name}, is now {State(now).name}"
    for field in ("t_ns", "fault_mask", "flags"):
        then, now = int(getattr(recorded, field)[row]), int(getattr(recomputed, field)[row])
        if then != now:
            return f"{field} was {then}, is now {now}"
    for field, name in (("force_n", "f"), ("sigma_n", "sigma_")):
        a, b = getattr(recorded, field)[row], getattr(recomputed, field)[row]
        differs = ~_equal(a, b, None if exact else TOLERANCE_N)
        if differs.any():
            k = int(differs.argmax())
            return f"{name}{_AXES[k]}_n was {a[k]!s}, is now {b[k]!s}"
    if recorded.cause[row] == NOT_RECORDED:
        return None
    then, now = int(recorded.cause[row]), int(recomputed.cause[row])
    if then != now:
        return f"cause was {Cause(then).name}, is now {Cause(now).name}"
    return _baseline_difference(recorded.baseline, recomputed.baseline, row, exact=exact)


def _baseline_difference(
    recorded: BaselineDrift, recomputed: BaselineDrift, row: int, *, exact: bool
) -> str | None:
    then, now = int(recorded.status[row]), int(recomputed.status[row])
    if then != now:
        return f"baseline_status was {BaselineStatus(then).name}, is now {BaselineStatus(now).name}"
    then, now = int(recorded.moved_ns[row]), int(recomputed.moved_ns[row])
    if then != now:
        return f"baseline_moved_ns was {then}, is now {now}"
    for field in ("mean_pf", "worst_pf"):
        a, b = getattr(recorded, field)[row], getattr(recomputed, field)[row]
        if not _equal(a, b, None if exact else TOLERANCE_PF).all():
            return f"baseline_{field} was {a!s}, is now {b!s}"
    return None


def _equal(a: Vector, b: Vector, tolerance: float | None) -> Mask:
    if tolerance is not None:
        return np.isclose(a, b, rtol=0.0, atol=tolerance, equal_nan=True)
    same_bits = np.atleast_1d(a).view(np.uint64) == np.atleast_1d(b).view(np.uint64)
    return np.asarray(same_bits | (np.isnan(a) & np.isnan(b)))
