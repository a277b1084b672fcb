"""Force directions and magnitudes covered by a session's loads, and the load to apply next.

Directions are those of the paper's protocol, from 40 deg of elevation up; its magnitudes of 50, 100 and 150 gf have a
band each. A load covers the directions within its reach. The wanted number of loads in a hexagonal covering would need
a certain reach; people press less evenly and get 1.6 times that.

Source:
    Kershner, American Journal of Mathematics 61, 1939, for the density of the hexagonal covering, 2 pi / sqrt(27).
"""

import math
from collections import Counter, deque
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from footsense.calibration.detection import LoadDetector
from footsense.calibration.loads import CalibrationLoad, RejectedPress, Rejection
from footsense.foot.directions import angles_between_deg, azimuth_elevation_deg, spiral_directions
from footsense.foot.force_errors import GRAM_FORCE_N
from footsense.frames import Cycle, Vector

#: Magnitude of each band [gf]; a load belongs to the nearest.
MAGNITUDE_BAND_CENTRES_GF = (50.0, 100.0, 150.0)
#: Bands to cover: loads of one magnitude do not show how gaps close with the force.
N_BANDS_TO_COVER = 2
#: Lowest elevation of the protocol [deg].
MIN_ELEVATION_DEG = 40.0
#: Share of the directions to cover [1]; the last 5 % cost as many loads as all others.
MIN_COVERED_DIRECTIONS_REL = 0.95

_HEXAGONAL_DENSITY = 2 * math.pi / math.sqrt(27)
_REACH_OVER_HEXAGONAL = 1.6
_N_DIRECTIONS = 400


class NextLoad(NamedTuple):
    """Load to apply next: the centre of the largest uncovered range of directions.

    Attributes:
        azimuth_deg: 0 forward, 90 to the left [deg].
        elevation_deg: 90 straight up the leg [deg].
        magnitude_gf: Its magnitude [gf].
    """

    azimuth_deg: float
    elevation_deg: float
    magnitude_gf: float


class Coverage:
    """Counts the accepted calibration loads and tracks which force directions they cover.

    Args:
        n_wanted: Number of loads of a complete set.

    Attributes:
        directions: The directions to cover, unit vectors, shape (n, 3).
        reach_deg: Angle up to which a load covers a direction [deg].
        counts: Loads in each band.
    """

    def __init__(self, n_wanted: int) -> None:
        self._wanted = n_wanted
        self.directions = spiral_directions(_N_DIRECTIONS, MIN_ELEVATION_DEG)
        per_band = max(n_wanted / N_BANDS_TO_COVER, 1.0)
        cap_sr = 2 * math.pi * (1 - math.sin(math.radians(MIN_ELEVATION_DEG)))
        self.reach_deg = math.degrees(
            _REACH_OVER_HEXAGONAL * math.sqrt(_HEXAGONAL_DENSITY * cap_sr / (math.pi * per_band))
        )
        self.counts = [0] * len(MAGNITUDE_BAND_CENTRES_GF)
        # Angle from each direction to the nearest load of each band.
        self._nearest_deg = np.full((len(MAGNITUDE_BAND_CENTRES_GF), _N_DIRECTIONS), np.inf)

    @property
    def n_loads(self) -> int:
        """Number of accepted calibration loads so far."""
        return sum(self.counts)

    def add_load(self, force_n: Vector) -> None:
        """Add an accepted load with this force [N], shape (3,)."""
        magnitude_gf = float(np.linalg.norm(force_n)) / GRAM_FORCE_N
        band = int(np.argmin(np.abs(np.array(MAGNITUDE_BAND_CENTRES_GF) - magnitude_gf)))
        self.counts[band] += 1
        angle_deg = angles_between_deg(self.directions, force_n)
        self._nearest_deg[band] = np.minimum(self._nearest_deg[band], angle_deg)

    @property
    def covered_directions_rel(self) -> list[float]:
        """Fraction of the force directions covered, for each of `MAGNITUDE_BAND_CENTRES_GF` [1]."""
        return [float(share) for share in (self._nearest_deg <= self.reach_deg).mean(axis=1)]

    @property
    def n_covering_bands(self) -> Vector:
        """Number of bands whose loads cover each of `directions`, shape (n,)."""
        n: Vector = (self._nearest_deg <= self.reach_deg).sum(axis=0)
        return n

    @property
    def is_complete(self) -> bool:
        """Whether there are enough loads, covering the directions in two magnitude bands."""
        fullest = sorted(self.covered_directions_rel)[-N_BANDS_TO_COVER:]
        return self.n_loads >= self._wanted and min(fullest) >= MIN_COVERED_DIRECTIONS_REL

    @property
    def next_load(self) -> NextLoad:
        """Load to apply next: in the emptier of the two fullest bands, the direction farthest from all loads."""
        shares = self.covered_directions_rel
        # Of equally empty bands the outer ones come first: those of the paper's training set.
        fullest = sorted(
            range(len(MAGNITUDE_BAND_CENTRES_GF)), key=lambda band: (-shares[band], band == 1, band)
        )[:N_BANDS_TO_COVER]
        band = min(fullest, key=lambda band: shares[band])
        azimuth_deg, elevation_deg = azimuth_and_elevation_deg(
            self.directions[int(np.argmax(self._nearest_deg[band]))]
        )
        return NextLoad(azimuth_deg, elevation_deg, MAGNITUDE_BAND_CENTRES_GF[band])

    def progress_text(self) -> str:
        """Return the number of loads and the covered fraction of directions as one line of text."""
        shares = ", ".join(
            f"{100 * share:.0f} % at {gf * GRAM_FORCE_N:.1f} N"
            for gf, share in zip(MAGNITUDE_BAND_CENTRES_GF, self.covered_directions_rel, strict=True)
        )
        return f"{self.n_loads} loads, at least {self._wanted} wanted; directions covered: {shares}"


