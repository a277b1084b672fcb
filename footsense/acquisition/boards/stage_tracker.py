"""Tracker of a converter that runs freely: which conversion each of its results is of, and when that was.

The stages of its sequence convert one after the other, without a pause and without a trigger. A status word has a bit
for each stage that has ended since it was last read. It is read before and behind each burst of results. The first
tells how many conversions have ended, and so which one each result is of. The second names the stages that ended
meanwhile: their results may be old, new or torn. Those are dropped; the burst before has the older ones.

Each status also bounds when the last conversion ended and when the next one will, and many of them the time of a stage.
No status may contradict these bounds: then a bit was lost, or the chip was reset. Nothing is used until the count is
known again, nor while the bounds are wider than a stage.
"""

import math
from typing import NamedTuple

#: Most time between the changes of a stage's status and of its result [ns]: no source says which is first, nor what a
#: status reads as that changes meanwhile. A result is dropped if its stage ended so near to that.
_STATUS_SKEW_NS = 100_000
#: Conversions after which the bounds of a stage's time are taken from newer ones, and how far it may have drifted in
#: them [1].
_N_REFERRED, _DRIFT_REL = 1000, 5e-4


class Span(NamedTuple):
    """Span in which something happened on the wire: not before `from_ns` and not after `to_ns` [ns]."""

    from_ns: float
    to_ns: float


def _first_stages(n_stages: int) -> dict[int, int]:
    """Return the first of the stages of each status whose stages are in a row."""
    found, every = {0: 0}, (1 << n_stages) - 1
    for n in range(1, n_stages + 1):
        for begins in range(n_stages):
            bits = ((1 << n) - 1) << begins
            found.setdefault((bits | bits >> n_stages) & every, begins)
    return found


