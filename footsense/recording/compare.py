"""Comparison of recomputed forces with recorded ones."""

from collections.abc import Mapping, Sequence
from operator import attrgetter

import numpy as np

from footsense.frames import ContactFrame, GaitFrame, Mask, Vector
from footsense.recording.cycle_fields import FIELDS, GAIT_FIELDS, NOT_RECORDED

#: Largest difference of a force computed on another processor or with other library versions [N].
TOLERANCE_N = 1e-3

#: Largest difference of a baseline offset then [pF]: half a code of the converter.
TOLERANCE_PF = 1e-6

#: Largest difference of a ratio, a component of a normal or a sigma of the gait then, and of a time [ns].
TOLERANCE_REL, TOLERANCE_NS = 1e-2, 1_000_000

#: Compared fields of the forces in their order; the later ones are not in recordings from before causes.
_FIRST_FIELDS = ("state", "t_ns", "fault_mask", "flags", "force_n", "sigma_n")
_LATER_FIELDS = ("cause", "baseline.status", "baseline.moved_ns", "baseline.mean_pf", "baseline.worst_pf")


def same_machine(header: Mapping[str, str], here: Mapping[str, str]) -> bool:
    """Return whether a recording was made with this processor and these library versions."""
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
    if recorded.gait is None:  # as in most cycles, and in recordings from before it
        return None
    difference = _gait_difference(recorded.gait, recomputed.gait, legs, exact=exact)
    return None if difference is None else f"cycle {recorded.sequence}: {difference}"


def _gait_difference(
    then: GaitFrame, now: GaitFrame | None, legs: Sequence[str], *, exact: bool
) -> str | None:
    """Return the first difference of two gaits."""
    if now is None:
        return "a gait was told, and is not now"
    for path, field in GAIT_FIELDS.items():
        name = path.partition(".")[2]
        before, after = (np.atleast_1d(getattr(gait, name)) for gait in (then, now))
        if field.kind == "<f8":
            same = _equal(before, after, None if exact else TOLERANCE_REL)
        else:
            same = (
                np.abs(after - before) <= TOLERANCE_NS
                if not exact and field.kind == "<i8"
                else before == after
            )
        for place in np.argwhere(~same).tolist():
            values = before[tuple(place)], after[tuple(place)]
            return f"leg {legs[place[0]]}: {name} was {values[0]}, is now {values[1]}"
    if [event[:2] for event in then.events] != [event[:2] for event in now.events]:
        return f"the gait events were {then.events}, are now {now.events}"
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
