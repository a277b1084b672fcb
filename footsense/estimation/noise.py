"""Noise of the readings of each leg while the robot runs.

Loads move the closures of a foot along few patterns: along the four directions in which its loads vary
least, almost only noise is left, as long as the load stands still. Two things are measured there. The second
difference of an element's last three readings holds fast noise. What its newest reading differs from the mean of 20 of
them (one in nine frames: half a second where a frame has one new reading, 1.2 s of scans of 6.9 ms) holds slow noise as
well, such as a ripple of the load near the rate of a scan: each element reads nearly the same phase of it again and
again, and nine phases fit no load. It holds a part: with 20 mN of 38 to 44 Hz on 0.5 N, 69 to 95 % of the errors of
scans of 25 ms are within 2 sigma.

In motion the elements are read under different loads, and no pattern fits either. So a measurement counts only where
the differences along the other five directions are as small as those of noise, for slow noise all that time, and the
noise is the median of those that count among the last 20, of at least 6: of noise two in five count, of the impacts and
the shaking swings of walking robots one in a hundred. Motion only adds to what is measured, whether it counts or not,
so the noise is never above the lower quartile of the last 20. A leg that never rests keeps the noise
that it had before, up to that.

Each leg has one variance. Where the noise is on one element, row or column alone (20 fF, in a tripod gait), at least
99 % of the errors are within 2 sigma all the same.

Noise comes faster than it goes: a burst in each step is held over the steps.
"""

import math
from collections import deque

import numpy as np

from footsense.foot.contact_coordinates import COORDINATES
from footsense.frames import ELEMENTS, Mask, Vector

#: Directions of least variation along which noise is measured: as many as a load leaves.
_N_DIRECTIONS = ELEMENTS - COORDINATES
#: Mean square of the first differences along a direction of the loads, over the noise's variance, below which the load
#: does not move [1]; that of noise is 2.
_MOTION_LIMIT_REL2 = 2.0
#: Slow noise is measured once in so many measurements.
_PER_SLOW = 3
#: Values that give a standard deviation to a sixth: so many last measurements, readings of the mean that slow noise
#: differs from.
NOISE_SAMPLES = 20
#: Measurements that have to count, and those over which noise fades: twice the time of the last of slow noise.
_LEAST, _FADING = NOISE_SAMPLES // 3, 2 * _PER_SLOW * NOISE_SAMPLES
#: Factor that gives a second difference of white noise the variance of the noise.
_SECOND_TO_NOISE = (1 + 2**2 + 1) ** -0.5
#: Median over the lower quartile of measurements of white noise [1]: chi-square of four degrees of freedom.
_MEDIAN_OVER_QUARTILE = 1.75


class ReadingNoise:
    """Running estimate of the noise of each leg's closures.

    Args:
        n_legs: Legs of a frame.
        moments: Second moments of the closures of the loads of a foot, shape (elements, elements).

    Attributes:
        variance_rel: Variance of a reading's closure over the gap of each leg [1].
    """

    def __init__(self, n_legs: int, moments: Vector) -> None:
        _, directions = np.linalg.eigh(moments)
        self._noise_directions = directions[:, :_N_DIRECTIONS] / math.sqrt(_N_DIRECTIONS)
        self._load_directions = directions[:, _N_DIRECTIONS:] / math.sqrt(len(moments) - _N_DIRECTIONS)
        self._fast, self._slow = _Measurements(n_legs), _Measurements(n_legs)
        self._past_rel = np.full((NOISE_SAMPLES, n_legs, len(moments)), np.nan)
        self._stepped_rel = np.zeros((NOISE_SAMPLES, n_legs))
        self._n = 0
        self.variance_rel = [0.0] * n_legs

    def observe(self, plate_distance_rel: Vector) -> None:
        """Measure the noise of the last three readings of each element, newest first [1], shape (3, legs, elements).

        A leg without three readings of every element keeps its noise.
        """
        steps = plate_distance_rel[:2] - plate_distance_rel[1:]
        # Of white noise of variance 1, second differences have the variance 6.
        fast_rel = _mean_square(_SECOND_TO_NOISE * (steps[0] - steps[1]), self._noise_directions)
        stepped_rel = np.maximum(*_mean_square(steps, self._load_directions))
        self._fast.add(fast_rel, stepped_rel, _is_spread(steps.swapaxes(0, 1).reshape(len(fast_rel), -1)))
        if self._n % _PER_SLOW == 0:
            self._observe_slow(plate_distance_rel[0], stepped_rel)
        self._n += 1
        for leg, recent_rel in enumerate(map(max, self._fast.noise_rel, self._slow.noise_rel)):
            held_rel = self.variance_rel[leg]
            self.variance_rel[leg] = max(recent_rel, held_rel + (recent_rel - held_rel) / _FADING)

    def _observe_slow(self, newest_rel: Vector, stepped_rel: Vector) -> None:
        turn = self._n // _PER_SLOW % NOISE_SAMPLES
        self._past_rel[turn], self._stepped_rel[turn] = newest_rel, stepped_rel
        off = newest_rel - np.add.reduce(self._past_rel) / NOISE_SAMPLES
        slow_rel = _mean_square(off, self._noise_directions)
        # A reading has half the variance of a first difference.
        off_rel = 2.0 * _mean_square(off, self._load_directions)
        moved_rel = np.maximum(off_rel, np.maximum.reduce(self._stepped_rel))
        self._slow.add(slow_rel, moved_rel, _is_spread(off))


class _Measurements:
    """Last measurements of the noise of each leg; `noise_rel` is the variance that follows from them [1]."""

    def __init__(self, n_legs: int) -> None:
        # Of each leg, those that count, else infinite, and all.
        none = [math.inf] * NOISE_SAMPLES
        self._measured_rel = [(deque(none, NOISE_SAMPLES), deque(none, NOISE_SAMPLES)) for _ in range(n_legs)]
        self.noise_rel = [0.0] * n_legs

    def add(self, measured_rel: Vector, moved_rel: Vector, is_spread: Mask) -> None:
        # In plain Python numbers: for six legs, arrays take longer.
        of_legs = zip(measured_rel.tolist(), moved_rel.tolist(), is_spread.tolist(), strict=True)
        for leg, (value_rel, moved, spread) in enumerate(of_legs):
            counting_rel, all_rel = self._measured_rel[leg]
            counting_rel.append(value_rel if spread and moved < _MOTION_LIMIT_REL2 * value_rel else math.inf)
            all_rel.append(value_rel if value_rel < math.inf else math.inf)  # a NaN is not sorted
            n = NOISE_SAMPLES - counting_rel.count(math.inf)
            found_rel = sorted(counting_rel)[n // 2] if n >= _LEAST else self.noise_rel[leg]
            most_rel = _MEDIAN_OVER_QUARTILE * sorted(all_rel)[NOISE_SAMPLES // 4]
            self.noise_rel[leg] = min(found_rel, most_rel)


def _mean_square(values: Vector, directions: Vector) -> Vector:
    along = values @ directions
    squares: Vector = np.add.reduce(along * along, axis=-1)
    return squares


def _is_spread(values: Vector) -> Mask:
    squares = values * values
    # An impact of a few milliseconds, which one or two elements see, is no noise, nor is an element that breaks.
    largest: Mask = np.maximum.reduce(squares, axis=1) < 0.5 * np.add.reduce(squares, axis=1)
    return largest
