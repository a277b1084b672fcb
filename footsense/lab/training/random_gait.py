"""Random stances of one foot, for training and test loads of the windowed network.

A stance is a normal force over time, a contact point that wanders over the ball, and friction at that point:

    f = s(t) (n(t) + m(t)),    n from the lean angles of the contact,    m perpendicular to n, |m| at most the friction

s rises and falls in 5 to 150 ms and has, at random, an impact peak, one or two humps, slow oscillations and sudden
steps; its peak is anything from a light touch to the foot's full load. The contact leans up to 20 deg and rolls over
the ball. One stance in five stands still but for noise of the load. The stances are shaped on no recorded gait, so
that recorded ones can judge.
"""

from typing import NamedTuple

import numpy as np

from footsense.foot.specimen import ContactLoads
from footsense.frames import Vector

#: Duration of a stance, and of its rise and its fall [s]: bounds of draws that are uniform in the logarithm.
STANCE_S, FLANK_S = (0.06, 2.0), (0.005, 0.15)
#: Time in the air between two stances [s].
SWING_DURATION_RANGE_S = (0.04, 0.4)
#: Peak of the normal force, usual and of a light touch, over the foot's full load [1].
_PEAK_REL, _LIGHT_REL = (0.03, 0.6), (0.005, 0.1)
#: Largest lean of the contact's normal, usual and of one stance in three [deg], and largest lean with all motion [deg].
_LEAN_DEG, _STEEP_DEG, _LARGEST_LEAN_DEG = 15.0, 26.0, 50.0
#: Largest tangential over normal force [1].
MAX_FRICTION_REL = 0.65
#: A stance that shakes: deviation of the load [1] and of the friction ratio [1], rate at which the contact rolls
#: [deg/s], and bands of the three [Hz], as of a robot under a learned policy.
_LOAD_SHAKE_REL, _SHEAR_SHAKE_REL, _ROLL_DEG_PER_S = (0.02, 0.12), (0.02, 0.1), (50.0, 200.0)
_LOAD_SHAKE_HZ, _SHEAR_SHAKE_HZ, _ROLL_HZ = (10.0, 80.0), (15.0, 90.0), (5.0, 40.0)


class _SuddenChange(NamedTuple):
    """A sudden change: start and duration [s], relative change of the load [1], change of the friction ratio [1]."""

    start_s: float
    duration_s: float
    load_change_rel: float
    tangential_ratio_change: Vector


class _Oscillation(NamedTuple):
    """A sum of sines: amplitude, angular frequency [rad/s] and phase [rad], shape (..., k) each."""

    amplitude: Vector
    angular_frequency_rad_per_s: Vector
    phase_rad: Vector

    def at(self, t_s: Vector) -> Vector:
        """Return the sum of the sines at n times [s], shape (n, ...)."""
        turns = np.multiply.outer(t_s, self.angular_frequency_rad_per_s) + self.phase_rad
        total: Vector = (self.amplitude * np.sin(turns)).sum(axis=-1)
        return total


def _draw_oscillation(
    rng: np.random.Generator, size: float, hertz: tuple[float, float], shape: tuple[int, ...]
) -> _Oscillation:
    """Return a random sum of sines: amplitudes of rms `size`, frequencies log-uniform within a band [Hz]."""
    rate = 2.0 * np.pi * _log_uniform(rng, hertz, shape)
    amplitude = size * rng.normal(size=shape)
    return _Oscillation(amplitude, rate, rng.uniform(0.0, 2.0 * np.pi, shape))


def _log_uniform(
    rng: np.random.Generator, bounds: tuple[float, float], size: tuple[int, ...] | None = None
) -> Vector:
    """Return random values between two bounds, uniform in their logarithm."""
    return np.exp(rng.uniform(np.log(bounds[0]), np.log(bounds[1]), size))


def _smooth_step(x: Vector) -> Vector:
    """Return a cosine-shaped step that rises from 0 at x = 0 to 1 at x = 1."""
    return 0.5 - 0.5 * np.cos(np.pi * np.clip(x, 0.0, 1.0))


