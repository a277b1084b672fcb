"""Noise of readings is measured while a foot moves; its motion is not taken for noise."""

import numpy as np
import pytest

from footsense.estimation.noise import ReadingNoise
from footsense.frames import ELEMENTS, Vector

SCAN_S = 0.0225
#: A foot whose loads move all closures, and three patterns beside that.
_PATTERNS = np.linalg.qr(np.column_stack((np.ones(ELEMENTS), np.eye(ELEMENTS)[:, :8])))[0]
MOMENTS = (_PATTERNS * np.array([1.0, 0.1, 0.1, 0.03, 0.01, 3e-3, 3e-3, 1e-3, 4e-4])) @ _PATTERNS.T
NOISE_REL = 5e-3


def measured_rel(load: Vector, noise_rel: Vector) -> Vector:
    """Return the noise of one leg after each scan, whose common closure and noise are given scan by scan."""
    random = np.random.default_rng(2)
    readings = 1.3 - load[:, None] + noise_rel[:, None] * random.standard_normal((len(load), ELEMENTS))
    noise, found = ReadingNoise(1, MOMENTS), []
    for scan in range(2, len(load)):
        window = readings[scan - 2 : scan + 1][::-1][:, None]
        for _ in range(3):  # a frame has one new reading of each leg
            noise.observe(window)
        found.append(float(np.sqrt(noise.variance_rel[0])))
    return np.array(found)


def steps(n: int) -> Vector:
    """Return the closures of steps of 1 s: half of it a stance that rises and falls within 0.1 s."""
    phase = (np.arange(n) * SCAN_S) % 1.0
    stance = np.clip(np.minimum(phase, 0.5 - phase) / 0.1, 0.0, 1.0)
    closure_rel: Vector = 0.3 * stance * stance * (3.0 - 2.0 * stance)
    return closure_rel


@pytest.mark.parametrize("load", [np.full(400, 0.2), steps(400)], ids=["standing", "walking"])
def test_white_noise_is_measured_standing_and_walking(load: Vector) -> None:
    """Held at its largest of the last second: four scans of four patterns are off by a fifth, rms."""
    found = measured_rel(load, np.full(400, NOISE_REL))[100:]
    assert found.min() > 0.75 * NOISE_REL
    assert found.max() < 2.2 * NOISE_REL


def test_steps_are_no_noise() -> None:
    quiet = 1e-4
    assert measured_rel(steps(400), np.full(400, quiet)).max() < 3.0 * quiet


@pytest.mark.parametrize("hit_rel", [(0.6, 0.2), (0.1, 0.06), (0.06, 0.04)], ids=str)
def test_impacts_are_no_noise(hit_rel: tuple[float, float]) -> None:
    """Of a few milliseconds, three a second, seen by one or two elements."""
    quiet = 2e-4
    rng, noise = np.random.default_rng(3), ReadingNoise(1, MOMENTS)
    readings = 1.3 + quiet * rng.standard_normal((400, ELEMENTS))
    for scan in range(20, 400, 15):
        readings[scan, rng.permutation(ELEMENTS)[:2]] -= hit_rel
    found = []
    for scan in range(2, len(readings)):
        window = readings[scan - 2 : scan + 1][::-1][:, None]
        for _ in range(3):
            noise.observe(window)
        found.append(float(np.sqrt(noise.variance_rel[0])))
    assert max(found) < 5.0 * quiet
    assert np.median(found) < 3.0 * quiet


def test_bursts_are_held_between_them_and_forgotten_after_them() -> None:
    """Bursts of 0.15 s twice a second, for 4 s of 12."""
    t_s = SCAN_S * np.arange(550)
    bursts = (t_s % 0.5 < 0.15) & (t_s < 4.0)
    found = measured_rel(np.zeros(550), np.where(bursts, NOISE_REL, 1e-4))
    assert found[45:175].min() > 0.4 * NOISE_REL
    assert found[-1] < 0.05 * NOISE_REL


def test_a_ripple_near_the_rate_of_a_scan_is_slow_noise() -> None:
    """Each element reads another phase of it, which turns once in half a second; nothing of it is in two scans."""
    phases = 2.0 * np.pi * np.arange(ELEMENTS) / ELEMENTS
    turned = 2.0 * np.pi * 2.0 * SCAN_S * np.arange(200)[:, None]
    noise = ReadingNoise(1, MOMENTS)
    readings = 1.3 + 2.0**0.5 * NOISE_REL * np.sin(phases + turned)
    for scan in range(2, len(readings)):
        for _ in range(3):
            noise.observe(readings[scan - 2 : scan + 1][::-1][:, None])
    assert 0.5 * NOISE_REL < np.sqrt(noise.variance_rel[0]) < 2.0 * NOISE_REL


def test_what_motion_left_is_bounded_by_quieter_readings() -> None:
    """A foot that hops never rests for long: what landings were taken for is not held to the end."""
    rng, noise = np.random.default_rng(4), ReadingNoise(1, MOMENTS)
    found = []
    for scan in range(300):
        shaken = 0.1 if scan < 15 else 1e-3
        # Common motion beside it, so that none of the later measurements counts.
        window = 1.3 + shaken * rng.standard_normal((3, 1, ELEMENTS))
        window += (scan >= 15) * np.array([0.0, 0.1, 0.0])[:, None, None]
        for _ in range(3):
            noise.observe(window)
        found.append(float(np.sqrt(noise.variance_rel[0])))
    assert max(found) > 0.05
    assert found[-1] < 0.01


def test_an_element_that_breaks_is_no_noise() -> None:
    noise = ReadingNoise(1, MOMENTS)
    readings = 1.3 + 1e-4 * np.random.default_rng(5).standard_normal((200, ELEMENTS))
    readings[100:, 4] -= 0.5
    for scan in range(2, len(readings)):
        for _ in range(3):
            noise.observe(readings[scan - 2 : scan + 1][::-1][:, None])
        assert np.sqrt(noise.variance_rel[0]) < 5e-4


def test_a_leg_with_unread_elements_keeps_its_noise() -> None:
    noise = ReadingNoise(2, MOMENTS)
    window = np.random.default_rng(0).normal(1.0, NOISE_REL, (3, 2, ELEMENTS))
    for _ in range(50):
        noise.observe(window)
    before = noise.variance_rel.copy()
    window[0, 1, 4] = np.nan
    noise.observe(window)
    assert np.isfinite(noise.variance_rel).all()
    assert noise.variance_rel[1] == pytest.approx(before[1], rel=0.02)
