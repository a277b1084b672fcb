"""Comparison of recomputed forces with recorded ones."""

from collections.abc import Iterator, Mapping, Sequence
from enum import IntEnum
from operator import attrgetter

import numpy as np

from footsense.frames import BaselineStatus, Cause, ContactFrame, Mask, State, Vector
from footsense.recording.messages import NOT_RECORDED

#: Largest difference of a force computed on another processor or with other library versions [N].
TOLERANCE_N = 1e-3

#: Largest difference of a baseline offset then [pF]: half a code of the converter.
TOLERANCE_PF = 1e-6

#: Entries of the header that have to be equal for bits to be equal.
MACHINE_KEYS = ("processor", "python", "numpy", "onnxruntime")


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
    def found(field: str, name: str, codes: type[IntEnum] | None = None) -> Iterator[str]:
        then, now = (int(attrgetter(field)(frame)[row]) for frame in (recorded, recomputed))
        if then != now:
            words = (then, now) if codes is None else (codes(then).name, codes(now).name)
            yield f"{name} was {words[0]}, is now {words[1]}"

    def moved(field: str, names: Sequence[str], tolerance: float) -> Iterator[str]:
        then, now = (np.atleast_1d(attrgetter(field)(frame)[row]) for frame in (recorded, recomputed))
        for k in np.flatnonzero(~_equal(then, now, None if exact else tolerance)).tolist():
            yield f"{names[k]} was {then[k]!s}, is now {now[k]!s}"

    def differences() -> Iterator[str]:
        yield from found("state", "state", State)
        for field in ("t_ns", "fault_mask", "flags"):
            yield from found(field, field)
        yield from moved("force_n", ("fx_n", "fy_n", "fz_n"), TOLERANCE_N)
        yield from moved("sigma_n", ("sigma_x_n", "sigma_y_n", "sigma_z_n"), TOLERANCE_N)
        if recorded.cause[row] != NOT_RECORDED:
            yield from found("cause", "cause", Cause)
            yield from found("baseline.status", "baseline_status", BaselineStatus)
            yield from found("baseline.moved_ns", "baseline_moved_ns")
            yield from moved("baseline.mean_pf", ("baseline_mean_pf",), TOLERANCE_PF)
            yield from moved("baseline.worst_pf", ("baseline_worst_pf",), TOLERANCE_PF)

    return next(differences(), None)


def _equal(a: Vector, b: Vector, tolerance: float | None) -> Mask:
    if tolerance is not None:
        return np.isclose(a, b, rtol=0.0, atol=tolerance, equal_nan=True)
    same_bits = a.view(np.uint64) == b.view(np.uint64)
    return np.asarray(same_bits | (np.isnan(a) & np.isnan(b)))