class RandomStance:
    """Random load of one foot over one stance, drawn at construction.

    Args:
        rng: Source of the draws.
        max_n: Full load of the foot [N].
        shaking_share: Probability that the load shakes [1].

    Attributes:
        duration_s: Time from touchdown to lift-off [s].
    """

    def __init__(self, rng: np.random.Generator, max_n: float, shaking_share: float = 0.0) -> None:
        self.duration_s = float(_log_uniform(rng, STANCE_S))
        longest = 0.48 * self.duration_s
        self._rise_s, self._fall_s = (min(float(_log_uniform(rng, FLANK_S)), longest) for _ in range(2))
        self._kind = rng.integers(3)
        peak = rng.uniform(*_PEAK_REL) if rng.random() < 0.85 else _log_uniform(rng, _LIGHT_REL)
        self._peak_n = max_n * float(peak)
        self._max_n = max_n
        still = rng.random() < 0.2
        self._hump, self._n_humps = rng.uniform(-0.1, 0.4) * (rng.random() < 0.6), rng.integers(1, 3)
        self._wave = _draw_oscillation(rng, 0.06 * (rng.random() < 0.6), (0.5, 15.0), (3,))
        impact = rng.uniform(0.0, 0.5) * (rng.random() < 0.4)
        self._impact = impact, rng.uniform(0.01, 0.05), rng.uniform(0.006, 0.02)
        self._load_steps = self._sudden_changes(rng, 0.3)
        around = rng.uniform(0.0, 2.0 * np.pi)
        lean = np.radians(rng.uniform(0.0, _LEAN_DEG if rng.random() < 0.65 else _STEEP_DEG))
        self._lean = lean * np.array([np.cos(around), np.sin(around)])
        self._roll = rng.uniform(0.0, 1.0) * (rng.random() < 0.7)
        self._off = np.radians(3.0) * rng.normal(size=2) * (rng.random() < 0.8)
        self._wander = _draw_oscillation(rng, np.radians(1.0) * (rng.random() < 0.6), (0.2, 5.0), (2, 2))
        self._friction = 0.1 * rng.normal(size=2) * (rng.random() < 0.75)
        self._shear = _draw_oscillation(rng, 0.0 if still else 0.07, (0.4, 12.0), (2, 3))
        self._shear_steps = self._sudden_changes(rng, 0.0 if still else 0.3)
        shaking = shaking_share > 0.0 and rng.random() < shaking_share
        load, shear, roll = (
            rng.uniform(*sizes) / 2.0 if shaking else 0.0
            for sizes in (_LOAD_SHAKE_REL, _SHEAR_SHAKE_REL, _ROLL_DEG_PER_S)
        )
        self._load_shake = _draw_oscillation(rng, load, _LOAD_SHAKE_HZ, (4,))
        self._shear_shake = _draw_oscillation(rng, shear, _SHEAR_SHAKE_HZ, (2, 4))
        rate = _draw_oscillation(rng, np.radians(roll), _ROLL_HZ, (2, 4))
        self._roll_shake = rate._replace(  # its integral over time
            amplitude=rate.amplitude / rate.angular_frequency_rad_per_s,
            phase_rad=rate.phase_rad - 0.5 * np.pi,
        )

    def _sudden_changes(self, rng: np.random.Generator, probability: float) -> list[_SuddenChange]:
        """Return random sudden changes of the load, often none."""
        if rng.random() >= probability:
            return []
        return [
            _SuddenChange(
                start_s=rng.uniform(0.0, self.duration_s),
                duration_s=rng.uniform(0.005, 0.04),
                load_change_rel=rng.uniform(-0.5, 0.4),
                tangential_ratio_change=0.15 * rng.normal(size=2),
            )
            for _ in range(rng.integers(1, 3))
        ]

    def loads(self, t_s: Vector) -> ContactLoads:
        """Return the loads at n times since touchdown [s]."""
        normal = _normals(self._lean_rad_at(t_s))
        shear = self._tangential_ratio_at(t_s)
        # Tangential to the ball: sideways as drawn, and along z what keeps it perpendicular to the normal.
        along = -(normal[:, :2] * shear).sum(axis=1, keepdims=True) / normal[:, 2:]
        tangential = np.hstack([shear, along])
        length = np.linalg.norm(tangential, axis=1, keepdims=True)
        tangential *= np.minimum(1.0, MAX_FRICTION_REL / np.maximum(length, 1e-9))
        return ContactLoads(normal, self._normal_force_n(t_s)[:, None] * (normal + tangential))

    def _normal_force_n(self, t_s: Vector) -> Vector:
        """Return the normal force at n times since touchdown [N]."""
        rise, fall = t_s / self._rise_s, (self.duration_s - t_s) / self._fall_s
        if self._kind == 0:
            envelope = _smooth_step(rise) * _smooth_step(fall)
        elif self._kind == 1:
            envelope = np.clip(rise, 0.0, 1.0) * np.clip(fall, 0.0, 1.0)
        else:
            envelope = np.sqrt(_smooth_step(rise) * _smooth_step(fall) * np.clip(rise, 0.0, 1.0))
        shape = 1.0 - self._hump * np.sin(np.pi * self._n_humps * t_s / self.duration_s) ** 2
        size, at_s, width_s = self._impact
        shape *= 1.0 + self._wave.at(t_s) + self._load_shake.at(t_s)
        shape *= 1.0 + size * np.exp(-0.5 * ((t_s - at_s) / width_s) ** 2)
        for step in self._load_steps:
            shape *= 1.0 + step.load_change_rel * _smooth_step((t_s - step.start_s) / step.duration_s)
        pressing = np.clip(self._peak_n * envelope * shape, 0.0, self._max_n)
        return np.where((t_s >= 0.0) & (t_s < self.duration_s), pressing, 0.0)

    def _lean_rad_at(self, t_s: Vector) -> Vector:
        """Return the lean of the contact normal at n times, forward and to the left [rad], shape (n, 2)."""
        rolled = 1.0 - 2.0 * self._roll * t_s / self.duration_s
        lean = self._lean * rolled[:, None] + self._off + self._wander.at(t_s) + self._roll_shake.at(t_s)
        size = np.linalg.norm(lean, axis=1, keepdims=True)
        limited: Vector = lean * np.minimum(1.0, np.radians(_LARGEST_LEAN_DEG) / np.maximum(size, 1e-9))
        return limited

    def _tangential_ratio_at(self, t_s: Vector) -> Vector:
        """Return the ratio of tangential to normal force, forward and to the left [1], shape (n, 2)."""
        shear = self._friction + self._shear.at(t_s) + self._shear_shake.at(t_s)
        for step in self._shear_steps:
            shear = shear + np.multiply.outer(
                _smooth_step((t_s - step.start_s) / step.duration_s), step.tangential_ratio_change
            )
        return shear


