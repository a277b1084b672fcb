"""Contact threshold of a load signal, learnt from the noise and the shake of earlier swings."""

import math
from collections import deque

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
