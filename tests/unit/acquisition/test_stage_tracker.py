"""Stamps of a converter that runs freely: no result may have those of another conversion."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pytest

from footsense.acquisition.boards.stage_tracker import Span, StageTracker
from tests.firmware.native import NativeTracker

_N_STAGES, _STAGE_NS, _BIT_NS = 9, 768_000, 2500
#: Bits of a read up to its first word and to the end of it, and of nine words.
_TO_WORD, _TO_END, _RESULTS = 39, 57, 162
#: A result: the first word of a burst that begins one register late.
_CODE = 0x8123


@dataclass
class _Sequencer:
    """A chip as it is on the wire: stages that end one after the other, a status that a read clears."""

    stage_ns: float
    skew_ns: float = 0.0
    loses_bits: bool = False
    cleared_ns: float = 0.0

    def ended(self, t_ns: float) -> int:
        return int(t_ns // self.stage_ns)

    def status(self, t_ns: float) -> int:
        first, end = self.ended(self.cleared_ns), self.ended(t_ns)
        self.cleared_ns = t_ns
        if self.loses_bits and t_ns % self.stage_ns < 20e3:
            end -= 1
        return sum(1 << stage for stage in {number % _N_STAGES for number in range(max(first, end - 9), end)})

    def conversion_of(self, stage: int, t_ns: float) -> int:
        """Return of which conversion the result register of a stage is at a time."""
        newest = self.ended(t_ns - self.skew_ns) - 1
        return newest - (newest - stage) % _N_STAGES


@dataclass
class _Host:
    """A computer that adds a time to each transaction, rarely a long one, and an adapter that fails."""

    random: np.random.Generator
    cost_us: tuple[float, float]
    stalls_rel: float
    fails_rel: float

    def delay_ns(self) -> float:
        delay_us = self.random.uniform(*self.cost_us) / 2
        if self.random.random() < self.stalls_rel:
            delay_us += self.random.exponential(6000.0)
        return 1e3 * delay_us


def _results(
    tracker: StageTracker, before: int, before_at: Span, behind: int, behind_at: Span
) -> list[tuple[int, float]]:
    """Return the stage of each new result of a burst, and the middle of its conversion [ns]."""
    numbers, time_ns, stage_ns = tracker.results(before, before_at, behind, behind_at)
    return [(number % _N_STAGES, time_ns + number * stage_ns) for number in numbers]


class _Tracker(StageTracker):
    """The service's, for `_bursts`."""

    def __init__(self) -> None:
        super().__init__(_N_STAGES, _STAGE_NS, 0.05, 2 * _N_STAGES)

    def stamped(
        self, before: int, before_at: Span, held: Sequence[int], behind: int, behind_at: Span
    ) -> list[tuple[int, float]]:
        """Return the conversions of a burst that are used, as held by the registers, and the middle of each [ns]."""
        return [(held[stage], t_ns) for stage, t_ns in _results(self, before, before_at, behind, behind_at)]


@dataclass
class _Counts:
    n_wrong: int = 0
    n_results: int = 0
    n_bursts: int = 0
    n_silent: int = 0
    most_silent: int = 0


