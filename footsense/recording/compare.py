"""Comparison of a recomputed cycle with the recorded one, message by message, in the words of the recording."""

import json
from collections.abc import Mapping, Sequence
from typing import Any

from footsense.frames import Cycle
from footsense.recording import messages

#: Largest difference of a value computed on another processor or with other library versions, by the unit that its key
#: ends in: a force, a baseline's offset (half a code of the converter), a time of the gait; and any other float.
_TOLERANCES = {"_n": 1e-3, "_pf": 1e-6, "_ns": 1e6}
_GAIT_TOLERANCE = 1e-2
_COMPARED = {messages.FORCE: "forces", messages.GAIT: "gaits", messages.GAIT_EVENT: "gait events"}


def same_processor_and_libraries(header: Mapping[str, str], here: Mapping[str, str]) -> bool:
    """Return whether a recording was made with this processor and these library versions."""
    return all(header.get(key) == value for key, value in here.items())


def first_difference(recorded: Cycle, recomputed: Cycle, *, exact: bool, legs: Sequence[str]) -> str | None:
    """Return a message about the first difference between the forces and gaits of two cycles.

    Args:
        recorded: The recorded cycle.
        recomputed: The cycle computed from the same readings now.
        exact: Whether all values have to be equal bit for bit (NaN equals NaN), else forces to 1 mN.
        legs: Name of each row.

    Returns:
        The cycle, leg, field and both values; None if there is no difference.
    """
    at = f"cycle {recorded.forces.sequence}, sent at {recorded.forces.t_sent_ns * 1e-9:.3f} s"
    for topic, name in _COMPARED.items():
        then, now = (tuple(messages.ENCODERS[topic](cycle, legs)) for cycle in (recorded, recomputed))
        if len(then) != len(now):
            return f"{at}: had {len(then)} {name}, has {len(now)} now"
        for (_, before), (_, after) in zip(then, now, strict=True):
            if before != after:
                values = _values(json.loads(after))
                for key, was in _values(json.loads(before)).items():
                    tolerance = 0.0 if exact else _tolerance(topic, key, was)
                    if not _is_close(was, values[key], tolerance):
                        return f"{at}{key} was {was}, is now {values[key]}"
    return None


def _values(message: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values of a message, those of its legs too, by what a difference is called."""
    values = {f": {key}": value for key, value in message.items() if not isinstance(value, dict)}
    for leg, row in message.items():
        if isinstance(row, dict):
            values |= {f", leg {leg}: {key}": value for key, value in row.items()}
    return values


def _tolerance(topic: str, key: str, value: object) -> float:
    """Return the largest difference of a value on another machine; codes, and times of measured forces, are equal."""
    if topic == messages.FORCE and not isinstance(value, float):
        return 0.0
    suffix = next((suffix for suffix in _TOLERANCES if key.endswith(suffix)), "")
    return _TOLERANCES[suffix] if suffix else _GAIT_TOLERANCE if isinstance(value, float) else 0.0


def _is_close(was: Any, now: Any, tolerance: float) -> bool:  # noqa: ANN401 - values of JSON
    if repr(was) == repr(now):  # bit for bit, for floats too
        return True
    return bool(tolerance) and None not in (was, now) and abs(was - now) <= tolerance