def _normals(lean: Vector) -> Vector:
    """Return the unit normals, shape (n, 3), that lean forward and to the left by angles [rad], shape (n, 2)."""
    angle = np.linalg.norm(lean, axis=1, keepdims=True)
    return np.hstack([lean * np.sinc(angle / np.pi), np.cos(angle)])


class RandomGait:
    """Random stances of one foot in sequence, with swings between them.

    Args:
        rng: Source of the draws.
        max_n: Full load of the foot [N].
        duration_s: Time to fill with stances [s].
        shaking_share: Probability of each stance that its load shakes [1].
    """

    def __init__(
        self, rng: np.random.Generator, max_n: float, duration_s: float, shaking_share: float = 0.0
    ) -> None:
        self._stances: list[tuple[float, RandomStance]] = []
        start_s = rng.uniform(0.1, 0.25)
        while start_s < duration_s:
            stance = RandomStance(rng, max_n, shaking_share)
            self._stances.append((start_s, stance))
            start_s += stance.duration_s + rng.uniform(*SWING_DURATION_RANGE_S)

    def loads(self, t_s: Vector) -> ContactLoads:
        """Return the loads at n times [s]; in swing the normal points up and the force is zero."""
        normal = np.tile([0.0, 0.0, 1.0], (len(t_s), 1))
        force_n = np.zeros((len(t_s), 3))
        for start_s, stance in self._stances:
            on = (t_s >= start_s) & (t_s < start_s + stance.duration_s)
            if on.any():
                normal[on], force_n[on] = stance.loads(t_s[on] - start_s)
        return ContactLoads(normal, force_n)
