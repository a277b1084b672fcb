"""Noise while the robot runs: of the readings of each leg, and of a load in swing, from which contact follows.

**Readings.** Loads move the closures of a foot along few patterns: along the four directions in which its loads vary
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
so the noise is never above what the lower quartile of all the last 20 tells. A leg that never rests keeps the noise
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
#: Largest share of one difference in the sum of the squares of all [1]: an impact of a few milliseconds, which one or
#: two elements see, is no noise, nor is an element that breaks.
_LARGEST_STEP_SHARE = 0.33
#: Slow noise is measured once in so many measurements.
_PER_SLOW = 3
#: Values that tell a standard deviation to a sixth: so many last measurements, readings of the mean that slow noise
#: differs from, and peaks.
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
        variance_rel: Variance of a reading's closure over the gap [1], shape (legs,).
    """

    def __init__(self, n_legs: int, moments: Vector) -> None:
        _, directions = np.linalg.eigh(moments)
        self._noise_directions = directions[:, :_N_DIRECTIONS] / math.sqrt(_N_DIRECTIONS)
        self._load_directions = directions[:, _N_DIRECTIONS:] / math.sqrt(len(moments) - _N_DIRECTIONS)
        self._fast, self._slow = _Measurements(n_legs), _Measurements(n_legs)
        self._past_rel = np.full((NOISE_SAMPLES, n_legs, len(moments)), np.nan)
        self._stepped_rel = np.zeros((NOISE_SAMPLES, n_legs))
        self._n = 0
        self.variance_rel = np.zeros(n_legs)

    def observe(self, plate_distance_rel: Vector) -> None:
        """Measure the noise of the last three readings of each element, newest first [1], shape (legs, 3, elements).

        A leg without three readings of every element keeps its noise.
        """
        steps = plate_distance_rel[:, :2] - plate_distance_rel[:, 1:]
        # Of white noise of variance 1, second differences have the variance 6.
        fast_rel = _mean_square(_SECOND_TO_NOISE * (steps[:, 0] - steps[:, 1]), self._noise_directions)
        stepped_rel = _mean_square(steps, self._load_directions).max(axis=1)
        self._fast.add(fast_rel, _is_spread(steps) & (stepped_rel < _MOTION_LIMIT_REL2 * fast_rel))
        if self._n % _PER_SLOW == 0:
            self._observe_slow(plate_distance_rel[:, 0], stepped_rel)
        self._n += 1
        recent, held = np.maximum(self._fast.noise_rel, self._slow.noise_rel), self.variance_rel
        self.variance_rel = np.maximum(recent, held + (recent - held) / _FADING)

    def _observe_slow(self, newest_rel: Vector, stepped_rel: Vector) -> None:
        turn = self._n // _PER_SLOW % NOISE_SAMPLES
        self._past_rel[turn], self._stepped_rel[turn] = newest_rel, stepped_rel
        off = newest_rel - self._past_rel.mean(axis=0)
        slow_rel = _mean_square(off, self._noise_directions)
        # A reading has half the variance of a first difference.
        off_rel = 2.0 * _mean_square(off, self._load_directions)
        moved_rel = np.maximum(off_rel, self._stepped_rel.max(axis=0))
        self._slow.add(slow_rel, _is_spread(off) & (moved_rel < _MOTION_LIMIT_REL2 * slow_rel))