def azimuth_and_elevation_deg(force: Vector) -> tuple[float, float]:
    """Return the azimuth, 0 to 360, and elevation of one force vector [deg].

    Example:
        >>> azimuth_and_elevation_deg(np.array([0.0, 1.0, 1.0]))
        (90.0, 45.0)
    """
    azimuth_deg, elevation_deg = azimuth_elevation_deg(force)
    return round(float(azimuth_deg) % 360.0, 6), round(float(elevation_deg), 6)


#: Span of the displayed mean of the reference [ns].
_REFERENCE_MEAN_SPAN_NS = 100_000_000


class SessionGuide:
    """Observer that detects calibration loads, counts their coverage, and reports findings to the user.

    Args:
        row: Row of the leg in the frames.
        n_wanted: Number of loads of a complete set.
        estimate: Force of a load by the foot's network [N], shape (3,), NaN where it has none.
        check: Returns findings, one line each, of the reference's forces and those estimates [N], shapes (n, 3).
        report: Takes each message, one line.

    Attributes:
        report: As given.
        coverage: What the accepted loads cover.
        rejected: Number of rejected presses by reason.
        findings: Findings about the reference, as of the last load.
    """

    def __init__(
        self,
        row: int,
        n_wanted: int,
        estimate: Callable[[CalibrationLoad], Vector],
        check: Callable[[Vector, Vector], list[str]],
        report: Callable[[str], None],
    ) -> None:
        self._detector = LoadDetector(row)
        self._estimate = estimate
        self._check = check
        self.report = report
        self._reference_n: list[Vector] = []
        self._estimate_n: list[Vector] = []
        self._shown: deque[tuple[int, Vector]] = deque()
        self.coverage = Coverage(n_wanted)
        self.rejected: Counter[Rejection] = Counter()
        self.findings: list[str] = []

    @property
    def is_pressed(self) -> bool:
        """Whether the foot is being pressed at the latest cycle."""
        return self._detector.is_pressed

    @property
    def reference_n(self) -> Vector:
        """Latest force on the reference sensor, offset subtracted [N], shape (3,); NaN without samples."""
        if not self._shown:
            return np.full(3, np.nan)
        force_n: Vector = (
            np.mean([force_n for _, force_n in self._shown], axis=0) - self._detector.reference_offset_n
        )
        return force_n

    def observe(self, cycle: Cycle) -> None:
        """Process a cycle: detect presses, and update coverage and guidance."""
        if cycle.reference is not None:
            self._shown.extend(zip(cycle.reference.t_ns.tolist(), cycle.reference.force_n, strict=True))
        while self._shown and self._shown[0][0] < cycle.forces.t_sent_ns - _REFERENCE_MEAN_SPAN_NS:
            self._shown.popleft()
        self._add_load(self._detector.process_cycle(cycle))

    def close(self) -> None:
        """Finish the session: add the press that is still in progress."""
        self._add_load(self._detector.finish())

    def _add_load(self, load: CalibrationLoad | RejectedPress | None) -> None:
        """Count and report an accepted load or a rejected press; None is ignored."""
        if load is None:
            return
        number = self.coverage.n_loads + self.rejected.total() + 1
        if isinstance(load, RejectedPress):
            self.rejected[load.rejection] += 1
            self.report(f"press {number} is rejected: {load.rejection}: {load.reason}")
            return
        self.coverage.add_load(load.force_n)
        self._reference_n.append(load.force_n)
        self._estimate_n.append(self._estimate(load))
        azimuth_deg, elevation_deg = map(round, azimuth_and_elevation_deg(load.force_n))
        self.report(
            f"press {number}: {np.linalg.norm(load.force_n):.2f} N towards azimuth {azimuth_deg % 360}, "
            f"elevation {elevation_deg} deg"
        )
        findings = self._check(np.array(self._reference_n), np.array(self._estimate_n))
        # The same finding with a slightly different figure is not reported again.
        told = [line.partition(":")[2] for line in self.findings]
        if [line.partition(":")[2] for line in findings] != told:
            for finding in findings:
                self.report(finding)
        self.findings = findings