class StageTracker:
    """Count and times of the conversions of a converter that runs freely.

    Args:
        n_stages: Stages of its sequence.
        stage_ns: Nominal time of a stage [ns].
        clock_tolerance_rel: Largest deviation of its clock [1].
        n_unused: Conversions after a start whose results are not used.

    Attributes:
        stage_ns: Time of a stage, as known so far [ns].
        is_doubtful: Whether a status did not fit: the chip may have lost its settings.
        n_losses: Number of times that the count was lost because the status was read too late.
    """

    def __init__(self, n_stages: int, stage_ns: int, clock_tolerance_rel: float, n_unused: int) -> None:
        self._n_stages = n_stages
        self._first_stages = _first_stages(n_stages)
        self._n_unused = n_unused
        self._tolerated_ns = Span(stage_ns * (1 - clock_tolerance_rel), stage_ns * (1 + clock_tolerance_rel))
        self.stage_ns = self._tolerated_ns
        self.is_doubtful = False
        self.n_losses = 0
        self._is_known = False
        # Conversions that have ended, when the last of them did, the next one to return, the first one that may be
        # returned, and an earlier end.
        self._n_ended, self._next, self._first = 0, 0, 0
        self._ended_ns: tuple[float, float] = 0, 0
        self._referred: tuple[int, tuple[float, float]] = 0, self._ended_ns
        self._last_read: tuple[float, float] = 0, 0

    def start(self, at: Span) -> None:
        """Start the count: the sequence began with its first stage in a window [ns]."""
        self.is_doubtful, self._last_read = False, at
        self._n_ended, self._ended_ns, self._is_known = 0, at, True
        self._next = self._first = self._n_unused
        self._referred, self.stage_ns = (0, at), self._tolerated_ns

    def trust(self) -> None:
        """Count again from the next status on: the chip holds its settings."""
        self.is_doubtful = False
        self._next = self._first = max(self._first, self._n_ended + self._n_stages)

    def repeat(self) -> None:
        """Return the results that the chip still holds once more."""
        self._next = self._first

    def results(
        self, before: int, before_at: tuple[float, float], behind: int, behind_at: tuple[float, float]
    ) -> list[tuple[int, int]]:
        """Return the results of a burst that are new, each of one known conversion, the oldest first.

        Args:
            before: Status read before them, bit k for stage k.
            before_at: When it was read, as of `Span`.
            behind: Status read behind them.
            behind_at: The same.

        Returns:
            Stage of each, and the middle of its conversion [ns], off by less than half of it.
        """
        self._count(before, before_at)
        was_known, n_before, (from_ns, to_ns) = self._is_known, self._n_ended, self._ended_ns
        self._count(behind, behind_at)
        if not self._is_known or self.is_doubtful:
            return []
        if not was_known:
            n_behind = behind.bit_count()
            n_before, (from_ns, to_ns) = self._n_ended - n_behind, self._after(-n_behind)
        shortest_ns, longest_ns = self.stage_ns
        if to_ns - from_ns > shortest_ns:
            return []
        n_stages, end, begin = self._n_stages, n_before, self._n_ended
        # A conversion that ended as the status was read may be in it or not, and its result may be new or not.
        read_from_ns, read_to_ns = before_at
        if to_ns > read_from_ns - _STATUS_SKEW_NS:
            end -= 1
        if begin == n_before and from_ns + shortest_ns < read_to_ns + _STATUS_SKEW_NS:
            begin += 1
        begin, least = begin - n_stages, self._next
        begin = least if least > begin else begin
        self._next = end if end > least else least
        stage_ns = (shortest_ns + longest_ns) / 2
        first_ns = (from_ns + to_ns) / 2 + (0.5 - n_before) * stage_ns
        return [(number % n_stages, round(first_ns + number * stage_ns)) for number in range(begin, end)]

    def _count(self, status: int, at: tuple[float, float]) -> None:
        """Count the conversions that have ended since the last status, or forget the count."""
        last, self._last_read = self._last_read, at
        n, n_stages, begins = status.bit_count(), self._n_stages, self._first_stages.get(status)
        if self._is_known and 0 < n < n_stages and begins == self._n_ended % n_stages:
            self._end(n, at)
            return
        (from_ns, to_ns), (last_from_ns, last_to_ns), (shortest_ns, longest_ns) = at, last, self._tolerated_ns
        least = (from_ns - last_to_ns) // longest_ns
        most = (to_ns - last_from_ns) // shortest_ns + 1
        if begins is None or n > most or n < min(least, n_stages):
            self.is_doubtful, self._is_known = True, False
        elif n == n_stages:  # some may have ended more than once
            self._count_by_time(at)
        elif n and self._is_known:
            self.is_doubtful, self._is_known = True, False
        elif n:
            self._find(begins, Span(last_from_ns - longest_ns, last_to_ns))
            self._end(n, at)

    def _count_by_time(self, at: tuple[float, float]) -> None:
        """Count the conversions that have ended at a time, if only one number of them is possible."""
        (from_ns, to_ns), (shortest_ns, longest_ns) = self._ended_ns, self.stage_ns
        least = (at[0] - to_ns) // longest_ns
        most = (at[1] - from_ns) // shortest_ns
        if self._is_known and self._n_stages <= least == most:
            self._end(int(least), at)
        else:
            self.n_losses += self._is_known
            self._is_known = False

    def _find(self, begins: int, ended_ns: Span) -> None:
        """Find the count again where stage `begins` was the next to end, the one before it in a window."""
        (from_ns, to_ns), (shortest_ns, longest_ns) = self._ended_ns, self.stage_ns
        least = (ended_ns.from_ns - to_ns) / longest_ns - (begins - self._n_ended)
        most = (ended_ns.to_ns - from_ns) / shortest_ns - (begins - self._n_ended)
        turns = math.ceil(least / self._n_stages), math.floor(most / self._n_stages)
        n_known, number = self._n_ended, begins + self._n_stages * turns[0]
        if turns[0] == turns[1]:
            after_ns = self._after(number - n_known)
            ended_ns = Span(max(after_ns.from_ns, ended_ns.from_ns), min(after_ns.to_ns, ended_ns.to_ns))
        else:
            number = begins
            self._referred = number, ended_ns
            self._first = number + max(self._first - n_known, 0)
            self._next = number + max(self._next - n_known, 0)
        self._n_ended, self._ended_ns, self._is_known = number, ended_ns, True

    def _after(self, n: int) -> Span:
        """Return when the n-th conversion after the last one that has ended does so, or before it if negative."""
        (from_ns, to_ns), (shortest_ns, longest_ns) = self._ended_ns, self.stage_ns
        if n < 0:
            shortest_ns, longest_ns = longest_ns, shortest_ns
        return Span(from_ns + n * shortest_ns, to_ns + n * longest_ns)

    def _end(self, n: int, at: tuple[float, float]) -> None:
        """Count conversions that have ended, while the next one has not; narrow the bounds of the times."""
        self._n_ended += n
        (from_ns, to_ns), (shortest_ns, longest_ns) = self._ended_ns, self.stage_ns
        from_ns, to_ns = from_ns + n * shortest_ns, to_ns + n * longest_ns
        earliest_ns, latest_ns = at
        earliest_ns -= longest_ns
        number, (referred_from_ns, referred_to_ns) = self._referred
        n_since = self._n_ended - number
        if from_ns < earliest_ns or to_ns > latest_ns:
            from_ns = earliest_ns if earliest_ns > from_ns else from_ns
            to_ns = latest_ns if latest_ns < to_ns else to_ns
            if n_since:
                least_ns, most_ns = (from_ns - referred_to_ns) / n_since, (to_ns - referred_from_ns) / n_since
                shortest_ns = least_ns if least_ns > shortest_ns else shortest_ns
                longest_ns = most_ns if most_ns < longest_ns else longest_ns
            if to_ns < from_ns or shortest_ns > longest_ns:
                self.is_doubtful, self._is_known, self.stage_ns = True, False, self._tolerated_ns
                return
            self.stage_ns = Span(shortest_ns, longest_ns)
        self._ended_ns = from_ns, to_ns
        if n_since >= _N_REFERRED:
            self._referred = self._n_ended, self._ended_ns
            self.stage_ns = Span(
                max(shortest_ns * (1 - _DRIFT_REL), self._tolerated_ns.from_ns),
                min(longest_ns * (1 + _DRIFT_REL), self._tolerated_ns.to_ns),
            )
