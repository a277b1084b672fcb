"""What acts when, asked at every step of a simulation in which it changes once in minutes."""

import math
from bisect import bisect_right
from collections.abc import Iterable
from typing import Generic, TypeVar

from footsense.sim.faults.scene_faults import Span

_T = TypeVar("_T")


class Schedule(Generic[_T]):
    """Things with the span of time in which each acts; the answer is kept until the next of them begins or ends.

    Args:
        entries: Span [ns] and thing.
    """

    def __init__(self, entries: Iterable[tuple[Span, _T]]) -> None:
        self._entries = tuple(entries)
        self._edges_ns = sorted({edge_ns for span_ns, _ in self._entries for edge_ns in span_ns})
        self._acting: tuple[_T, ...] = ()
        self._since_ns, self._until_ns = math.inf, -math.inf  # no answer yet

    def at(self, t_ns: float) -> tuple[_T, ...]:
        """Return what acts at a time, in the order of the entries."""
        if not self._since_ns <= t_ns < self._until_ns:
            place = bisect_right(self._edges_ns, t_ns)
            self._since_ns = self._edges_ns[place - 1] if place else -math.inf
            self._until_ns = self._edges_ns[place] if place < len(self._edges_ns) else math.inf
            self._acting = tuple(
                what for (from_ns, until_ns), what in self._entries if from_ns <= t_ns < until_ns
            )
        return self._acting
