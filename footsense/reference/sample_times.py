"""When a force sensor's samples were taken, in the daemon's clock, and how many of them are missing.

The loop looks for bytes once a scan, and finds some samples at once; which of them came just now, nobody says. So the
sensor's own time counts, mapped by the line under all ways (`footsense.clock_map`): the newest sample of some
scans has arrived just before the look. Where the sensor sends no time, its samples are numbered, and where it sends no
number, they are counted, and the count is put right when samples stay out.
"""

from collections import deque

import numpy as np
from numpy.typing import NDArray

from footsense.clock_map import ClockMap
from footsense.reference.record_decoder import Rows

__all__ = ["SampleTimes"]

_NS_PER_S = 1_000_000_000
#: So many looks in a row have to find the newest sample late before counted ones are taken to be missing.
_LATE_LOOKS = 8
#: As late as this share of a period: a sample that has just arrived is up to a period old, one of a miscount older.
_LATE_REL = 1.05


class SampleTimes:
    """Stamps the samples of one sensor.

    Args:
        rate_hz: Samples per second of the sensor's own clock.
        latency_ns: How old a sample is when the sensor sends it [ns].

    Attributes:
        n_missing: Samples that never came, as far as their times tell.
        n_jumps: How often the sensor's clock has jumped.
    """

    def __init__(self, rate_hz: float, latency_ns: int) -> None:
        self._period_ns = _NS_PER_S / rate_hz
        self._latency_ns = latency_ns
        self._map = ClockMap()
        self._count = 0
        self._late_ns: deque[int] = deque(maxlen=_LATE_LOOKS)
        self._last: tuple[int, int] | None = None  # the sensor's time of the last sample, and ours
        self._begins = False
        self._n_jumps_before = 0
        self.n_missing = 0

    @property
    def n_jumps(self) -> int:
        """Return how often the sensor's clock has jumped."""
        return self._n_jumps_before + self._map.restarts

    @property
    def residual_ns(self) -> int:
        """Return what a time may be wrong by [ns], the shortest way left out."""
        return self._map.residual_ns

    def restart(self) -> None:
        """Begin anew: the line was opened again, and the sensor may have been switched off meanwhile."""
        self._n_jumps_before = self.n_jumps
        self._map = ClockMap()
        self._begins = True
        self._late_ns.clear()

    def stamp(self, rows: Rows, arrival_ns: int) -> NDArray[np.int64]:
        """Return when samples were taken [ns], shape (n,).

        Args:
            rows: What has arrived.
            arrival_ns: When it was found [ns].
        """
        n = len(rows.raw)
        if n == 0:
            return np.zeros(0, np.int64)
        if rows.t_ns is not None:
            theirs = rows.t_ns.tolist()
        elif rows.sequence is not None:
            theirs = [round(number * self._period_ns) for number in rows.sequence.tolist()]
        else:
            theirs = [round((self._count + 1 + k) * self._period_ns) for k in range(n)]
            self._count += n
        # What has waited is older than the newest by the sensor's own time; only the newest has just arrived.
        waited = [arrival_ns - (theirs[-1] - t_ns) for t_ns in theirs]
        if self._last is None or self._begins:
            self._map.map(theirs[-1], arrival_ns)
            ours, begun = waited, [True] + [False] * (n - 1)
            self._begins = False
        else:
            ours, begun = [], []
            for t_ns in theirs:
                jumps = self._map.restarts
                ours.append(self._map.map(t_ns, arrival_ns))
                begun.append(self._map.restarts != jumps)
        self._count_missing(theirs, ours, waited, begun)
        self._last = theirs[-1], ours[-1]
        if rows.t_ns is None and rows.sequence is None:
            self._keep_count(arrival_ns - ours[-1])
        return np.array(ours, np.int64) - self._latency_ns

    def _count_missing(
        self, theirs: list[int], ours: list[int], waited: list[int], begun: list[bool]
    ) -> None:
        """Count the gaps in the sensor's own time; over a jump or a new beginning, in ours."""
        before = self._last
        for t_theirs_ns, t_ours_ns, t_waited_ns, begins in zip(theirs, ours, waited, begun, strict=True):
            if before is not None:
                since_ns = t_waited_ns - before[1] if begins else t_theirs_ns - before[0]
                self.n_missing += max(round(since_ns / self._period_ns) - 1, 0)
            before = t_theirs_ns, t_ours_ns

    def _keep_count(self, late_ns: int) -> None:
        self._late_ns.append(late_ns)
        least_ns = min(self._late_ns)
        if len(self._late_ns) == _LATE_LOOKS and least_ns > _LATE_REL * self._period_ns:
            self._count += int(least_ns // self._period_ns)
            self._late_ns.clear()
