"""Inertial load of the foot's outer half while the leg swings: a small force on the sensor without contact.

The half below the sheet of elements hangs on it. A leg that swings forward accelerates and brakes it, and every step of
another leg makes it tremble:

    f(t) = -m (a_swing(t) + a_tremor(t))
"""

import numpy as np

from footsense.frames import Vector

#: Mass of the outer rubber half: a half ball of 10 mm radius, 1.1 g/cm3 [kg].
OUTER_HALF_KG = 2.3e-3
#: Largest acceleration of a swing, of each gait, along the leg and across it [m/s2].
_MAX_SWING_ACCELERATION_ALONG_AND_ACROSS_M_S2 = (4.0, 7.0)
#: Tremor: acceleration [m/s2], frequency [Hz], decay [s] and mean time between two [s].
_TREMOR_M_S2, _TREMOR_HZ, _DECAY_S, _BETWEEN_S = 2.0, (15.0, 60.0), 0.03, 0.2


class SwingShake:
    """Inertial force on the sensor of one foot in all swings of a gait: swing acceleration and tremor.

    Args:
        rng: Source of the draws.
        duration_s: Duration of the gait [s].
    """

    def __init__(self, rng: np.random.Generator, duration_s: float) -> None:
        along, across = (rng.uniform(0.0, most) for most in _MAX_SWING_ACCELERATION_ALONG_AND_ACROSS_M_S2)
        around = rng.uniform(0.0, 2.0 * np.pi)
        self._swing_m_s2 = np.array([across * np.cos(around), across * np.sin(around), along])
        n = rng.poisson(duration_s / _BETWEEN_S)
        self._at_s = np.sort(rng.uniform(0.0, duration_s, n))
        self._rate = 2.0 * np.pi * rng.uniform(*_TREMOR_HZ, n)
        self._tremor_m_s2 = _TREMOR_M_S2 * rng.normal(size=(n, 3))

    def force_n(self, t_s: Vector, swing_rel: Vector) -> Vector:
        """Return the inertial force on the sensor at n times [N], shape (n, 3); zero in stance.

        Args:
            t_s: Times [s], shape (n,).
            swing_rel: How much of the swing is over, 0 to 1, shape (n,); NaN in stance, which has no shake.
        """
        swinging = np.isfinite(swing_rel)
        turn = 2.0 * np.pi * np.where(swinging, swing_rel, 0.0)
        acceleration = np.outer(np.sin(turn), self._swing_m_s2)
        for at_s, rate, size in zip(self._at_s, self._rate, self._tremor_m_s2, strict=True):
            since_s = t_s - at_s
            near = (since_s > 0.0) & (since_s < 8.0 * _DECAY_S)
            shape = np.exp(-since_s[near] / _DECAY_S) * np.sin(rate * since_s[near])
            acceleration[near] += np.outer(shape, size)
        return np.asarray(-OUTER_HALF_KG * acceleration * swinging[:, None], np.float64)
