"""Presses of one foot under a reference sensor, as the cycles of a loop, without any chips."""

import math
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from footsense.frames import CapFrame, Cycle, Reading, ReferenceSamples
from tests.support.feet import DESIGN
from tests.support.frames import contact_frame

Vector = NDArray[np.float64]

SCAN_NS = 24_400_000
SAMPLE_NS = 5_000_000
NOISE_FF = 0.916
#: Noise of a sample [N], half of 4, 4 and 12 gf, and its offset.
SAMPLE_NOISE_N = np.array([2.0, 2.0, 6.0]) * 9.80665e-3
OFFSET_N = np.array([0.3, -0.2, 1.1])
#: Closure of each element that 1 N along each axis makes, over the gap [1].
_PATTERN = np.array([[-0.2, 0.0, 0.2], [-0.2, 0.0, 0.2], [-0.2, 0.0, 0.2]])
CLOSURE_REL = np.stack([-_PATTERN.T.ravel(), -_PATTERN.ravel(), np.full(9, 0.4)])


class SimulatedPress(NamedTuple):
    """One press: when it begins, rise and fall, how long it dwells, and its force."""

    at_s: float
    dwell_s: float
    force_n: tuple[float, float, float]
    rise_s: float = 0.2


def force_profile(*presses: SimulatedPress) -> Callable[[float], Vector]:
    """Return the force over time of some presses."""

    def force_n(t_s: float) -> Vector:
        total = np.zeros(3)
        for press in presses:
            since_s = t_s - press.at_s
            edge = min(since_s, 2 * press.rise_s + press.dwell_s - since_s) / press.rise_s
            total += min(max(edge, 0.0), 1.0) * np.array(press.force_n)
        return total

    return force_n


def direction(azimuth_deg: float, elevation_deg: float) -> Vector:
    """Return the unit vector of the paper's angles."""
    azimuth, elevation = math.radians(azimuth_deg), math.radians(elevation_deg)
    across = math.cos(elevation)
    return np.array([across * math.cos(azimuth), across * math.sin(azimuth), math.sin(elevation)])


def cycles(
    force_n: Callable[[float], Vector],
    until_s: float,
    *,
    drift_pf_per_s: float = 0.0,
    saturated: Callable[[float], bool] = lambda _: False,
    missing: Callable[[float], bool] = lambda _: False,
    reading: Callable[[float], Reading] = lambda _: Reading.OK,
    reading_n: Callable[[Vector], Vector] = lambda force_n: force_n,
    scan_ns: int = SCAN_NS,
) -> Iterator[Cycle]:
    """Yield the cycles of one leg that is pressed so.

    Args:
        force_n: Force on the foot over time [s].
        until_s: When it ends [s].
        drift_pf_per_s: Of every element.
        saturated: When the sensor is at its end.
        missing: When its samples do not arrive.
        reading: How element 4 answers.
        reading_n: Reading of the sensor under a force.
        scan_ns: How long a scan takes.
    """
    random = np.random.default_rng(5)
    t_sample_ns = 1_000_000_000
    for number in range(int(until_s * 1e9 / scan_ns)):
        t_ns = 1_000_000_000 + (number + 1) * scan_ns
        t_s = t_ns * 1e-9 - 1.0
        closure_um = force_n(t_s - 0.5e-9 * scan_ns) @ CLOSURE_REL * DESIGN.gap_um
        capacitance_pf = DESIGN.capacitance_pf(closure_um) + drift_pf_per_s * t_s
        capacitance_pf += random.normal(0.0, NOISE_FF * 1e-3, 9)
        answers = np.zeros((1, 9), np.uint8)
        answers[0, 4] = reading(t_s)
        stamps = t_ns - scan_ns + np.arange(1, 10) * (scan_ns // 9)
        scan = CapFrame(number, stamps[None], np.where(answers > 0, np.nan, capacitance_pf[None]), answers)
        samples = []
        while t_sample_ns <= t_ns:
            if not missing(sample_s := t_sample_ns * 1e-9 - 1.0):
                noisy_n = reading_n(force_n(sample_s)) + OFFSET_N + random.normal(0.0, SAMPLE_NOISE_N)
                samples.append((t_sample_ns, noisy_n, saturated(sample_s)))
            t_sample_ns += SAMPLE_NS
        given: dict[str, Any] = {"t_ns": t_ns, "force_n": force_n(t_s - 0.5e-9 * scan_ns), "sigma_n": 0.001}
        forces = contact_frame(t_ns + 1_000_000, sequence=number, **given)
        yield Cycle(scan, (), forces, (), _reference(samples))


def _reference(samples: list[tuple[int, Vector, bool]]) -> ReferenceSamples:
    return ReferenceSamples(
        np.array([t_ns for t_ns, _, _ in samples], np.int64),
        np.array([force_n for _, force_n, _ in samples]).reshape(-1, 3),
        np.array([saturated for _, _, saturated in samples], np.bool_),
    )
