"""Lookup of the entries that are active at a time, cached until the next one starts or ends."""

import math
from bisect import bisect_right
from collections.abc import Iterable
from typing import Generic, TypeVar

_T = TypeVar("_T")

#: Start and end [ns].
Span = tuple[float, float]


def in_any_span(spans: list[Span], t_ns: float) -> bool:
    """Return whether a time [ns] lies in one of the spans (start included, end excluded)."""
    for from_ns, until_ns in spans:  # noqa: SIM110 - `any` costs three times as much, and every transaction asks
        if from_ns <= t_ns < until_ns:
            return True
    return False


class Schedule(Generic[_T]):
    """Values, each active in a span of time; the lookup is cached until the next start or end.

    Args:
        entries: Span [ns] and value.

    Attributes:
        until_ns: Time up to which the last answer holds [ns].
    """

    def __init__(self, entries: Iterable[tuple[Span, _T]]) -> None:
        self._entries = tuple(entries)
        self._edges_ns = sorted({edge_ns for span_ns, _ in self._entries for edge_ns in span_ns})
        self._acting: tuple[_T, ...] = ()
        self._since_ns, self.until_ns = math.inf, -math.inf  # no answer yet

    def at(self, t_ns: float) -> tuple[_T, ...]:
        """Return the values that are active at a time [ns], in the order of the entries."""
        if not self._since_ns <= t_ns < self.until_ns:
            passed = bisect_right(self._edges_ns, t_ns)
            self._since_ns, self.until_ns = [-math.inf, *self._edges_ns, math.inf][passed : passed + 2]
            self._acting = tuple(
                value for (from_ns, until_ns), value in self._entries if from_ns <= t_ns < until_ns
            )
        return self._acting
