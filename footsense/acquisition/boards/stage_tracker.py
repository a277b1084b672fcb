"""Tracker of a converter that runs freely: which conversion each of its results is of, and when that was.

The stages of its sequence convert one after the other, without a pause and without a trigger. A status word has a bit
for each stage that has ended since it was last read. It is read before and behind each burst of results. The first
stage in it was the next one at the read before, and the number of stages tells which one is the next now. Those in the
status behind the results ended meanwhile: their results may be old, new or torn. They are dropped; the burst before has
the older ones.

Each status also bounds when conversions ended, and many of them the time of a stage. Of the pairs of both that fit to
all that was read, a polygon, each status cuts away what does not fit. What is left holds on while nothing is read: in a
status that comes late every bit is set, and the time alone tells which numbers of conversions are possible. The next
status that names its stages tells which of them it was; until then a result is used if it has one stamp with all.

No status may contradict what is left: then a bit was lost, or the chip was reset. Nothing is used until its settings
have been read back, nor while the time of a conversion is not known to a stage.
"""

from typing import NamedTuple

#: Most time between the changes of a stage's status and of its result [ns]: no source says which is first, nor what a
#: status reads as that changes meanwhile. A result is dropped if its stage ended so near to that.
_STATUS_SKEW_NS = 100_000
#: Conversions after which all but bounds is forgotten, and how far the time of a stage may have drifted in them [1].
_N_REFERRED, _DRIFT_REL = 1000, 5e-4
#: What a status has to narrow the bounds by, or it is not worth the time [ns].
_NEGLIGIBLE_NS = 40_000
#: What a burst without a new result gives.
_NOTHING = range(0), 0.0, 0.0


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


def _cut(corners: list[tuple[float, float]], n: int, at_ns: float, sign: int) -> list[tuple[float, float]]:
    """Return a polygon of possible times less what contradicts one.

    Args:
        corners: When an earlier number of conversions had ended, and the time of a stage [ns].
        n: Conversions since then.
        at_ns: When they had ended [ns].
        sign: 1 if that was then at the latest, -1 if at the earliest.
    """
    kept, (last_ended_ns, last_stage_ns) = [], corners[-1]
    last_spare_ns = sign * (at_ns - last_ended_ns - n * last_stage_ns)
    for corner in corners:
        ended_ns, stage_ns = corner
        spare_ns = sign * (at_ns - ended_ns - n * stage_ns)
        if (spare_ns < 0) != (last_spare_ns < 0):
            share = spare_ns / (spare_ns - last_spare_ns)
            cut_ns = ended_ns + share * (last_ended_ns - ended_ns)
            kept.append((cut_ns, stage_ns + share * (last_stage_ns - stage_ns)))
        if spare_ns >= 0:
            kept.append(corner)
        last_ended_ns, last_stage_ns, last_spare_ns = ended_ns, stage_ns, spare_ns
    return kept


