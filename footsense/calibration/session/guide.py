"""What guides a session on the test_stand: the loads as they happen, what they cover, and what is wrong with them."""

from collections import Counter, deque
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from footsense.calibration.loads.detection import CalibrationLoad, LoadDetector, Rejection
from footsense.calibration.session.coverage import Coverage, angles_deg
from footsense.calibration.session.reference_lag import lag_words
from footsense.foot.force_errors import GRAM_FORCE_N
from footsense.frames import Cycle

__all__ = ["Guide", "Judge"]

Vector = NDArray[np.float64]

#: Says what cannot be right about a reference, of its forces and the foot's own for the same loads [N], shapes (n, 3).
Judge = Callable[[Vector, Vector], list[str]]

#: The reference's force that is shown is the mean of its last [ns].
_SHOWN_NS = 100_000_000


class Guide:
    """An observer that finds loads and keeps count of them.

    Args:
        row: Row of the leg in the frames.
        wanted: How many loads make a set.
        estimate: What the foot's network makes of a load [N], shape (3,), NaN where it cannot.
        judge: Tells whether the reference may be believed.

    Attributes:
        coverage: What the loads that count cover.
        refused: How many do not count, by reason.
        last: The last press, counted or not.
        doubts: What cannot be right about the reference, as of the last load.
    """

    def __init__(
        self, row: int, wanted: int, estimate: Callable[[CalibrationLoad], Vector], judge: Judge
    ) -> None:
        self._finder = LoadDetector(row)
        self._estimate = estimate
        self._judge = judge
        self._reference_n: list[Vector] = []
        self._estimate_n: list[Vector] = []
        self._shown: deque[tuple[int, Vector]] = deque()
        self._lags_s: list[float] = []
        self._lag_told = False
        self._news: list[str] = []
        self.coverage = Coverage(wanted)
        self.refused: Counter[Rejection] = Counter()
        self.last: CalibrationLoad | None = None
        self.doubts: list[str] = []

    @property
    def directions_n(self) -> Vector:
        """Forces of the loads that count [N], shape (n, 3)."""
        return np.array(self._reference_n).reshape(-1, 3)

    @property
    def pressed(self) -> bool:
        """Tell whether the foot is pressed now."""
        return self._finder.pressed

    @property
    def reference_n(self) -> Vector:
        """Return the force that the reference says now, its zero taken off [N], shape (3,); NaN while it says none."""
        if not self._shown:
            return np.full(3, np.nan)
        force_n: Vector = np.mean([force_n for _, force_n in self._shown], axis=0) - self._finder.zero_n
        return force_n

    def news(self) -> list[str]:
        """Return what has happened since the last call, one line each."""
        news, self._news = self._news, []
        return news

    def observe(self, cycle: Cycle) -> None:
        """Take note of a cycle."""
        if cycle.reference is not None:
            self._shown.extend(zip(cycle.reference.t_ns.tolist(), cycle.reference.force_n, strict=True))
        while self._shown and self._shown[0][0] < cycle.forces.t_sent_ns - _SHOWN_NS:
            self._shown.popleft()
        self._take(self._finder.take(cycle))

    def close(self) -> None:
        """Take the load that has just ended."""
        self._take(self._finder.finish())

    def _take(self, load: CalibrationLoad | None) -> None:
        if load is None:
            return
        self.last = load
        number = self.coverage.n_loads + self.refused.total() + 1
        if load.rejection is not None:
            self.refused[load.rejection] += 1
            self._news.append(f"press {number} does not count: {load.rejection}: {load.words}")
            return
        self.coverage.add(load.force_n)
        self._reference_n.append(load.force_n)
        self._estimate_n.append(self._estimate(load))
        azimuth_deg, elevation_deg = map(round, angles_deg(load.force_n))
        size_gf = np.linalg.norm(load.force_n) / GRAM_FORCE_N
        self._news.append(
            f"press {number}: {size_gf:.0f} gf from azimuth {azimuth_deg % 360}, elevation {elevation_deg} deg"
        )
        self._lags_s.append(load.lag_s)
        if not self._lag_told and (words := lag_words(self._lags_s)):
            self._lag_told = True
            self._news.append(f"warning: {words}")
        doubts = self._judge(self.directions_n, np.array(self._estimate_n))
        # A figure that changes a little is not news.
        if [doubt.partition(":")[2] for doubt in doubts] != [
            doubt.partition(":")[2] for doubt in self.doubts
        ]:
            self._news += doubts
        self.doubts = doubts
