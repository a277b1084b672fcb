"""Where nine closures stand now, when only one of them is measured at a time.

A Kalman filter for each leg. Its state is the position and the velocity of all nine elements; the velocities wander
and fade, and how they go together is what the loads of a walk have in common: their second moments. So the reading of
one element also moves the others: a foot that is pressed shows it with the first conversion, not after nine.

The readings come in a fixed order at even steps, so the filter's gains do not depend on what is read: they are
computed once, for every element and for every set of missing ones. What remains in the loop is a dozen operations on
all legs at once. How fast the load really moves is learnt from how far the readings lie from what was expected of
them, and the uncertainty of the closures grows and falls with it.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from footsense.estimation.faults.missing_sets import KNOWN_MISSING
from footsense.frames import ELEMENTS

Vector = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: Time in which a velocity fades to 1/e [s], and density of its wandering [1/s3] for an element of mean loading. Over
#: measured and made-up walks, steps and ramps the error is flat around both: half or twice either changes it by less
#: than a tenth.
_FADES_S = 0.06
_WANDERS = 300.0
#: Share of every element's movement that is its own.
_OWN_REL = 1e-3
#: Share of the newest reading in the memory of how fast the load moves: one scan long.
_MEMORY_REL = 1.0 / ELEMENTS
_CYCLES = 24  # scans after which the gains stand still
_POSITIONS, _VELOCITIES = slice(0, ELEMENTS), slice(ELEMENTS, 2 * ELEMENTS)


class _Gains(NamedTuple):
    """The filter, for every set of missing elements (first axis) and every newest element (second axis).

    Attributes:
        gain: What an unexpected reading moves, shape (sets, 9, 18).
        expected: Variance of that reading about what was expected of it, shape (sets, 9).
        position: Covariance of the positions one lead later, shape (sets, 9, 9, 9).
    """

    gain: Vector
    expected: Vector
    position: Vector


class Prediction:
    """The filter of all legs.

    Args:
        n_legs: Legs.
        moments: Second moments of the closures, shape (9, 9); their scale does not matter.
        order: Flat index of the elements in the order of the scan.
        step_s: Time from one element to the next [s].
        lead_s: Usual time from the newest reading to the sending of a force [s].
        noise_rel: Standard deviation of one reading [unit of the values].
    """

    def __init__(
        self,
        n_legs: int,
        moments: Vector,
        order: tuple[int, ...],
        step_s: float,
        lead_s: float,
        noise_rel: float,
    ) -> None:
        self._gains = _gains(moments / np.trace(moments), order, step_s, lead_s, noise_rel**2)
        self._state = np.zeros((n_legs, 2 * ELEMENTS))
        self._t_ns = np.zeros(n_legs, np.int64)
        self._newest = np.zeros(n_legs, np.intp)
        self._speed = np.ones(n_legs)
        self._surprise = np.ones(n_legs)

    @property
    def position_covariance(self) -> Vector:
        """Return the covariance of all positions one lead after a reading, shape (sets, 9, 9, 9), at speed 1."""
        return self._gains.position

    def begin(self, leg: int, values: Vector, t_ns: int) -> None:
        """Let a leg start from nine readings, at rest and with no idea of how fast it moves."""
        self._state[leg, _POSITIONS] = np.where(np.isfinite(values), values, 0.0)
        self._state[leg, _VELOCITIES] = 0.0
        self._t_ns[leg] = t_ns
        self._speed[leg] = self._surprise[leg] = 1.0

    def observe(
        self,
        legs: NDArray[np.intp],
        elements: NDArray[np.intp],
        values: Vector,
        t_ns: NDArray[np.int64],
        sets: NDArray[np.intp],
    ) -> None:
        """Take one new reading of some legs.

        Args:
            legs: Which, each once.
            elements: Element that was read.
            values: Its reading; NaN moves nothing.
            t_ns: Its stamp [ns].
            sets: Which elements each leg lacks, index into `KNOWN_MISSING`.
        """
        state = self._state[legs]
        elapsed_s = np.maximum(t_ns - self._t_ns[legs], 0) * 1e-9
        self._move(state, elapsed_s)
        gain, expected, _ = self._gains
        surprise = values - state[np.arange(len(legs)), elements]
        surprise[~np.isfinite(surprise)] = 0.0
        state += surprise[:, None] * gain[sets, elements]
        self._state[legs] = state
        self._t_ns[legs] = t_ns
        self._newest[legs] = elements
        squared = surprise * surprise / expected[sets, elements]
        self._surprise[legs] = squared
        self._speed[legs] += _MEMORY_REL * (squared - self._speed[legs])

    def observe_all(self, element: int, values: Vector, t_ns: NDArray[np.int64]) -> None:
        """Take one new reading of the same element of all legs, which lack nothing; else as `observe`."""
        state = self._state
        elapsed_s = np.asarray((t_ns - self._t_ns) * 1e-9, np.float64)
        self._move(state, elapsed_s)
        gain, expected, _ = self._gains
        surprise = values - state[:, element]
        state += surprise[:, None] * gain[0, element]
        self._t_ns[:] = t_ns
        self._newest.fill(element)
        self._surprise = surprise * surprise / expected[0, element]
        self._speed += _MEMORY_REL * (self._surprise - self._speed)

    def at(self, now_ns: int) -> Vector:
        """Return the positions of all legs at a time, shape (legs, 9)."""
        ahead_s = np.maximum(now_ns - self._t_ns, 0) * 1e-9
        faded = _FADES_S * -np.expm1(-ahead_s / _FADES_S)
        moved: Vector = self._state[:, _POSITIONS] + faded[:, None] * self._state[:, _VELOCITIES]
        return moved

    def speed(self) -> tuple[Vector, NDArray[np.intp]]:
        """Return by what each leg's covariance is to be multiplied, and its newest element, shape (legs,) each."""
        return np.maximum(self._speed, self._surprise), self._newest

    @staticmethod
    def _move(state: Vector, elapsed_s: Vector) -> None:
        kept = np.exp(-elapsed_s / _FADES_S)[:, None]
        state[:, _POSITIONS] += (_FADES_S * (1.0 - kept)) * state[:, _VELOCITIES]
        state[:, _VELOCITIES] *= kept


