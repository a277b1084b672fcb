"""Comparison of recomputed forces with recorded ones."""

from collections.abc import Mapping, Sequence
from operator import attrgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from footsense.frames import ContactFrame, Mask
from footsense.ring.cycle_fields import CYCLE_FIELDS, GAIT_FIELDS, CycleField

#: Largest difference of a force computed on another processor or with other library versions [N].
TOLERANCE_N = 1e-3

#: Largest difference of a baseline offset then [pF]: half a code of the converter.
BASELINE_TOLERANCE_PF = 1e-6

#: Largest difference of a ratio, a component of a normal or a sigma of the gait then, and of a time [ns].
TOLERANCE_REL, TOLERANCE_NS = 1e-2, 1_000_000

_FORCE_FIELDS = {path: field for path, field in CYCLE_FIELDS.items() if path.startswith("forces.")}


def same_processor_and_libraries(header: Mapping[str, str], here: Mapping[str, str]) -> bool:
    """Return whether a recording was made with this processor and these library versions."""
    return all(header.get(key) == value for key, value in here.items())


def first_difference(
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
    both, gaits = (recorded, recomputed), (recorded.gait, recomputed.gait)
    for row, leg in enumerate(legs):
        difference = _leg_difference(both, row, _FORCE_FIELDS, exact=exact)
        if None not in gaits:
            difference = difference or _leg_difference(gaits, row, GAIT_FIELDS, exact=exact)
        if difference:
            t_s = recorded.t_sent_ns * 1e-9
            return f"cycle {recorded.sequence}, sent at {t_s:.3f} s, leg {leg}: {difference}"
    then, now = gaits
    if then is None or now is None:  # as in most cycles
        if then is now:
            return None
        return f"cycle {recorded.sequence}: had {'a gait, has none' if then else 'no gait, has one'} now"
    if [event[:2] for event in then.events] != [event[:2] for event in now.events]:
        return f"cycle {recorded.sequence}: the gait events were {then.events}, are now {now.events}"
    return None


def _leg_difference(
    frames: tuple[object, object], row: int, fields: Mapping[str, CycleField], *, exact: bool
) -> str | None:
    """Return the first difference of a leg in two frames: the field's key and both values."""
    for path, field in fields.items():
        values = attrgetter(path.partition(".")[2])
        then, now = (np.atleast_1d(values(frame)[row]) for frame in frames)
        same = _is_close(then, now, 0.0 if exact else _field_tolerance(path, field))
        for k in np.flatnonzero(~same).tolist():
            words = [
                str(value) if field.code_enum is None else field.code_enum(value).name
                for value in (then[k], now[k])
            ]
            return f"{field.json_keys[k]} was {words[0]}, is now {words[1]}"
    return None


def _field_tolerance(path: str, field: CycleField) -> float:
    """Return the largest difference of a field on another machine."""
    if path.startswith("gait."):
        return {"<f8": TOLERANCE_REL, "<i8": TOLERANCE_NS}.get(field.dtype, 0.0)
    if field.dtype != "<f8":
        return 0.0
    return BASELINE_TOLERANCE_PF if field.json_keys[0].endswith("_pf") else TOLERANCE_N


def _is_close(then: NDArray[Any], now: NDArray[Any], tolerance: float) -> Mask:
    """Return which values are equal, or as near as the tolerance; NaN equals NaN."""
    if tolerance:
        return np.asarray(np.isclose(then, now, rtol=0.0, atol=tolerance, equal_nan=True), np.bool_)
    if then.dtype.kind != "f":
        return np.asarray(then == now)
    same_bits = then.view(np.uint64) == now.view(np.uint64)
    return np.asarray(same_bits | (np.isnan(then) & np.isnan(now)))