class StageTracker:
    """Count and times of the conversions of a converter that runs freely.

    Args:
        n_stages: Stages of its sequence.
        stage_ns: Nominal time of a stage [ns].
        clock_tolerance_rel: Largest deviation of its clock [1].
        n_unused: Conversions after a start whose results are not used.

    Attributes:
        stage_ns: Bounds of the time of a stage, as known so far [ns].
        is_doubtful: Whether a status did not fit: the chip may have lost its settings.
    """

    def __init__(self, n_stages: int, stage_ns: int, clock_tolerance_rel: float, n_unused: int) -> None:
        self._n_stages = n_stages
        self._first_stages = _first_stages(n_stages)
        self._n_unused = n_unused
        # A plain pair, as those of the times of reads are: a named tuple takes longer to unpack.
        self._tolerated_ns = stage_ns * (1 - clock_tolerance_rel), stage_ns * (1 + clock_tolerance_rel)
        self._least = self._most = 0
        self._is_known = False
        self.start(Span(0, 0))

    def start(self, at: Span) -> None:
        """Start the count: the sequence began with its first stage in a window [ns]."""
        self.is_doubtful, self.stage_ns = False, self._tolerated_ns
        self._last_read: tuple[float, float] = at
        # The first conversion that may be returned, and the next one to return.
        self._first = self._next = self._n_unused
        self._begin_anew(0, at)

    def trust(self) -> None:
        """Count anew from the next status on: the chip holds its settings, and any of its stages may be the next."""
        self.is_doubtful = False
        read_ns = self._last_read[1]
        self._begin_anew(self._most, (read_ns - 2 * self._n_stages * self.stage_ns[1], read_ns))
        self._first = max(self._first, self._number + self._n_stages)
        self.miss(read_ns)

    def miss(self, until_ns: float) -> None:
        """Expect that a status was read until now and lost; return the results that the chip still holds once more."""
        self._last_read = self._last_read[0], until_ns
        self._most = self._possible(self._last_read)[1]
        self._next = self._first

    def results(
        self, before: int, before_at: tuple[float, float], behind: int, behind_at: tuple[float, float]
    ) -> tuple[range, float, float]:
        """Return which results of a burst are new, each of one known conversion, the oldest first.

        Args:
            before: Status read before them, bit k for stage k. With other bits it is a result: the burst began one
                register late, and has read no status.
            before_at: When it was read, as of `Span`.
            behind: Status read behind them.
            behind_at: The same.

        Returns:
            Numbers of the conversions, which count stages from the start; and a time and that of a stage [ns]: the
            middle of conversion n is the former and n times the latter, off by less than half a stage.
        """
        n_stages, is_shifted = self._n_stages, before >> self._n_stages
        if not is_shifted:
            self._count(before, before_at)
        self._count(behind, behind_at)
        if is_shifted or self.is_doubtful:
            return _NOTHING
        # The status behind the results tells how many had ended before them.
        begin, end = self._most - n_stages, self._least - behind.bit_count()
        # A conversion that ended as the status was read may be in it or not, and its result may be new or not.
        if not behind and self._ended(self._most + 1)[0] < before_at[1] + _STATUS_SKEW_NS:
            begin += 1
        begin = begin if begin > self._next else self._next
        (from_ns, to_ns), (shortest_ns, longest_ns) = self._ended(begin), self.stage_ns
        if to_ns + (end - begin) * longest_ns > before_at[0] - _STATUS_SKEW_NS:
            end -= 1
        if to_ns - from_ns + n_stages * (longest_ns - shortest_ns) > shortest_ns:
            self._bound((begin + end + 1) // 2)
            (from_ns, to_ns), (shortest_ns, longest_ns) = self._ended(begin), self.stage_ns
            if to_ns - from_ns > shortest_ns:
                return _NOTHING
        if end > begin:
            self._next = end
        stage_ns = (shortest_ns + longest_ns) / 2
        return range(begin, end), (from_ns + to_ns) / 2 + (0.5 - begin) * stage_ns, stage_ns

    def _count(self, status: int, at: tuple[float, float]) -> None:
        """Count the conversions that have ended since the last status, as far as this one and the time tell."""
        n, n_stages, begins = status.bit_count(), self._n_stages, self._first_stages.get(status)
        if self._is_known and 0 < n < n_stages and begins == self._least % n_stages:
            self._last_read = at
            self._least = self._most = number = self._least + n
            self._narrow(number, at)
            return
        last = self._last_read
        if at[0] - last[1] > _N_REFERRED * self.stage_ns[1] and not self.is_doubtful:
            self.trust()
        least, most, self._last_read = self._least, self._most, at
        if begins is None:
            self.is_doubtful = True
            return
        if n == n_stages:  # some may have ended more than once
            least_now, most_now = self._possible(at)
            least, most = max(least + n, least_now), most_now
        else:
            if least < most:
                least_now, most_now = self._possible(at)
                least, most = max(least, least_now - n), min(most, most_now - n)
            if status:
                least, most = self._resolve(least + (begins - least) % n_stages, most, last)
            elif at[0] - last[1] > self.stage_ns[1]:
                self.is_doubtful = True
            least, most = least + n, most + n
        self._least, self._most = least, most
        # Without a bit it may be that of the status before that was lost: the next one tells.
        self._is_known = least == most and n > 0
        if self._is_known:
            self._narrow(least, at)
        elif least > most:
            self.is_doubtful = True

    def _resolve(self, number: int, most: int, last: tuple[float, float]) -> tuple[int, int]:
        """Return the least and the most that had ended at the last status, if a number of its stages had."""
        if number + self._n_stages <= most:
            self._begin_anew(number, (last[0] - self.stage_ns[1], last[1]))
        elif number <= most and not self._is_known:
            self._narrow(number, last)
        return number, min(number, most)

    def _begin_anew(self, number: int, ended_ns: tuple[float, float]) -> None:
        """Know nothing but when some number of conversions had ended, and the bounds of a stage's time."""
        # The least and most conversions that had ended at the last status, and whether that has been used.
        self._least = self._most = number
        self._is_known = False
        self._assume(number, ended_ns, self.stage_ns)

    def _assume(self, number: int, ended_ns: tuple[float, float], stage_ns: tuple[float, float]) -> None:
        """Let any times within bounds be possible: of when a number of conversions had ended, and of a stage."""
        (from_ns, to_ns), (shortest_ns, longest_ns) = ended_ns, stage_ns
        self._origin, self._number, self._ended_ns, self.stage_ns = number, number, ended_ns, stage_ns
        # Corners of the polygon: when `_origin` conversions had ended, and the time of a stage. The bounds of when
        # `_number` had are those that it has, or wider.
        self._corners = [
            (from_ns, shortest_ns),
            (to_ns, shortest_ns),
            (to_ns, longest_ns),
            (from_ns, longest_ns),
        ]

    def _ended(self, number: int) -> tuple[float, float]:
        """Return the bounds of the time at which some number of conversions had ended [ns]."""
        n, (from_ns, to_ns), (shortest_ns, longest_ns) = number - self._number, self._ended_ns, self.stage_ns
        if n < 0:
            shortest_ns, longest_ns = longest_ns, shortest_ns
        return from_ns + n * shortest_ns, to_ns + n * longest_ns

    def _possible(self, at: tuple[float, float]) -> tuple[int, int]:
        """Return the least and the most conversions that may have ended at a time."""
        (from_ns, to_ns), (shortest_ns, longest_ns) = self._ended_ns, self.stage_ns
        number = self._number
        return number + int((at[0] - to_ns) // longest_ns), number + int((at[1] - from_ns) // shortest_ns)

    def _narrow(self, number: int, at: tuple[float, float]) -> None:
        """Narrow the bounds of the times: some number of conversions had ended, and the next one had not."""
        (from_ns, to_ns), (shortest_ns, longest_ns), (earliest_ns, latest_ns) = (
            self._ended_ns,
            self.stage_ns,
            at,
        )
        n, since = number - self._number, number - self._origin
        is_after_ns, is_before_ns = (
            to_ns + n * longest_ns - latest_ns,
            earliest_ns - from_ns - (n + 1) * shortest_ns,
        )
        if is_after_ns < _NEGLIGIBLE_NS and is_before_ns < _NEGLIGIBLE_NS and since <= _N_REFERRED:
            return
        corners = self._corners
        if is_after_ns > 0:
            corners = _cut(corners, since, latest_ns, 1)
        if is_before_ns > 0:
            corners = _cut(corners, since + 1, earliest_ns, -1)
        if not corners:
            self.is_doubtful, self.stage_ns = True, self._tolerated_ns
            return
        self._corners = corners
        self._bound(number)
        if since > _N_REFERRED:
            (shortest_ns, longest_ns), (least_ns, most_ns) = self.stage_ns, self._tolerated_ns
            shortest_ns, longest_ns = shortest_ns * (1 - _DRIFT_REL), longest_ns * (1 + _DRIFT_REL)
            self._assume(number, self._ended_ns, (max(shortest_ns, least_ns), min(longest_ns, most_ns)))

    def _bound(self, number: int) -> None:
        """Take from the polygon the bounds of a stage, and of when some number of conversions had ended."""
        ended_ns = [ended_ns + (number - self._origin) * stage_ns for ended_ns, stage_ns in self._corners]
        stages_ns = [stage_ns for _, stage_ns in self._corners]
        self._number, self._ended_ns = number, (min(ended_ns), max(ended_ns))
        self.stage_ns = min(stages_ns), max(stages_ns)