def _gains(together: Vector, order: tuple[int, ...], step_s: float, lead_s: float, noise: float) -> _Gains:
    """Return the gains to which the filter settles: Riccati's recursion over some scans, for all sets at once."""
    n_sets, size = len(KNOWN_MISSING), 2 * ELEMENTS
    kept = ~KNOWN_MISSING
    wandering = (together + _OWN_REL * np.eye(ELEMENTS)) * (kept[:, :, None] & kept[:, None, :])
    step, step_noise = _passing(wandering, step_s)
    lead, lead_noise = _passing(wandering, lead_s)
    gain = np.zeros((n_sets, ELEMENTS, size))
    expected = np.ones((n_sets, ELEMENTS))
    position = np.zeros((n_sets, ELEMENTS, ELEMENTS, ELEMENTS))
    covariance = np.zeros((n_sets, size, size))
    covariance[:, _POSITIONS, _POSITIONS] = wandering
    covariance[:, _VELOCITIES, _VELOCITIES] = wandering / step_s
    for _ in range(_CYCLES):
        for element in order:
            covariance = step @ covariance @ step.T + step_noise
            expected[:, element] = covariance[:, element, element] + noise
            gain[:, element] = covariance[:, :, element] / expected[:, element, None]
            covariance = covariance - gain[:, element, :, None] * covariance[:, None, element, :]
            covariance = 0.5 * (covariance + covariance.swapaxes(1, 2))
            later = lead @ covariance @ lead.T + lead_noise
            position[:, element] = later[:, _POSITIONS, _POSITIONS]
    return _Gains(gain, expected, position)


def _passing(wandering: Vector, elapsed_s: float) -> tuple[Vector, Vector]:
    """Return what time does to a state, shape (18, 18), and the covariance that it adds, shape (sets, 18, 18)."""
    kept = np.exp(-elapsed_s / _FADES_S)
    identity = np.eye(ELEMENTS)
    passing = np.block(
        [[identity, _FADES_S * (1.0 - kept) * identity], [np.zeros_like(identity), kept * identity]]
    )
    density = _WANDERS * wandering
    added = np.block(
        [
            [elapsed_s**3 / 3 * density, elapsed_s**2 / 2 * density],
            [elapsed_s**2 / 2 * density, elapsed_s * density],
        ]
    )
    return passing, added