def _bursts(
    n: int, sequencer: _Sequencer, host: _Host, period_ns: float, tracker: _Tracker | NativeTracker
) -> _Counts:
    """Read a chip `n` times, and compare each result with the conversion that it is of."""
    counts = _Counts()
    started_ns = host.delay_ns()
    tracker.start(Span(-round(started_ns), round(host.delay_ns())))
    t_ns = due_ns = 1e6
    for _ in range(n):
        begin_ns = t_ns
        wire_ns = begin_ns + host.delay_ns()
        is_shifted, is_lost = host.random.random(2) < host.fails_rel
        before = _CODE if is_shifted else sequencer.status(wire_ns + _TO_WORD * _BIT_NS)
        held = [
            sequencer.conversion_of(stage, wire_ns + (_TO_END + 18 * stage) * _BIT_NS)
            for stage in range(_N_STAGES)
        ]
        between_ns = wire_ns + (_TO_END + _RESULTS) * _BIT_NS + host.delay_ns()
        wire_ns = between_ns + host.delay_ns()
        behind = sequencer.status(wire_ns + _TO_WORD * _BIT_NS)
        t_ns = wire_ns + _TO_END * _BIT_NS + host.delay_ns()
        results: list[tuple[int, float]] = []
        if is_lost:
            tracker.miss(t_ns)
        else:
            results = tracker.stamped(
                before,
                Span(
                    round(begin_ns + 0.9 * _TO_WORD * _BIT_NS), round(between_ns - 0.9 * _RESULTS * _BIT_NS)
                ),
                held,
                behind,
                Span(round(between_ns + 0.9 * _TO_WORD * _BIT_NS), round(t_ns)),
            )
        if tracker.is_doubtful:
            tracker.trust()
        for number, result_ns in results:
            counts.n_wrong += abs(result_ns - (number + 0.5) * sequencer.stage_ns) > sequencer.stage_ns / 2
        counts.n_results += len(results)
        counts.n_bursts += bool(results)
        counts.n_silent = 0 if results else counts.n_silent + 1
        counts.most_silent = max(counts.most_silent, counts.n_silent)
        due_ns = max(due_ns + period_ns, t_ns + 1e3 * host.random.uniform(0, 2000))
        t_ns = due_ns
    return counts


_KINDS = [
    (clock_rel, cost_us, stalls_rel, stages, skew_ns, loses_bits)
    for clock_rel in (-0.04, -0.013, 0.0, 0.013, 0.04)
    for cost_us, stalls_rel in (((40, 60), 0.0005), ((100, 200), 0.002), ((100, 550), 0.01))
    for stages, skew_ns, loses_bits in (
        (4.4, 0.0, True),
        (4.4, 60e3, False),
        (7.4, -60e3, False),
        (9.3, 60e3, False),  # of a bus that carries less
        (34.2, 0.0, False),
    )
]


trackers = pytest.mark.parametrize("tracker_of", [_Tracker, NativeTracker], ids=["service", "firmware"])


def _run(n: int, random: np.random.Generator, tracker_of: type[_Tracker] | type[NativeTracker]) -> None:
    for kind in _KINDS:
        clock_rel, cost_us, stalls_rel, stages, skew_ns, loses_bits = kind
        sequencer = _Sequencer(_STAGE_NS * (1 + clock_rel), skew_ns, loses_bits)
        host = _Host(random, cost_us, stalls_rel, fails_rel=stalls_rel)
        counts = _bursts(n, sequencer, host, stages * _STAGE_NS, tracker_of())
        assert (counts.n_wrong, kind) == (0, kind)
        # Each bit that is lost costs as much as a start.
        assert counts.n_bursts > (0.55 if loses_bits else 0.8) * n, (counts, kind)
        assert counts.most_silent < (40 if loses_bits else 25), (counts, kind)


@trackers
def test_no_result_has_the_stamp_of_another_conversion(
    tracker_of: type[_Tracker] | type[NativeTracker],
) -> None:
    """With a clock that is off, a host that stalls, a status that is early or late, and bits of it that are lost.

    Also where a bus carries less than a burst a sequence, a burst begins late, or an answer is lost: results are back
    after a few bursts.
    """
    _run(150, np.random.default_rng(1), tracker_of)


