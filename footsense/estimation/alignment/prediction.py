"""Kalman filter of each leg: predicts nine closures from one measured element at a time.

The state is the position and the velocity of all nine elements. The velocities are a random walk that decays, with the
covariance of the loads of a walk, their second moments. So the reading of one element also moves the others, and a
touchdown shows with the first conversion, not after nine.

The readings come in a fixed order at even steps, so the gains do not depend on the readings: they are computed once,
for every element and every set of missing ones. What remains in the loop is a dozen operations on all legs at once. The
speed of the load is estimated from the squared innovations, and scales the covariance.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from footsense.estimation.faults.missing_sets import MISSING_SETS
from footsense.frames import ELEMENTS, Stamps, Vector

#: Time in which a velocity decays to 1/e [s], and spectral density of its random walk [1/s3] for an element of mean
#: loading. Over measured and made-up walks, steps and ramps the error is flat around both: half or twice either changes
#: it by less than a tenth.
_DECAY_S = 0.06
_DENSITY = 300.0
#: Share of every element's movement that is independent of the others [1].
_OWN_REL = 1e-3
#: Share of the newest reading in the estimated speed of the load [1]: an average over one scan.
_NEWEST_REL = 1.0 / ELEMENTS
_CYCLES = 24  # scans after which the gains have converged
_POSITIONS, _VELOCITIES = slice(0, ELEMENTS), slice(ELEMENTS, 2 * ELEMENTS)


class _Gains(NamedTuple):
    """Kalman gains for every set of missing elements (first axis) and every newest element (second axis).

    Attributes:
        gain: Change of the state per innovation, shape (sets, 9, 18).
        expected: Variance of the innovation, shape (sets, 9).
        position: Covariance of the positions one lead later, shape (sets, 9, 9, 9).
    """

    gain: Vector
    expected: Vector
    position: Vector


class Prediction:
    """Kalman filters of all legs, updated with one element each.

    Args:
        n_legs: Legs.
        closure_moments: Second moments of the closures, shape (9, 9); their scale does not matter.
        scan_order: Flat index of the elements in the order of the scan.
        step_s: Time from one element to the next [s].
        lead_s: Usual time from the newest reading to sending the force [s].
        noise_rel: Standard deviation of one reading [unit of the values].
    """

    def __init__(
        self,
        n_legs: int,
        closure_moments: Vector,
        scan_order: tuple[int, ...],
        step_s: float,
        lead_s: float,
        noise_rel: float,
    ) -> None:
        self._gains = _converged_kalman_gains(
            closure_moments / np.trace(closure_moments), scan_order, step_s, lead_s, noise_rel**2
        )
        self._state = np.zeros((n_legs, 2 * ELEMENTS))
        self._t_ns = np.zeros(n_legs, np.int64)
        self._newest = np.zeros(n_legs, np.intp)
        self._speed = np.ones(n_legs)
        self._innovation2 = np.ones(n_legs)

    @property
    def position_covariance(self) -> Vector:
        """Return the covariance of all positions one lead after a reading, shape (sets, 9, 9, 9), at speed 1."""
        return self._gains.position

    def begin(self, leg: int, values: Vector, t_ns: int) -> None:
        """Start a leg from nine readings, with velocity 0 and speed 1."""
        self._state[leg, _POSITIONS] = np.where(np.isfinite(values), values, 0.0)
        self._state[leg, _VELOCITIES] = 0.0
        self._t_ns[leg] = t_ns
        self._speed[leg] = self._innovation2[leg] = 1.0

    def observe(
        self,
        legs: NDArray[np.intp],
        elements: NDArray[np.intp],
        values: Vector,
        t_ns: Stamps,
        sets: NDArray[np.intp],
    ) -> None:
        """Update some legs with one new reading each.

        Args:
            legs: Their rows, each once.
            elements: Element of each reading.
            values: The readings; NaN changes nothing.
            t_ns: Their stamps [ns].
            sets: Index of each leg's missing elements in `MISSING_SETS`.
        """
        state = self._state[legs]
        elapsed_s = np.maximum(t_ns - self._t_ns[legs], 0) * 1e-9
        self._move(state, elapsed_s)
        gain, expected, _ = self._gains
        innovation = values - state[np.arange(len(legs)), elements]
        innovation[~np.isfinite(innovation)] = 0.0
        state += innovation[:, None] * gain[sets, elements]
        self._state[legs] = state
        self._t_ns[legs] = t_ns
        self._newest[legs] = elements
        squared = innovation * innovation / expected[sets, elements]
        self._innovation2[legs] = squared
        self._speed[legs] += _NEWEST_REL * (squared - self._speed[legs])

    def observe_all(self, element: int, values: Vector, t_ns: Stamps) -> None:
        """Update every leg's state by its reading of one common element, with no reading missing; else as `observe`."""
        state = self._state
        elapsed_s = np.asarray((t_ns - self._t_ns) * 1e-9, np.float64)
        self._move(state, elapsed_s)
        gain, expected, _ = self._gains
        innovation = values - state[:, element]
        state += innovation[:, None] * gain[0, element]
        self._t_ns[:] = t_ns
        self._newest.fill(element)
        self._innovation2 = innovation * innovation / expected[0, element]
        self._speed += _NEWEST_REL * (self._innovation2 - self._speed)

    def at(self, now_ns: int) -> Vector:
        """Return the positions of all legs at a time, shape (legs, 9)."""
        ahead_s = np.maximum(now_ns - self._t_ns, 0) * 1e-9
        integrated = _DECAY_S * -np.expm1(-ahead_s / _DECAY_S)
        moved: Vector = self._state[:, _POSITIONS] + integrated[:, None] * self._state[:, _VELOCITIES]
        return moved

    def speed(self) -> tuple[Vector, NDArray[np.intp]]:
        """Return each leg's covariance factor [1] and the index of its newest element, shape (legs,) each."""
        return np.maximum(self._speed, self._innovation2), self._newest

    @staticmethod
    def _move(state: Vector, elapsed_s: Vector) -> None:
        kept = np.exp(-elapsed_s / _DECAY_S)[:, None]
        state[:, _POSITIONS] += (_DECAY_S * (1.0 - kept)) * state[:, _VELOCITIES]
        state[:, _VELOCITIES] *= kept


