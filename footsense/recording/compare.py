"""Comparison of recomputed cycles with recorded ones, message by message, in the words of the recording."""

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


def differing_entries(header: Mapping[str, str], here: Mapping[str, str]) -> list[str]:
    """Return the names of what was another when a recording was made: processor, libraries, or not told."""
    return [name for name, value in here.items() if header.get(name) != value]


class Comparison:
    """Count of recomputed cycles that equal the recorded ones, bit for bit or within what processors differ by.

    Args:
        legs: Name of each row of the frames.
        exact: Whether a value that differs by its last bit is a difference.

    Attributes:
        n_cycles: Cycles without a difference.
        n_bitwise: Those of them with the same bits in every value.
        largest: Largest difference of each field whose bits differ, in the field's unit, by its name.
    """

    def __init__(self, legs: Sequence[str], *, exact: bool = False) -> None:
        self._legs = legs
        self._exact = exact
        self.n_cycles = self.n_bitwise = 0
        self.largest: dict[str, float] = {}

    def add(self, recorded: Cycle, recomputed: Cycle) -> str | None:
        """Compare forces and gaits of a cycle with those computed from the same readings now (NaN equals NaN).

        Forces may differ by 1 mN, unless they have to be exact; codes and times of measurement have to be equal.

        Returns:
            The cycle, leg, field and both values of the first difference; None if there is none.
        """
        at = f"cycle {recorded.forces.sequence}, sent at {recorded.forces.t_sent_ns * 1e-9:.3f} s"
        is_bitwise = True
        for topic, name in _COMPARED.items():
            then, now = (
                tuple(messages.ENCODERS[topic](cycle, self._legs)) for cycle in (recorded, recomputed)
            )
            if len(then) != len(now):
                return f"{at}: had {len(then)} {name}, has {len(now)} now"
            for (_, before), (_, after) in zip(then, now, strict=True):
                if before == after:
                    continue
                values = _values(json.loads(after))
                for (leg, key), was in _values(json.loads(before)).items():
                    is_now = values[leg, key]
                    if repr(was) == repr(is_now):  # bit for bit, for floats too
                        continue
                    tolerance = 0.0 if self._exact else _tolerance(topic, key, was)
                    if not _is_close(was, is_now, tolerance):
                        where = f", leg {leg}: {key}" if leg else f": {key}"
                        return f"{at}{where} was {was}, is now {is_now}"
                    self.largest[key] = max(self.largest.get(key, 0.0), float(abs(was - is_now)))
                    is_bitwise = False
        self.n_cycles += 1
        self.n_bitwise += is_bitwise
        return None

    def summary(self) -> str:
        """Return the counts, and the largest difference of each field, as a line."""
        if self.n_bitwise == self.n_cycles:
            return f"{self.n_cycles} cycles equal bit for bit"
        largest = ", ".join(f"{key} {difference:.0e}" for key, difference in sorted(self.largest.items()))
        return f"{self.n_cycles} cycles equal to 1 mN, {self.n_bitwise} bit for bit; largest differences: {largest}"


def _values(message: Mapping[str, Any]) -> dict[tuple[str, str], Any]:
    """Return the values of a message by leg and key; those of no leg have an empty name there."""
    values = {("", key): value for key, value in message.items() if not isinstance(value, dict)}
    for leg, row in message.items():
        if isinstance(row, dict):
            values |= {(leg, key): value for key, value in row.items()}
    return values


def _tolerance(topic: str, key: str, value: object) -> float:
    """Return the largest difference of a value on another machine; codes, and times of measured forces, are equal."""
    if topic == messages.FORCE and not isinstance(value, float):
        return 0.0
    suffix = next((suffix for suffix in _TOLERANCES if key.endswith(suffix)), "")
    return _TOLERANCES[suffix] if suffix else _GAIT_TOLERANCE if isinstance(value, float) else 0.0


def _is_close(was: Any, now: Any, tolerance: float) -> bool:  # noqa: ANN401 - values of JSON
    return bool(tolerance) and None not in (was, now) and abs(was - now) <= tolerance