@pytest.mark.slow
@trackers
def test_no_result_of_a_million_bursts_has_the_stamp_of_another_conversion(
    tracker_of: type[_Tracker] | type[NativeTracker],
) -> None:
    """Each kind of chip and host alike."""
    _run(1_000_000 // len(_KINDS) + 1, np.random.default_rng(2), tracker_of)


def _burst(tracker: StageTracker, sequencer: _Sequencer, at_ns: int) -> list[tuple[int, float]]:
    """Return the results of a burst whose transactions take no time but their own 0.5 ms."""
    before = sequencer.status(at_ns), Span(at_ns - 50_000, at_ns + 50_000)
    behind_ns = at_ns + 500_000
    behind_at = Span(behind_ns - 50_000, behind_ns + 50_000)
    return _results(tracker, *before, sequencer.status(behind_ns), behind_at)


def _running() -> tuple[StageTracker, _Sequencer]:
    """Return a tracker that knows its chip after 0.4 s, and the chip."""
    tracker, sequencer = StageTracker(_N_STAGES, _STAGE_NS, 0.05, 0), _Sequencer(1.03 * _STAGE_NS)
    tracker.start(Span(-50_000, 50_000))
    for k in range(1, 101):
        results = _burst(tracker, sequencer, round(k * 4.4 * _STAGE_NS))
    assert len(results) >= 4
    return tracker, sequencer


@pytest.mark.parametrize("late_ms", [10, 100, 300])
def test_a_burst_after_a_stall_has_the_results_of_its_conversions(late_ms: int) -> None:
    """The bounds of phase and stage hold on: it needs no status before that."""
    tracker, sequencer = _running()
    results = _burst(tracker, sequencer, round(440 * _STAGE_NS + late_ms * 1e6))
    assert len(results) >= 6
    for stage, t_ns in results:
        number = t_ns / sequencer.stage_ns - 0.5
        assert round(number) % _N_STAGES == stage
        assert abs(number - round(number)) < 0.5
    assert results[-1][1] > 440 * _STAGE_NS + late_ms * 1e6 - 3 * _STAGE_NS


def test_a_status_whose_answer_is_lost_raises_no_doubt() -> None:
    tracker, sequencer = _running()
    for k in range(101, 111, 2):  # the status of every other burst
        sequencer.status(k * 4.4 * _STAGE_NS)
        tracker.miss((k + 0.1) * 4.4 * _STAGE_NS)
        assert len(_burst(tracker, sequencer, round((k + 1) * 4.4 * _STAGE_NS))) >= 6
        assert not tracker.is_doubtful


def test_after_a_second_without_a_status_nothing_is_assumed() -> None:
    """Its clock may have drifted; a few bursts later it is known again."""
    tracker, sequencer = _running()
    sequencer.stage_ns *= 1.001
    n_results = []
    for k in range(12):
        results = _burst(tracker, sequencer, round((440 + 4.4 * k) * _STAGE_NS + 1.5e9))
        assert all(round(t_ns / sequencer.stage_ns - 0.5) % _N_STAGES == stage for stage, t_ns in results)
        assert not tracker.is_doubtful
        n_results.append(len(results))
    assert n_results[0] == 0 < n_results[-1]


def test_a_chip_that_starts_again_is_doubtful() -> None:
    """A reset chip converts its first stage alone, and a stopped one none."""
    tracker = StageTracker(_N_STAGES, _STAGE_NS, 0.05, 0)
    tracker.start(Span(0, 0))
    at_ns = 4 * _STAGE_NS + 1000
    window, later = Span(at_ns, at_ns), Span(at_ns + 100_000, at_ns + 100_000)
    assert [stage for stage, _ in _results(tracker, 0b1111, window, 0, later)] == [0, 1, 2]
    at_ns += 4 * _STAGE_NS
    window, later = Span(at_ns, at_ns), Span(at_ns + 100_000, at_ns + 100_000)
    assert _results(tracker, 0b0001, window, 0, later) == []
    assert tracker.is_doubtful
    tracker.trust()
    at_ns += 4 * _STAGE_NS
    window, later = Span(at_ns, at_ns), Span(at_ns + 100_000, at_ns + 100_000)
    assert _results(tracker, 0, window, 0, later) == []
    assert tracker.is_doubtful