class _Measurements:
    """Last measurements of the noise of each leg; `noise_rel` is the variance that follows from them [1]."""

    def __init__(self, n_legs: int) -> None:
        # Those that count, else infinite, and all.
        self._counting_rel, self._all_rel = np.full((2, n_legs, NOISE_SAMPLES), np.inf)
        self._turn, self._legs = 0, np.arange(n_legs)
        self.noise_rel = np.zeros(n_legs)

    def add(self, measured_rel: Vector, counts: Mask) -> None:
        counting_rel, all_rel = self._counting_rel, self._all_rel
        counting_rel[:, self._turn] = np.where(counts, measured_rel, np.inf)
        all_rel[:, self._turn] = measured_rel
        self._turn = (self._turn + 1) % NOISE_SAMPLES
        n_counting = np.add.reduce(counting_rel < np.inf, axis=1)
        median_rel = np.sort(counting_rel, axis=1)[self._legs, n_counting // 2]
        found_rel = np.where(n_counting >= _LEAST, median_rel, self.noise_rel)
        # A NaN is sorted to the end.
        quartile_rel = np.sort(all_rel, axis=1)[:, NOISE_SAMPLES // 4]
        self.noise_rel = np.fmin(found_rel, _MEDIAN_OVER_QUARTILE * quartile_rel)


def _mean_square(values: Vector, directions: Vector) -> Vector:
    along = values @ directions
    squares: Vector = np.add.reduce(along * along, axis=-1)
    return squares


def _is_spread(values: Vector) -> Mask:
    squares = (values * values).reshape(len(values), -1)
    largest: Mask = squares.max(axis=1) < _LARGEST_STEP_SHARE * np.add.reduce(squares, axis=1)
    return largest


#: Length of a block: about a scan [ns].
_PEAK_BLOCK_NS = 25_000_000
#: Blocks that wait at least, as the rise of a slow touchdown is not noise, and in which shake has to come back.
_HELD_BACK_BLOCKS, _MAX_SHAKE_BLOCKS = 2, 12
#: Share of the threshold below which the signal has come back [1].
_RETURN_THRESHOLD_REL = 1 / 3
#: Blocks over which peaks are averaged; the measured threshold applies after `NOISE_SAMPLES` of them.
_AVERAGED_BLOCKS = 400.0
#: Standard deviations of the peaks above their mean; the same at most, however high one peak was.
THRESHOLD_SIGMAS, _MAX_THRESHOLD_SIGMAS = 5.0, 9.0
#: Highest peak: part that is forgotten in each block, and margin above it [1].
_PEAK_DECAY_REL, _PEAK_MARGIN_REL = 0.0005, 1.2


class SwingNoise:
    """Noise of one load signal of one leg in swing, learnt from the signal's peaks.

    The peaks of short blocks of swing are kept, but for the blocks just before a touchdown, which may hold its rise,
    and for those from which the signal does not come back: shake passes, a load that comes slowly stays. The threshold
    is the mean peak and five of their standard deviations, or a little over the highest peak of the last minutes.

    Args:
        least_n: Least threshold [N].

    Attributes:
        contact_n: Load above that in swing that noise and shake do not reach [N]; infinite until enough was seen.
        sigma_n: Half of the distance from nothing to the mean peak: about the noise of a reading [N].
        shake_n: Mean peak [N]: how much the foot's own mass pulls.
        block_n: Signal of the present block of swing below its threshold [N].
        end_ns: Time from which the block is complete, and `end_block` is to be called [ns].
    """

    def __init__(self, least_n: float) -> None:
        self.contact_n, self._least_n = math.inf, least_n
        self.sigma_n = least_n / THRESHOLD_SIGMAS
        self._n = 0
        self.shake_n = self._variance_n2 = self._highest_n = 0.0
        self.discard_pending(0)

    def discard_pending(self, t_ns: int) -> None:
        """Discard peaks not learnt yet, because of a contact or a new swing from `t_ns` [ns] on."""
        self._waiting: deque[float] = deque(maxlen=_MAX_SHAKE_BLOCKS)
        self.block_n: list[float] = []
        self.end_ns = t_ns + _PEAK_BLOCK_NS

    def end_block(self, t_ns: int, touch_n: float) -> None:
        """End the present block of swing at `t_ns` [ns], and learn the peaks of earlier ones.

        Args:
            t_ns: Current time [ns].
            touch_n: Present threshold of the signal [N].
        """
        known_n, waiting = self.block_n, self._waiting
        self.block_n, self.end_ns = [], t_ns + _PEAK_BLOCK_NS
        is_back = min(known_n, default=math.inf) < _RETURN_THRESHOLD_REL * touch_n
        if known_n:
            waiting.append(max(*known_n, 0.0))
        while is_back and len(waiting) > _HELD_BACK_BLOCKS:
            self.add_peak(waiting.popleft())

    def add_peak(self, peak_n: float) -> None:
        """Update the threshold with the peak load [N] of one block of swing."""
        self._n += 1
        share = 1.0 / min(self._n, _AVERAGED_BLOCKS)
        off_n = peak_n - self.shake_n
        self.shake_n += share * off_n
        self._variance_n2 += share * (off_n * (peak_n - self.shake_n) - self._variance_n2)
        self._highest_n = max(peak_n, (1.0 - _PEAK_DECAY_REL) * self._highest_n)
        if self._n >= NOISE_SAMPLES:
            spread_n = math.sqrt(max(self._variance_n2, 0.0))
            highest_n = min(
                _PEAK_MARGIN_REL * self._highest_n, self.shake_n + _MAX_THRESHOLD_SIGMAS * spread_n
            )
            self.contact_n = max(self.shake_n + THRESHOLD_SIGMAS * spread_n, highest_n, self._least_n)
            self.sigma_n = max(self.contact_n - self.shake_n, self._least_n) / THRESHOLD_SIGMAS
