"""The map of a foreign clock, against clocks that drift, jump and stand still, and ways that take their time."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from footsense.clock_map import ClockMap

MS = 1_000_000
PERIOD_NS = 5 * MS


class Stream:
    """Stamps of a foreign clock every 5 ms, that arrive by a way of 0.2 ms and more.

    Args:
        drift_rel: How much this machine's clock runs faster.
        flush_ms: What comes between is handed over together at these times, as a USB adapter does.
    """

    def __init__(self, drift_rel: float = 0.0, flush_ms: int = 0) -> None:
        self.clock = ClockMap()
        self.now_ns = 3_600_000 * MS
        self.foreign_ns = 0
        self._rate_rel = 1 / (1 + drift_rel)
        self._flush_ns = flush_ms * MS
        self._random = np.random.default_rng(7)

    def run(self, seconds: float, late_ns: int = 0) -> list[int]:
        """Return by how much each time is wrong [ns]; positive: too new."""
        errors = []
        for _ in range(round(seconds * 1e9 / PERIOD_NS)):
            self.now_ns += PERIOD_NS
            self.foreign_ns += round(PERIOD_NS * self._rate_rel)
            arrival_ns = self.now_ns + 200_000 + int(self._random.exponential(1 * MS)) + late_ns
            if self._flush_ns:
                arrival_ns = -(-arrival_ns // self._flush_ns) * self._flush_ns
            errors.append(self.clock.map(self.foreign_ns, arrival_ns) - self.now_ns)
        return errors


@pytest.mark.parametrize("drift_rel", [0.0, 40e-6, -40e-6, 0.009, -0.009])
@pytest.mark.parametrize("flush_ms", [0, 16])
def test_offset_and_drift_of_every_clock_in_use(drift_rel: float, flush_ms: int) -> None:
    """Of a way that varies by milliseconds a tenth remains; what the clock is worth is known."""
    stream = Stream(drift_rel, flush_ms)
    stream.run(2.0)
    settled = np.array(stream.run(20.0)[2000:]) * 1e-6
    assert settled.min() > 0.0
    assert settled.max() < (0.6 if flush_ms == 0 else 2.0)
    assert stream.clock.drift_rel == pytest.approx(drift_rel, abs=30e-6 if flush_ms == 0 else 150e-6)
    assert 0 < stream.clock.mean_residual_ns < (0.3 if flush_ms == 0 else 3.0) * MS
    assert stream.clock.restarts == 0


@pytest.mark.parametrize("jump_s", [-1000.0, -0.03, 0.03, 2000.0])
def test_a_jump_is_followed_at_once(jump_s: float) -> None:
    """A reset of the controller, for instance."""
    stream = Stream(40e-6)
    stream.run(3.0)
    stream.foreign_ns += round(jump_s * 1e9)
    errors = np.array(stream.run(3.0)) * 1e-6
    assert stream.clock.restarts == 1
    assert errors.max() < 10.0
    assert errors[400:].max() < 1.0


@pytest.mark.parametrize("each_ns", [MS // 10, MS, 2 * MS, 4 * MS])
def test_a_backlog_at_the_start_leaves_no_trace(each_ns: int) -> None:
    """Two seconds' worth that is read faster than it grows: right as soon as it is read, and no jump."""
    stream = Stream()
    backlog_ns = 2_000 * MS
    while backlog_ns > 0:
        stream.foreign_ns += PERIOD_NS
        backlog_ns -= PERIOD_NS - each_ns
        stream.now_ns += each_ns
        stream.clock.map(stream.foreign_ns, stream.now_ns)
    errors = np.array(stream.run(3.0)) * 1e-6
    assert np.abs(errors[200:] - errors[-1]).max() < 1.0
    assert abs(stream.clock.drift_rel) < 1e-3
    assert stream.clock.restarts == 0


def test_what_waited_on_its_way_is_old() -> None:
    """A second's backlog does not pass for fresh, however late it comes."""
    stream = Stream()
    stream.run(3.0)
    for _ in range(200):
        stream.foreign_ns += PERIOD_NS
        assert stream.clock.map(stream.foreign_ns, stream.now_ns + 1_500 * MS) < stream.now_ns + 1_001 * MS
    assert stream.clock.restarts == 0


def test_a_clock_that_stood_still_is_old_for_a_second_and_then_followed() -> None:
    """Late for ever is no way, but another clock."""
    stream = Stream()
    stream.run(3.0)
    stream.now_ns += 400 * MS
    errors = np.array(stream.run(3.0)) * 1e-6
    assert errors[:190].max() < -398.0
    assert errors[-390:].min() > 0.0
    assert stream.clock.restarts == 1


@given(st.lists(st.tuples(st.integers(-30, 400), st.integers(0, 400)), max_size=300))
def test_never_after_the_arrival_and_never_backwards(steps: list[tuple[int, int]]) -> None:
    """Whatever a clock does."""
    clock = ClockMap()
    foreign_ns = arrival_ns = 0
    last_ns = -1
    for foreign_ms, arrival_ms in steps:
        foreign_ns += foreign_ms * MS
        arrival_ns += arrival_ms * MS
        mapped_ns = clock.map(foreign_ns, arrival_ns)
        assert mapped_ns <= arrival_ns
        if foreign_ms >= 0:
            assert mapped_ns >= last_ns
        last_ns = mapped_ns
        assert abs(clock.drift_rel) <= 0.01
        assert clock.mean_residual_ns >= 0
