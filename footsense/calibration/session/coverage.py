"""Which directions and magnitudes the loads of a session cover, and what to press next.

A calibration knows a foot where it was pressed. The directions are those of the paper's protocol, from an elevation of
40 deg up; its magnitudes 50, 100 and 150 gf have a band each. A direction is covered in a band if a load lies within
reach. So many loads as are wanted, spread as evenly as can be, would each have to reach as far as the cells of a
hexagonal covering; people do not press that evenly, and are allowed 1.6 times that.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from footsense.foot.force_errors import GRAM_FORCE_N

__all__ = ["BANDS_GF", "ENOUGH_REL", "LOWEST_DEG", "Coverage", "Wish", "angles_deg"]

Vector = NDArray[np.float64]

#: Magnitudes that are told apart [gf]; a load belongs to the nearest.
BANDS_GF = (50.0, 100.0, 150.0)
#: Bands that have to be covered: what is pressed with one force says nothing of how a gap shuts with it.
N_BANDS = 2
#: Lowest elevation of the protocol [deg].
LOWEST_DEG = 40.0
#: Share of the directions that has to be covered [1]; the last ones cost as much as all others.
ENOUGH_REL = 0.95

#: Covering density of the hexagonal lattice, 2 pi / sqrt(27): the thinnest covering of the plane by circles.
_HEXAGONAL = 2 * math.pi / math.sqrt(27)
_LENIENCE = 1.6
_N_DIRECTIONS = 400


class Wish(NamedTuple):
    """A press that would cover most of what is not covered yet.

    Attributes:
        azimuth_deg: 0 forward, 90 to the left [deg].
        elevation_deg: 90 straight up the leg [deg].
        magnitude_gf: How hard [gf].
    """

    azimuth_deg: float
    elevation_deg: float
    magnitude_gf: float


class Coverage:
    """Counts loads and the directions that they cover.

    Args:
        wanted: How many loads make a set.

    Attributes:
        reach_deg: How far from a load a direction is covered by it [deg].
        counts: CalibrationLoads in each band.
    """

    def __init__(self, wanted: int) -> None:
        self._wanted = wanted
        self._directions = _cap(_N_DIRECTIONS)
        per_band = max(wanted / N_BANDS, 1.0)
        cap_sr = 2 * math.pi * (1 - math.sin(math.radians(LOWEST_DEG)))
        reach_rad = _LENIENCE * math.sqrt(_HEXAGONAL * cap_sr / (math.pi * per_band))
        self.reach_deg = math.degrees(reach_rad)
        self.counts = [0] * len(BANDS_GF)
        # Angle from each direction to the nearest load of each band.
        self._away_deg = np.full((len(BANDS_GF), _N_DIRECTIONS), np.inf)

    @property
    def n_loads(self) -> int:
        """How many loads there are."""
        return sum(self.counts)

    def add(self, force_n: Vector) -> None:
        """Take note of a load of this force [N], shape (3,)."""
        size_n = float(np.linalg.norm(force_n))
        band = int(np.argmin(np.abs(np.array(BANDS_GF) * GRAM_FORCE_N - size_n)))
        self.counts[band] += 1
        away_deg = np.degrees(np.arccos(np.clip(self._directions @ (force_n / size_n), -1.0, 1.0)))
        self._away_deg[band] = np.minimum(self._away_deg[band], away_deg)

    @property
    def shares_rel(self) -> list[float]:
        """Return which share of the directions each band covers [1]."""
        return [float(share) for share in (self._away_deg <= self.reach_deg).mean(axis=1)]

    def covers(self, band: int, direction: Vector) -> bool:
        """Tell whether a band covers a direction, a unit vector of shape (3,)."""
        return bool(self._away_deg[band][int(np.argmax(self._directions @ direction))] <= self.reach_deg)

    @property
    def enough(self) -> bool:
        """Tell whether there are enough loads, spread over the directions in two bands."""
        spread = sorted(self.shares_rel)[-N_BANDS:]
        return self.n_loads >= self._wanted and min(spread) >= ENOUGH_REL

    @property
    def next(self) -> Wish:
        """Return what to press next: in the emptier one of the two fullest bands, where no load is for farthest."""
        shares = self.shares_rel
        # Of bands that are as empty, those far from each other come first, as the paper's.
        fullest = sorted(range(len(BANDS_GF)), key=lambda band: (-shares[band], band == 1, band))[:N_BANDS]
        band = min(fullest, key=lambda band: shares[band])
        azimuth_deg, elevation_deg = angles_deg(self._directions[int(np.argmax(self._away_deg[band]))])
        return Wish(azimuth_deg, elevation_deg, BANDS_GF[band])

    def words(self) -> str:
        """Return how far the set is, in one line."""
        shares = ", ".join(
            f"{100 * share:.0f} % at {gf:.0f} gf" for gf, share in zip(BANDS_GF, self.shares_rel, strict=True)
        )
        return f"{self.n_loads} of {self._wanted} loads; directions covered: {shares}"


def angles_deg(force: Sequence[float] | Vector) -> tuple[float, float]:
    """Return azimuth, 0 to 360, and elevation of a force, the paper's angles [deg].

    Example:
        >>> angles_deg((0.0, 1.0, 1.0))
        (90.0, 45.0)
    """
    x, y, z = (float(component) for component in force)
    azimuth_deg = math.degrees(math.atan2(y, x)) % 360.0
    return round(azimuth_deg, 6), round(math.degrees(math.atan2(z, math.hypot(x, y))), 6)


def _cap(n: int) -> Vector:
    """Return n directions evenly spread over the cap, the pole first, shape (n, 3): a spiral by the golden angle."""
    k = np.arange(n) + 0.5
    z = 1 - k / n * (1 - math.sin(math.radians(LOWEST_DEG)))
    across, azimuth = np.sqrt(1 - z**2), math.pi * (3 - math.sqrt(5)) * k
    return np.column_stack([across * np.cos(azimuth), across * np.sin(azimuth), z])
