"""Loads of feet that shake, made up: as those of a robot that a learned policy keeps on its feet.

Of a quadruped of 12 kg under a public learned policy, a quarter of the power of the tangential force in mid-stance lay
above 40 Hz (1 % of an open-loop trot), the contact's normal rolled at 95 to 190 deg/s, and 5 % of the accelerations of
its feet were above 114 m/s2. These have as much, as noise of a band; training shakes by sines
(`training/random_gait.py`).
"""

import numpy as np

from footsense.frames import Vector
from footsense.lab.walkers.robots import GRAVITY_M_S2
from footsense.lab.walkers.simulate import LOG_STEP_S

#: Stride [s] and share of it in stance [1], time of a rise and of a fall [s], load over the peak [1].
_STRIDE_S, _STANCE_REL, _FLANK_S, _LOAD_REL = (0.35, 0.7), (0.45, 0.6), (0.02, 0.06), (0.6, 1.0)
#: Shake of the load [1, rms], and its band [Hz].
_LOAD_SHAKE_REL, _LOAD_HZ = 0.05, (8.0, 80.0)
#: Tangential over normal force along each axis [1, rms], by band [Hz], and the most of it [1].
_RATIOS, _MOST_RATIO = {(0.1, 0.7): 0.06, (2.0, 12.0): 0.008, (30.0, 90.0): 0.007}, 0.6
#: Lean of the contact's normal [deg, rms], rate at which it rolls [deg/s, rms], and band [Hz].
_LEAN_DEG, _ROLL_DEG_PER_S, _ROLL_HZ = 4.0, 140.0, (2.0, 12.0)
#: Acceleration of a foot along each axis in swing [m/s2, rms], and band [Hz].
_SHAKE_M_S2, _SHAKE_HZ = 40.0, (8.0, 60.0)


def shaking_foot(t_s: Vector, rng: np.random.Generator) -> tuple[Vector, Vector, Vector]:
    """Return force, contact normal and acceleration of a foot, each of shape (n, 3)."""
    load_rel = np.zeros_like(t_s)
    start_s = rng.uniform(0.0, _STRIDE_S[1])
    while start_s < t_s[-1]:
        stride_s, flank_s = rng.uniform(*_STRIDE_S), rng.uniform(*_FLANK_S)
        since_s, stance_s = t_s - start_s, stride_s * rng.uniform(*_STANCE_REL)
        stands = np.clip(np.minimum(since_s, stance_s - since_s) / flank_s, 0.0, 1.0)
        load_rel += rng.uniform(*_LOAD_REL) * stands * stands * (3.0 - 2.0 * stands)
        start_s += stride_s
    load_rel *= np.clip(1.0 + _LOAD_SHAKE_REL * _noise(rng, len(t_s), 1, _LOAD_HZ)[:, 0], 0.0, None)
    lean_rad = np.radians(_LEAN_DEG) * rng.normal(size=2) + _rolled_rad(rng, len(t_s))
    upright = np.column_stack([np.tan(lean_rad), np.ones_like(t_s)])
    normal = upright / np.linalg.norm(upright, axis=1, keepdims=True)
    ratio = np.sum([size * _noise(rng, len(t_s), 2, band_hz) for band_hz, size in _RATIOS.items()], axis=0)
    along = -(normal[:, :2] * ratio).sum(axis=1, keepdims=True) / normal[:, 2:]
    tangential = np.hstack([ratio, along])
    size = np.linalg.norm(tangential, axis=1, keepdims=True)
    tangential *= np.minimum(1.0, _MOST_RATIO / np.maximum(size, 1e-9))
    loaded = load_rel[:, None] > 0.0
    acceleration_m_s2 = np.where(loaded, 0.0, _SHAKE_M_S2 * _noise(rng, len(t_s), 3, _SHAKE_HZ))
    acceleration_m_s2[:, 2] += GRAVITY_M_S2
    return (
        load_rel[:, None] * (normal + tangential),
        np.where(loaded, normal, (0.0, 0.0, 1.0)),
        acceleration_m_s2,
    )


def _rolled_rad(rng: np.random.Generator, n: int) -> Vector:
    """Return how far a contact has rolled [rad], shape (n, 2), at a rate of the band's noise."""
    rolled = _noise(rng, n, 2, _ROLL_HZ)
    rate = np.gradient(rolled, LOG_STEP_S, axis=0)
    size: Vector = np.radians(_ROLL_DEG_PER_S) / np.sqrt((rate**2).sum(axis=1).mean())
    return size * rolled


def _noise(rng: np.random.Generator, n: int, n_axes: int, band_hz: tuple[float, float]) -> Vector:
    """Return noise of a band with soft edges, of standard deviation 1, shape (n, n_axes)."""
    hertz = np.maximum(np.fft.rfftfreq(n, LOG_STEP_S), 1e-3)[:, None]
    low, high = band_hz
    spectrum = np.fft.rfft(rng.normal(size=(n, n_axes)), axis=0)
    spectrum /= np.sqrt((1.0 + (low / hertz) ** 6) * (1.0 + (hertz / high) ** 6))
    made = np.fft.irfft(spectrum, n, axis=0)
    unit: Vector = made / made.std(axis=0)
    return unit