def _converged_kalman_gains(
    closure_moments: Vector, scan_order: tuple[int, ...], step_s: float, lead_s: float, noise_variance: float
) -> _Gains:
    """Return the converged gains: the Riccati recursion over some scans, for all sets at once."""
    n_sets, size = len(MISSING_SETS), 2 * ELEMENTS
    kept = ~MISSING_SETS
    share = (closure_moments + _OWN_REL * np.eye(ELEMENTS)) * (kept[:, :, None] & kept[:, None, :])
    step, step_noise = _transition(share, step_s)
    lead, lead_noise = _transition(share, lead_s)
    gain = np.zeros((n_sets, ELEMENTS, size))
    expected = np.ones((n_sets, ELEMENTS))
    position = np.zeros((n_sets, ELEMENTS, ELEMENTS, ELEMENTS))
    covariance = np.zeros((n_sets, size, size))
    covariance[:, _POSITIONS, _POSITIONS] = share
    covariance[:, _VELOCITIES, _VELOCITIES] = share / step_s
    for _ in range(_CYCLES):
        for element in scan_order:
            covariance = step @ covariance @ step.T + step_noise
            expected[:, element] = covariance[:, element, element] + noise_variance
            gain[:, element] = covariance[:, :, element] / expected[:, element, None]
            covariance = covariance - gain[:, element, :, None] * covariance[:, None, element, :]
            covariance = 0.5 * (covariance + covariance.swapaxes(1, 2))
            later = lead @ covariance @ lead.T + lead_noise
            position[:, element] = later[:, _POSITIONS, _POSITIONS]
    return _Gains(gain, expected, position)


def _transition(share: Vector, elapsed_s: float) -> tuple[Vector, Vector]:
    """Return the transition matrix, shape (18, 18), and the process noise, shape (sets, 18, 18), over a time."""
    kept = np.exp(-elapsed_s / _DECAY_S)
    identity = np.eye(ELEMENTS)
    transition = np.block(
        [[identity, _DECAY_S * (1.0 - kept) * identity], [np.zeros_like(identity), kept * identity]]
    )
    density = _DENSITY * share
    noise = np.block(
        [
            [elapsed_s**3 / 3 * density, elapsed_s**2 / 2 * density],
            [elapsed_s**2 / 2 * density, elapsed_s * density],
        ]
    )
    return transition, noise
