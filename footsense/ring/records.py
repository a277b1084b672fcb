"""What the ring's records are made of: numbered cycles, gaps between them, and the status of the service.

A record is one msgpack array: a cycle, or the values of the service that change slowly. The arrays of a cycle's frames
stand in one binary field, the wide entries first so that all are aligned, and encoding is copying.
"""

from collections.abc import Mapping
from typing import NamedTuple

import msgspec
import numpy as np

from footsense.frames import ALL_LEGS, ELEMENTS, CanStatistics, Cycle, Vector
from footsense.ring.cycle_fields import CYCLE_FIELDS, GAIT_FIELDS, CycleField, NonNegativeInt64


class NumberedCycle(NamedTuple):
    """One cycle with its number in the run or recording.

    Attributes:
        cycle_number: Number of the cycle since the beginning, lost ones counted.
        cycle: The cycle.
    """

    cycle_number: int
    cycle: Cycle


class LostCycles(NamedTuple):
    """Number of cycles lost in a row because their reader was too slow, with the place and time of the loss.

    Attributes:
        next_cycle_number: Number of the next cycle that was read.
        next_t_sent_ns: Time of sending of that cycle [ns].
        n_cycles: Number of lost cycles before it.
    """

    next_cycle_number: int
    next_t_sent_ns: int
    n_cycles: int


class ServiceStatus(msgspec.Struct, array_like=True, tag="status", frozen=True):
    """Values of the service that change slowly, written ten times a second.

    Attributes:
        can: Counts of the CAN channel.
        baseline: Unloaded reading of each element, without stray [pF], float64, legs x elements, NaN where unknown.
        wakeup_histogram: Wake-ups of all threads by latency, as `WakeupLatency.histogram`; None in virtual time.
        n_overruns: Deadlines that had passed before a thread could sleep.
        n_late_discards: Conversions given up because a wake-up came too late.
        n_lost_log_lines: Lines that the log has dropped.
        n_lost_cycles: Cycles missing in the recording.
    """

    can: CanStatistics
    baseline: bytes
    wakeup_histogram: list[float] | None = None
    n_overruns: NonNegativeInt64 = 0
    n_late_discards: NonNegativeInt64 = 0
    n_lost_log_lines: NonNegativeInt64 = 0
    n_lost_cycles: NonNegativeInt64 = 0

    @property
    def baseline_pf(self) -> Vector:
        """Unloaded reading of each element, without stray [pF], shape (legs, elements), NaN where unknown."""
        return np.frombuffer(self.baseline, "<f8").reshape(-1, ELEMENTS)


def _wide_entries_first(fields: Mapping[str, CycleField]) -> list[str]:
    return sorted(fields, key=lambda path: np.dtype(fields[path].dtype).itemsize, reverse=True)


#: Paths of the arrays in their order.
CYCLE_ARRAY_ORDER, GAIT_ARRAY_ORDER = _wide_entries_first(CYCLE_FIELDS), _wide_entries_first(GAIT_FIELDS)


def legs_in_header(header: Mapping[str, str]) -> tuple[str, ...]:
    """Return the names of the legs in the header of a ring or recording.

    Raises:
        ValueError: They are not some of a robot's.
    """
    text = header.get("legs", "")
    legs = tuple(text.split(","))
    if len(set(legs)) < len(legs) or not set(legs) <= set(ALL_LEGS):
        raise ValueError(f"the recording names its legs {text[:40]!r}, not some of {', '.join(ALL_LEGS)}")
    return legs


def require_valid(holds: bool, error_text: str) -> None:  # noqa: FBT001 - reads like the sentence it checks
    """Raise an error with the message `error_text` unless a condition on a record's field holds.

    Raises:
        ValueError: It does not hold.
    """
    if not holds:
        raise ValueError(error_text)
