"""Base class of the decoders of a force sensor's byte stream.

Each resynchronises: what is not a record is skipped and counted, and the next record is read.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from footsense.frames import Mask, Stamps, Vector
from footsense.reference.record_columns import NS_PER_TIME_COLUMN_UNIT, max_plausible_magnitude


class SensorRecords(NamedTuple):
    """Decoded records of a force sensor: times, sequence numbers, raw values; oldest first.

    Attributes:
        t_sensor_ns: Time of each by the sensor's clock [ns], shape (n,), int64; None if it sends none.
        sequence: Sequence numbers, shape (n,), int64; None if it sends none.
        raw_forces: Forces as sent, shape (n, 3).
        saturated: Whether the sensor flags them as saturated, shape (n,).
    """

    t_sensor_ns: Stamps | None
    sequence: Stamps | None
    raw_forces: Vector
    saturated: Mask


class RecordDecoder(ABC):
    """Base class of the decoders: assigns columns, unwraps counters, counts bad records.

    Args:
        names: Column of each value, of `COLUMNS` or "-".
        wraps: Modulus of each value that is an integer counter, else None.

    Attributes:
        n_bad: Lines or runs of bytes that were no record.
        last_bad: The last of them.
    """

    def __init__(self, names: Sequence[str], wraps: Sequence[int | None]) -> None:
        self._n_columns = len(names)
        self._forces = [names.index(axis) for axis in ("fx", "fy", "fz")]
        self._time = next(
            ((names.index(name), unit) for name, unit in NS_PER_TIME_COLUMN_UNIT.items() if name in names),
            None,
        )
        self._sequence = names.index("sequence") if "sequence" in names else None
        self._saturated = names.index("saturated") if "saturated" in names else None
        self._limits = {
            index: max_plausible_magnitude(name) for index, name in enumerate(names) if name != "-"
        }
        self._wraps = wraps
        self._unwrapped: dict[int, int] = {}
        self._synchronised = False
        self.n_bad = 0
        self.last_bad = b""

    def feed(self, data: bytes) -> SensorRecords:
        """Return the records that these bytes complete."""
        values = np.array(self._parse_bytes(data), dtype=np.float64).reshape(-1, self._n_columns)
        t_ns = sequence = None
        if self._time is not None:
            index, unit_ns = self._time
            t_ns = np.rint(self._unwrap(values[:, index], index) * unit_ns).astype(np.int64)
        if self._sequence is not None:
            sequence = self._unwrap(values[:, self._sequence], self._sequence).astype(np.int64)
        none = np.zeros(len(values), np.bool_)
        saturated = none if self._saturated is None else values[:, self._saturated] != 0
        return SensorRecords(t_ns, sequence, values[:, self._forces], saturated)

    def reset(self) -> None:
        """Discard an incomplete record, after the port was reopened."""
        self._synchronised = False

    @abstractmethod
    def _parse_bytes(self, data: bytes) -> list[list[float]]:
        """Return the values of the records that these bytes complete."""

    def _plausible_or_none(self, record: list[float]) -> list[float] | None:
        """Return the record; None if a value is NaN or impossible for a sensor."""
        return record if all(abs(record[index]) <= limit for index, limit in self._limits.items()) else None

    def _count_bad_record(self, data: bytes) -> None:
        """Count a bad record, and store its first bytes as an example for error messages."""
        self.n_bad += 1
        self.last_bad = data[:60]

    def _unwrap(self, counts: Vector, index: int) -> Vector:
        """Return counter values unwrapped; a small decrease stays a decrease."""
        wrap = self._wraps[index]
        if wrap is None or not len(counts):
            return counts
        unwrapped = []
        for count in counts.astype(np.int64).tolist():
            last = self._unwrapped.get(index, count)
            step = (count - last) % wrap
            self._unwrapped[index] = last + (step if step < wrap // 2 else step - wrap)
            unwrapped.append(self._unwrapped[index])
        return np.array(unwrapped, np.float64)
