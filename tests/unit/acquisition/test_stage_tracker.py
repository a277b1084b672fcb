"""Stamps of a converter that runs freely: no result may have those of another conversion."""

from dataclasses import dataclass

import numpy as np
import pytest

from footsense.acquisition.boards.stage_tracker import Span, StageTracker

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


@dataclass
class _Counts:
    n_wrong: int = 0
    n_results: int = 0
    n_bursts: int = 0
    n_silent: int = 0
    most_silent: int = 0


def _bursts(n: int, sequencer: _Sequencer, host: _Host, period_ns: float) -> _Counts:
    """Read a chip `n` times, and compare each result with the conversion that it is of."""
    counts = _Counts()
    tracker = StageTracker(_N_STAGES, _STAGE_NS, 0.05, 2 * _N_STAGES)
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
        results = []
        if is_lost:
            tracker.miss(t_ns)
        else:
            results = tracker.results(
                before,
                Span(
                    round(begin_ns + 0.9 * _TO_WORD * _BIT_NS), round(between_ns - 0.9 * _RESULTS * _BIT_NS)
                ),
                behind,
                Span(round(between_ns + 0.9 * _TO_WORD * _BIT_NS), round(t_ns)),
            )
        if tracker.is_doubtful:
            tracker.trust()
        for stage, result_ns in results:
            error_ns = abs(result_ns - (held[stage] + 0.5) * sequencer.stage_ns)
            counts.n_wrong += error_ns > sequencer.stage_ns / 2 or stage != held[stage] % _N_STAGES
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


def _run(n: int, random: np.random.Generator) -> None:
    for kind in _KINDS:
        clock_rel, cost_us, stalls_rel, stages, skew_ns, loses_bits = kind
        sequencer = _Sequencer(_STAGE_NS * (1 + clock_rel), skew_ns, loses_bits)
        host = _Host(random, cost_us, stalls_rel, fails_rel=stalls_rel)
        counts = _bursts(n, sequencer, host, stages * _STAGE_NS)
        print(kind, counts)
        assert (counts.n_wrong, kind) == (0, kind)
        assert counts.n_bursts > 0.5 * n, (counts, kind)


def test_no_result_has_the_stamp_of_another_conversion() -> None:
    """With a clock that is off, a host that stalls, a status that is early or late, and bits of it that are lost."""
    _run(400, np.random.default_rng(1))


@pytest.mark.slow
def test_no_result_of_a_million_bursts_has_the_stamp_of_another_conversion() -> None:
    """Each kind of chip and host alike."""
    _run(1_000_000 // len(_KINDS) + 1, np.random.default_rng(2))


def test_a_chip_that_starts_again_is_doubtful() -> None:
    """A reset chip converts its first stage alone, and a stopped one none."""
    tracker = StageTracker(_N_STAGES, _STAGE_NS, 0.05, 0)
    tracker.start(Span(0, 0))
    at_ns = 4 * _STAGE_NS + 1000
    window, later = Span(at_ns, at_ns), Span(at_ns + 100_000, at_ns + 100_000)
    assert [stage for stage, _ in tracker.results(0b1111, window, 0, later)] == [0, 1, 2]
    at_ns += 4 * _STAGE_NS
    window, later = Span(at_ns, at_ns), Span(at_ns + 100_000, at_ns + 100_000)
    assert tracker.results(0b0001, window, 0, later) == []
    assert tracker.is_doubtful
    tracker.trust()
    at_ns += 4 * _STAGE_NS
    window, later = Span(at_ns, at_ns), Span(at_ns + 100_000, at_ns + 100_000)
    assert tracker.results(0, window, 0, later) == []
    assert tracker.is_doubtful
