"""Noise while the robot runs: of the readings of each leg, and of a load in swing, from which contact follows.

**Readings.** The second difference of an element's last three readings holds its noise and the curvature of its load.
Loads move the closures of a foot along few patterns: along the four directions in which its loads vary least, almost
only noise is left. In fast motion even that little exceeds the noise; a second difference counts only where it is large
against the first differences, as that of noise is. Over walks that leaves the swings, the turns, and the plateaus of
the stances.

Where a foot that rolls begins to lift off, its closures turn while their mean stands still: one measurement then shows
twenty times the noise. So a measurement counts as three times the present noise at most. Noise that stays passes this
limit at once: it rises from 1 fF to 20 fF within 0.2 s. Healthy walks measure 1.0 to 1.8 times the noise of their
converters, up to 2.4 times under the loads of a person, and white noise of 20 fF as 25.

Each leg has one variance. Where the noise is on one element, row or column alone (20 fF, in a tripod gait), at least
99 % of the errors are within 2 sigma all the same.

Noise comes faster than it goes: a burst in each step is held over the steps.
"""

import math
from collections import deque

import numpy as np

from footsense.frames import Mask, Vector

#: Directions of least variation along which noise is measured.
_N_DIRECTIONS = 4
#: Mean first difference over the noise, below which the load does not move [1].
_MOTION_LIMIT_REL = 0.7
#: Largest variance that one measurement counts as, over the present one [1]; least variance that this is of [1]: below
#: any converter's noise.
_MAX_GROWTH_REL, _LEAST_VARIANCE_REL = 9.0, 1e-4**2
#: Measurements over which noise is averaged, and over which it fades: three a scan.
_AVERAGED, _FADING = 12, 120


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
        # White noise of variance 1 has second differences of variance 6.
        self._directions = directions[:, :_N_DIRECTIONS] / math.sqrt(6.0 * _N_DIRECTIONS)
        self._recent_rel = np.zeros(n_legs)
        self.variance_rel = np.zeros(n_legs)

    def observe(self, plate_distance_rel: Vector) -> None:
        """Measure the noise of the last three readings of each element, newest first [1], shape (legs, 3, elements).

        A leg without three readings of every element keeps its noise.
        """
        steps = plate_distance_rel[:, :2] - plate_distance_rel[:, 1:]
        along = (steps[:, 0] - steps[:, 1]) @ self._directions
        newest_rel = np.add.reduce(along * along, axis=1)
        moved_rel = np.abs(np.add.reduce(steps, axis=2)).max(axis=1) / steps.shape[2]
        still: Mask = moved_rel * moved_rel < _MOTION_LIMIT_REL**2 * newest_rel
        recent = self._recent_rel
        counted_rel = np.minimum(newest_rel, _MAX_GROWTH_REL * np.maximum(recent, _LEAST_VARIANCE_REL))
        recent += np.where(still, counted_rel - recent, 0.0) / _AVERAGED
        held = self.variance_rel
        self.variance_rel = np.maximum(recent, held + (recent - held) / _FADING)


#: Length of a block: about a scan [ns].
_PEAK_BLOCK_NS = 25_000_000
#: Blocks that wait at least, as the rise of a slow touchdown is not noise, and in which shake has to come back.
_HELD_BACK_BLOCKS, _MAX_SHAKE_BLOCKS = 2, 12
#: Share of the threshold below which the signal has come back [1].
_RETURN_THRESHOLD_REL = 1 / 3
#: Blocks after which the measured threshold applies, and over which peaks are averaged.
_MIN_BLOCKS, _AVERAGED_BLOCKS = 20, 400.0
#: Standard deviations of the peaks above their mean; the same at most, however high one peak was.
_THRESHOLD_SIGMAS, _MAX_THRESHOLD_SIGMAS = 5.0, 9.0
#: Highest peak: part that is forgotten in each block, and margin above it [1].
_PEAK_DECAY_REL, _PEAK_MARGIN_REL = 0.0005, 1.2


class SwingNoise:
    """Contact threshold of one load signal of one leg, learnt from the signal's peaks in swing.

    The peaks of short blocks of swing are kept, but for the blocks just before a touchdown, which may hold its rise,
    and for those from which the signal does not come back: shake passes, a load that comes slowly stays. The threshold
    is the mean peak and five of their standard deviations, or a little over the highest peak of the last minutes.

    Args:
        least_n: Least threshold [N], which holds until enough of the swing was seen.

    Attributes:
        contact_n: Load above that in swing that is contact [N].
        sigma_n: Half of the distance from nothing to the mean peak: about the noise of a reading [N].
        block_n: Signal of the present block of swing: load above that in swing [N], NaN where not known.
        end_ns: Time from which the block is complete, and `end_block` is to be called [ns].
    """

    def __init__(self, least_n: float) -> None:
        self.contact_n = self._least_n = least_n
        self.sigma_n = least_n / _THRESHOLD_SIGMAS
        self._n = 0
        self._mean_n = self._variance_n2 = self._highest_n = 0.0
        self.discard_pending(0)

    def discard_pending(self, t_ns: int) -> None:
        """Discard peaks not learnt yet, because of a contact or a new swing from `t_ns` [ns] on."""
        self._waiting: deque[float] = deque(maxlen=_MAX_SHAKE_BLOCKS)
        self.block_n: list[float] = []
        self.end_ns = t_ns + _PEAK_BLOCK_NS

    def end_block(self, t_ns: int) -> None:
        """End the present time block at `t_ns` [ns], and learn the peaks of earlier blocks."""
        known_n = [above_n for above_n in self.block_n if not math.isnan(above_n)]
        self.block_n, self.end_ns = [], t_ns + _PEAK_BLOCK_NS
        waiting = self._waiting
        is_back = min(known_n, default=math.inf) < _RETURN_THRESHOLD_REL * self.contact_n
        if known_n:
            waiting.append(max(*known_n, 0.0))
        while is_back and len(waiting) > _HELD_BACK_BLOCKS:
            self.add_peak(waiting.popleft())

    def add_peak(self, peak_n: float) -> None:
        """Update the threshold with the peak load [N] of one block of swing."""
        self._n += 1
        share = 1.0 / min(self._n, _AVERAGED_BLOCKS)
        off_n = peak_n - self._mean_n
        self._mean_n += share * off_n
        self._variance_n2 += share * (off_n * (peak_n - self._mean_n) - self._variance_n2)
        self._highest_n = max(peak_n, (1.0 - _PEAK_DECAY_REL) * self._highest_n)
        if self._n >= _MIN_BLOCKS:
            spread_n = math.sqrt(max(self._variance_n2, 0.0))
            highest_n = min(
                _PEAK_MARGIN_REL * self._highest_n, self._mean_n + _MAX_THRESHOLD_SIGMAS * spread_n
            )
            self.contact_n = max(self._mean_n + _THRESHOLD_SIGMAS * spread_n, highest_n, self._least_n)
            self.sigma_n = max(self.contact_n - self._mean_n, self._least_n) / _THRESHOLD_SIGMAS
