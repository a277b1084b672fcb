"""Follows the zero of every leg while its foot is in the air, and says how far it can be trusted.

A tare gives a zero, and temperature moves it: by about 1.5 fF/K on every element, which is 1 mN/K. A zero that follows
the readings whenever they are slow would follow a robot that stands, and its load would fade within minutes. So it
follows only in confirmed swing, and even there only as temperature moves:

- between two readings as a Kalman filter does whose process is drift, but never further than `MARGIN_PF` from an anchor
  that runs after it with `FASTEST_PF_PER_S`. Over any time T a zero moves at most 2 MARGIN_PF + FASTEST_PF_PER_S T,
  whatever the readings do: 2 fF + 0.15 fF/s, or 1.3 mN + 0.1 mN/s.
- never further from the free foot's expected readings than a tare may be.

It uses the reading before the last one, when the last one has confirmed that the foot was still in the air.

A load below what drift and creep explain, that came as slowly as they do, is taken for them, and goes at 0.1 mN/s.
The variance of a zero grows with the time since it last followed.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from footsense.frames import ELEMENTS, Zero, ZeroStatus

Vector = NDArray[np.float64]
Stamps = NDArray[np.int64]
Mask = NDArray[np.bool_]

#: Fastest drift [pF/s]: 0.1 K/s of a foot that comes from the sun into the shade, at 1.5 fF/K.
FASTEST_PF_PER_S = 0.15e-3
#: How far a zero may be from its anchor [pF]: a few times the noise of a filtered reading.
MARGIN_PF = 1e-3
#: Growth of the variance [pF^2/s]: 20 K in ten minutes, which are 30 fF, are two standard deviations.
DRIFT_PF2_PER_S = 15e-3**2 / 600
#: Farthest that temperature takes a zero from where it was [pF]: 20 K.
FARTHEST_PF = 30e-3
#: Variance of one reading [pF^2]: twice the noise of the fastest conversion, for what moves a foot in the air.
_READING_PF2 = 1e-3**2
#: Variance of a tare's mean [pF^2].
_TARE_PF2 = 0.2e-3**2
#: Share of the newest step in the mean square of the steps that tells whether a foot is quiet.
_NEWEST_REL = 0.2


@dataclass(frozen=True, slots=True, kw_only=True)
class ZeroLimits:
    """When a zero follows.

    Attributes:
        track: Whether it does at all.
        noise_limit_ff: Largest noise of any element [fF rms].
        unloaded_limit_rel: Largest deviation of any element from what the free foot reads [1].
    """

    track: bool
    noise_limit_ff: float
    unloaded_limit_rel: float


class ZeroTracking:
    """The zeros of all legs.

    Args:
        unloaded_pf: What each element of the free foot is expected to read [pF], shape (legs, 9).
        limits: When a zero follows.

    Attributes:
        zero_pf: Unloaded capacitance without stray [pF], shape (legs, 9), NaN where there is none yet. An array is
            never changed, only replaced.
        summary: Where the zeros stand.
    """

    def __init__(self, unloaded_pf: Vector, limits: ZeroLimits) -> None:
        n_legs = len(unloaded_pf)
        self.zero_pf = np.full((n_legs, ELEMENTS), np.nan)
        self.summary = Zero.none(n_legs)
        self._unloaded_pf = unloaded_pf
        self._limits = limits
        self._tared_pf = self.zero_pf.copy()
        self._anchor_pf = self.zero_pf.copy()
        self._variance_pf2 = np.full(n_legs, np.nan)
        self._status = np.full(n_legs, ZeroStatus.NONE, np.uint8)
        self._moved_ns = np.zeros(n_legs, np.int64)
        self._before_pf = self.zero_pf.copy()
        self._before_ns = np.zeros(n_legs, np.int64)
        self._aloft = np.zeros(n_legs, bool)
        self._step_pf2 = np.zeros((n_legs, ELEMENTS))

    @property
    def sigma_pf(self) -> Vector:
        """Standard deviation of each leg's zero, of any of its elements [pF], shape (legs,); NaN without one."""
        sigma_pf: Vector = np.sqrt(self._variance_pf2)
        return sigma_pf

    @property
    def moved_pf(self) -> Vector:
        """How far each element's zero has moved since its tare [pF], shape (legs, 9)."""
        moved_pf: Vector = self.zero_pf - self._tared_pf
        return moved_pf

    def take(self, leg: int, zero_pf: Vector, t_ns: int) -> None:
        """Take the result of a tare [pF], shape (9,); an element that it does not know keeps the zero that it has."""
        taken_pf = np.where(np.isnan(zero_pf), self.zero_pf[leg], zero_pf)
        # Frames that were published hold the arrays of before.
        self.zero_pf, self._status, self._moved_ns = (
            self.zero_pf.copy(),
            self._status.copy(),
            self._moved_ns.copy(),
        )
        for zeros in (self.zero_pf, self._tared_pf, self._anchor_pf):
            zeros[leg] = taken_pf
        self._variance_pf2[leg] = _TARE_PF2
        self._moved_ns[leg] = self._before_ns[leg] = t_ns
        self._aloft[leg] = False
        self._status[leg] = ZeroStatus.HELD
        self._summarise()

    def forget(self, leg: int) -> None:
        """Give up a leg's zero: it may carry another foot."""
        self.take(leg, np.full(ELEMENTS, np.nan), 0)
        self.zero_pf[leg] = self._tared_pf[leg] = self._variance_pf2[leg] = np.nan
        self._status[leg] = ZeroStatus.NONE
        self._summarise()

    def observe(self, capacitance_pf: Vector, t_ns: Stamps, aloft: Mask, explained: Mask) -> None:
        """Follow the legs that are in the air; a leg counts once all its elements have been read anew.

        Args:
            capacitance_pf: Readings without stray [pF], shape (legs, 9), NaN where there is none to be used.
            t_ns: Stamp of each [ns], same shape.
            aloft: Legs in confirmed swing, shape (legs,).
            explained: Legs whose whole reading drift and creep could explain, shape (legs,).
        """
        read = np.isfinite(capacitance_pf)
        newest_ns = t_ns.max(axis=1)
        oldest_ns = np.where(read, t_ns, newest_ns[:, None]).min(axis=1)
        anew = (oldest_ns > self._before_ns) & read.any(axis=1) & (self._status != ZeroStatus.NONE)
        if not anew.any():
            return
        passed_s = np.where(anew, newest_ns - self._before_ns, 0) * 1e-9
        self._variance_pf2 += DRIFT_PF2_PER_S * passed_s
        reach_pf = (FASTEST_PF_PER_S * passed_s)[:, None]
        self._anchor_pf += np.clip(self.zero_pf - self._anchor_pf, -reach_pf, reach_pf)

        status = np.where(
            aloft, np.where(explained, ZeroStatus.TRACKING, ZeroStatus.TOO_FAST), ZeroStatus.HELD
        )
        if not self._limits.track:
            status[:] = ZeroStatus.HELD
        pairs = anew & (status == ZeroStatus.TRACKING) & self._aloft
        if pairs.any():
            self._follow(capacitance_pf, pairs, newest_ns, status)
        self._status = np.where(anew, status, self._status).astype(np.uint8)
        self._before_pf = np.where(anew[:, None], capacitance_pf, self._before_pf)
        self._before_ns = np.where(anew, newest_ns, self._before_ns)
        self._aloft = np.where(anew, aloft, self._aloft)
        self._summarise()

    def _follow(self, capacitance_pf: Vector, pairs: Mask, now_ns: Stamps, status: NDArray[np.int64]) -> None:
        """Move the zeros of legs whose last two readings are both of the air, and write why not into `status`."""
        limits = self._limits
        step_pf2 = 0.5 * (capacitance_pf - self._before_pf) ** 2
        known = pairs[:, None] & np.isfinite(step_pf2)
        self._step_pf2 += np.where(known, _NEWEST_REL * (step_pf2 - self._step_pf2), 0.0)
        noisy = np.sqrt(self._step_pf2.max(axis=1)) * 1e3 > limits.noise_limit_ff
        known &= ~noisy[:, None]

        gain = self._variance_pf2 / (self._variance_pf2 + _READING_PF2)
        off_pf = self._before_pf - self.zero_pf
        wanted_pf = self.zero_pf + gain[:, None] * off_pf
        wanted_pf = np.clip(wanted_pf, self._anchor_pf - MARGIN_PF, self._anchor_pf + MARGIN_PF)
        farther_pf = np.abs(wanted_pf - self._unloaded_pf)
        beyond = (farther_pf > limits.unloaded_limit_rel * self._unloaded_pf) & (
            farther_pf > np.abs(self.zero_pf - self._unloaded_pf)
        )
        followed = known & np.isfinite(off_pf) & ~beyond
        moved_pf = np.where(followed, wanted_pf - self.zero_pf, 0.0)
        # What the margin cut off is not known any better: the variance shrinks by as much as was really moved.
        off_sum_pf = np.where(followed, np.abs(off_pf), 0.0).sum(axis=1)
        moved = off_sum_pf > 0.0
        share = np.abs(moved_pf).sum(axis=1) / np.where(moved, off_sum_pf, 1.0)
        kept_pf2 = (1.0 - share) ** 2 * self._variance_pf2 + share**2 * _READING_PF2
        self._variance_pf2 = np.where(moved, kept_pf2, self._variance_pf2)
        self.zero_pf = self.zero_pf + moved_pf
        self._moved_ns = np.where(moved, now_ns, self._moved_ns)
        status[pairs & (known & beyond).any(axis=1)] = ZeroStatus.TOO_FAR
        status[pairs & noisy] = ZeroStatus.NOT_QUIET
        if np.isnan(off_pf).any():
            self._adopt(capacitance_pf, known & np.isnan(self.zero_pf))

    def _adopt(self, capacitance_pf: Vector, homeless: Mask) -> None:
        """Give a zero to elements that had none: they have come back since the tare, and now they are in the air."""
        mean_pf = (capacitance_pf + self._before_pf) / 2
        limits = self._limits
        free = np.abs(mean_pf - self._unloaded_pf) <= limits.unloaded_limit_rel * self._unloaded_pf
        quiet = np.abs(capacitance_pf - self._before_pf) * 1e3 <= limits.noise_limit_ff
        taken = homeless & free & quiet
        for zeros in (self.zero_pf, self._tared_pf, self._anchor_pf):
            zeros[taken] = mean_pf[taken]

    def _summarise(self) -> None:
        moved_pf = self.moved_pf
        known = np.isfinite(moved_pf)
        moved_pf = np.where(known, moved_pf, 0.0)
        n_known = known.sum(axis=1)
        none = n_known == 0
        worst = np.abs(moved_pf).argmax(axis=1)
        self.summary = Zero(
            status=self._status,
            mean_pf=np.where(none, np.nan, moved_pf.sum(axis=1) / np.maximum(n_known, 1)),
            worst_pf=np.where(none, np.nan, moved_pf[np.arange(len(none)), worst]),
            moved_ns=self._moved_ns,
        )
