"""Live guidance of a test-stand session: accepted loads, their coverage, and errors of the reference sensor."""

from collections import Counter, deque
from collections.abc import Callable

import numpy as np

from footsense.calibration.loads.detection import LoadDetector
from footsense.calibration.loads.press import CalibrationLoad, RejectedPress, Rejection
from footsense.calibration.session.coverage import Coverage, azimuth_and_elevation_deg
from footsense.foot.force_errors import GRAM_FORCE_N
from footsense.frames import Cycle, Vector

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
        self._loads: list[CalibrationLoad] = []
        self._estimate_n: list[Vector] = []
        self._shown: deque[tuple[int, Vector]] = deque()
        self.coverage = Coverage(n_wanted)
        self.rejected: Counter[Rejection] = Counter()
        self.findings: list[str] = []

    @property
    def load_reference_forces_n(self) -> Vector:
        """Forces of the accepted loads [N], shape (n, 3)."""
        return np.array([load.force_n for load in self._loads]).reshape(-1, 3)

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
        self._loads.append(load)
        self._estimate_n.append(self._estimate(load))
        azimuth_deg, elevation_deg = map(round, azimuth_and_elevation_deg(load.force_n))
        magnitude_gf = np.linalg.norm(load.force_n) / GRAM_FORCE_N
        self.report(
            f"press {number}: {magnitude_gf:.0f} gf from azimuth {azimuth_deg % 360}, elevation {elevation_deg} deg"
        )
        findings = self._check(self.load_reference_forces_n, np.array(self._estimate_n))
        # The same finding with a slightly different figure is not reported again.
        if [line.partition(":")[2] for line in findings] != [
            line.partition(":")[2] for line in self.findings
        ]:
            for finding in findings:
                self.report(finding)
        self.findings = findings
