"""Thresholds that set themselves: noise and shake of a swing raise them, a load that comes to stay does not."""

import math
from collections.abc import Iterable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from footsense.estimation.contact import SwingNoise
from footsense.frames import Vector

STEP_S = 2.7167e-3
START_N, LEAST_N = 0.03, 0.0045


class Signal:
    """A signal of one leg in swing, conversion by conversion."""

    def __init__(self) -> None:
        self.noise = SwingNoise(LEAST_N)
        self.t_s = 1.0
        self.noise.discard_pending(round(self.t_s * 1e9))

    def feed(self, values_n: Iterable[float]) -> float:
        """Observe values [N], and return the threshold [N]."""
        for value_n in values_n:
            self.t_s += STEP_S
            self.noise.block_n.append(value_n)
            if self.t_s * 1e9 >= self.noise.end_ns:
                self.noise.end_block(round(self.t_s * 1e9))
        return self.noise.threshold_n


def times_s(duration_s: float) -> Vector:
    return np.arange(0.0, duration_s, STEP_S)


@given(st.integers(0, 1000), st.floats(0.5e-3, 5e-3))
def test_noise_stays_below_its_threshold(seed: int, sigma_n: float) -> None:
    """Ten seconds of noise about the floor, then ten more: above the threshold at most once in a thousand readings."""
    rng = np.random.default_rng(seed)
    signal = Signal()
    threshold_n = signal.feed(sigma_n * rng.normal(size=3700))
    assert threshold_n < max(9.0 * sigma_n, LEAST_N)
    assert np.mean(sigma_n * rng.normal(size=3700) > threshold_n) < 1e-3


@pytest.mark.parametrize("hertz", [3.0, 8.0, 20.0])
def test_shake_raises_the_threshold_above_its_peaks(hertz: float) -> None:
    """It passes and comes back, whatever its frequency."""
    shake_n = 0.02 * np.sin(2.0 * math.pi * hertz * times_s(3.0))
    assert 0.02 < Signal().feed(shake_n) < 0.06


@given(n_per_s=st.floats(2e-3, 0.5), noisy=st.booleans())
def test_a_load_that_comes_slowly_is_not_noise(*, n_per_s: float, noisy: bool) -> None:
    """A foot that is put down gently crosses the threshold: that does not run away from it."""
    signal = Signal()
    rng = np.random.default_rng(1)
    signal.feed(1e-3 * rng.normal(size=400) * noisy)
    rise_n = n_per_s * times_s(min(2.0 * START_N / n_per_s, 30.0))
    for value_n in rise_n + 1e-3 * rng.normal(size=len(rise_n)) * noisy:
        if value_n > signal.feed([value_n]):
            return
    raise AssertionError(f"{rise_n[-1]} N are below the threshold of {signal.noise.threshold_n} N")


def test_a_bias_of_the_signal_is_part_of_its_noise() -> None:
    """A prediction that reads a little too much in the air has a threshold above that."""
    noise_n = 1.5e-3 * np.random.default_rng(2).normal(size=2000)
    assert Signal().feed(1e-3 + noise_n) == pytest.approx(Signal().feed(noise_n) + 1e-3, rel=0.05)


def test_the_rise_of_a_touchdown_is_not_learnt() -> None:
    """The last blocks before it are dropped."""
    signal = Signal()
    signal.feed(np.zeros(400))
    signal.feed([0.0, 0.02, 0.1, 0.3, 0.6, 1.0])
    signal.noise.discard_pending(round(signal.t_s * 1e9))
    assert signal.feed(np.zeros(100)) == LEAST_N
