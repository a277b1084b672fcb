"""Follows the zero of a leg while its foot is in the air, and says how far it can be trusted.

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

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from footsense.frames import ELEMENTS, BaselineStatus

Vector = NDArray[np.float64]

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
        noise_limit_ff: Largest noise of any element [fF rms].
        unloaded_limit_rel: Largest deviation of any element from what the free foot reads [1].
    """

    noise_limit_ff: float
    unloaded_limit_rel: float


class LegZero:
    """The zero of one leg.

    Args:
        unloaded_pf: What each element of the free foot is expected to read [pF], shape (9,).
        limits: When a zero follows.

    Attributes:
        zero_pf: Unloaded capacitance without stray [pF], shape (9,), NaN where there is none; never changed,
            only replaced.
        status: What it does.
        moved_ns: When it was last tared or moved [ns]; 0 without one.
        offset_pf: How far it has moved since the last tare, mean and worst element [pF]; NaN without one.
    """

    def __init__(self, unloaded_pf: Vector, limits: ZeroLimits) -> None:
        self._unloaded_pf = unloaded_pf
        self._farthest_pf = limits.unloaded_limit_rel * unloaded_pf
        self._limits = limits
        self.forget()

    def forget(self) -> None:
        """Have no zero: the leg may carry another foot."""
        self.zero_pf = self._tared_pf = self._anchor_pf = np.full(ELEMENTS, np.nan)
        self.status = BaselineStatus.NONE
        self.moved_ns = 0
        self.offset_pf = (math.nan, math.nan)
        self._variance_pf2 = math.nan
        self._at_ns = 0
        self._before: tuple[Vector, int] | None = None
        self._step_pf2 = np.zeros(ELEMENTS)

    def take(self, zero_pf: Vector, t_ns: int) -> None:
        """Take the result of a tare [pF], shape (9,); an element that it does not know keeps the zero that it has."""
        self.zero_pf = np.where(np.isnan(zero_pf), self.zero_pf, zero_pf)
        self._tared_pf = self._anchor_pf = self.zero_pf
        self.moved_ns = self._at_ns = t_ns
        self.offset_pf = (0.0, 0.0)
        self._variance_pf2 = _TARE_PF2
        self.hold()

    def sigma_pf(self, now_ns: int) -> float:
        """Return the standard deviation of the zero of any of its elements now [pF], NaN without a zero."""
        return math.sqrt(self._variance_pf2 + DRIFT_PF2_PER_S * max(now_ns - self._at_ns, 0) * 1e-9)

    def hold(self, why: BaselineStatus = BaselineStatus.HELD) -> None:
        """Stand still."""
        self._before = None
        self.status = why

    def follow(self, capacitance_pf: Vector, t_ns: NDArray[np.int64]) -> bool:
        """Follow a foot that is in the air, and whose readings drift and creep could explain.

        Nothing happens until every element has been read anew since the last call that counted.

        Args:
            capacitance_pf: Readings without stray [pF], shape (9,), NaN where there is none to be used.
            t_ns: Stamp of each [ns], same shape.

        Returns:
            Whether the zero has moved.
        """
        newest_ns = int(t_ns.max())
        before, self._before = self._before, (capacitance_pf, newest_ns)
        if before is None:
            return False
        before_pf, before_ns = before
        step_pf = capacitance_pf - before_pf
        known = np.isfinite(step_pf)
        if int(np.where(known, t_ns, newest_ns).min()) <= before_ns:
            self._before = before
            return False
        step_pf2 = 0.5 * step_pf * step_pf
        self._step_pf2 = np.where(known, self._step_pf2 + _NEWEST_REL * (step_pf2 - self._step_pf2), 0.0)
        if math.sqrt(self._step_pf2.max()) * 1e3 > self._limits.noise_limit_ff:
            self.status = BaselineStatus.NOT_QUIET
            return False
        self.status = BaselineStatus.TRACKING
        self._move(before_pf, known, newest_ns)
        if np.isnan(self.zero_pf).any():
            self._adopt((capacitance_pf + before_pf) / 2, step_pf2)
        moved_pf = self.zero_pf - self._tared_pf
        moved_pf = moved_pf[np.isfinite(moved_pf)]
        mean_pf = float(np.add.reduce(moved_pf)) / len(moved_pf)
        self.offset_pf = (mean_pf, float(moved_pf[np.abs(moved_pf).argmax()]))
        return True

    def _move(self, reading_pf: Vector, known: NDArray[np.bool_], t_ns: int) -> None:
        passed_s = max(t_ns - self._at_ns, 0) * 1e-9
        reach_pf = FASTEST_PF_PER_S * passed_s
        anchor_pf = self._anchor_pf + _within(self.zero_pf - self._anchor_pf, -reach_pf, reach_pf)
        variance_pf2 = self._variance_pf2 + DRIFT_PF2_PER_S * passed_s
        gain = variance_pf2 / (variance_pf2 + _READING_PF2)
        off_pf = reading_pf - self.zero_pf
        wanted_pf = _within(self.zero_pf + gain * off_pf, anchor_pf - MARGIN_PF, anchor_pf + MARGIN_PF)
        farther_pf = np.abs(wanted_pf - self._unloaded_pf)
        beyond = (farther_pf > self._farthest_pf) & (farther_pf > np.abs(self.zero_pf - self._unloaded_pf))
        if beyond.any():
            self.status = BaselineStatus.TOO_FAR
        followed = known & np.isfinite(off_pf) & ~beyond
        moved_pf = np.where(followed, wanted_pf - self.zero_pf, 0.0)
        off_sum_pf = float(np.abs(np.where(followed, off_pf, 0.0)).sum())
        self.zero_pf = self.zero_pf + moved_pf
        self._anchor_pf = anchor_pf
        self._at_ns = t_ns
        # What the margin cut off is not known any better: the variance shrinks by as much as was really moved.
        share = float(np.abs(moved_pf).sum()) / off_sum_pf if off_sum_pf > 0.0 else gain * followed.any()
        self._variance_pf2 = (1.0 - share) ** 2 * variance_pf2 + share**2 * _READING_PF2
        if share > 0.0:
            self.moved_ns = t_ns

    def _adopt(self, reading_pf: Vector, step_pf2: Vector) -> None:
        """Give a zero to elements that have none: they have come back since the tare, and now they are in the air."""
        free = np.abs(reading_pf - self._unloaded_pf) <= self._farthest_pf
        quiet = np.sqrt(step_pf2) * 1e3 <= self._limits.noise_limit_ff
        adopted = np.isnan(self.zero_pf) & free & quiet
        self.zero_pf = np.where(adopted, reading_pf, self.zero_pf)
        self._tared_pf = np.where(adopted, reading_pf, self._tared_pf)
        self._anchor_pf = np.where(adopted, reading_pf, self._anchor_pf)


def _within(values: Vector, low: Vector | float, high: Vector | float) -> Vector:
    """Return values between two limits; `np.clip` takes more than twice as long for so few."""
    return np.minimum(np.maximum(values, low), high)
