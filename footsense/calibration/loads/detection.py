"""CalibrationLoads in a recording, or as they happen: a foot is pressed, held still, and let go.

When a foot is pressed, its own capacitances tell: they step by a hundred times their noise where the force of a robust
reference does so by a few times its. What the press is worth, `dwell.py` says once it is let go and
the foot has rested for a moment.
"""

from collections import deque
from collections.abc import Iterable
from enum import Enum, auto

import numpy as np
from numpy.typing import NDArray

from footsense.calibration.loads.dwell import weigh
from footsense.calibration.loads.press import CalibrationLoad, Press, Rejection
from footsense.calibration.session.reference_log import ReferenceLog
from footsense.frames import Cycle, Reading

__all__ = ["CalibrationLoad", "LoadDetector", "Rejection", "find_loads"]

Vector = NDArray[np.float64]

_NS_PER_MS = 1_000_000

#: Mean change of the elements that is a press [1]: 20 fF of 5 pF, that of some 10 mN.
_PRESSED_REL = 0.005
#: Share of the largest change below which the foot is let go: rubber keeps some hundredths for a while.
_LET_GO_REL = 0.15
#: The foot at rest is that of this long, until shortly before the press, which may begin slowly [ns].
_REST_NS = 500 * _NS_PER_MS
_SLOW_START_NS = 100 * _NS_PER_MS
#: After it was let go the rubber comes back, most of it within this [ns]; then it rests.
_RECOVERY_NS = 100 * _NS_PER_MS
_AFTER_NS = 200 * _NS_PER_MS
#: So far back goes what is taken for the zero of the reference [ns].
_ZERO_NS = 10_000 * _NS_PER_MS
#: Who leans on a foot for longer has changed its zero [ns].
_LONGEST_NS = 60_000 * _NS_PER_MS
#: Scans that have to agree: one alone may be a reading that went wrong.
_AGREED = 2
#: Scans without which there is no rest to begin with.
_LEAST_REST = 2


class _Phase(Enum):
    REST = auto()
    PRESSED = auto()
    LET_GO = auto()


class LoadDetector:
    """Finds the loads of one leg, cycle by cycle.

    Args:
        row: Row of the leg in the frames.
    """

    def __init__(self, row: int) -> None:
        self._row = row
        self._scans: deque[tuple[int, Vector, NDArray[np.uint8], Vector]] = deque()
        self._reference = ReferenceLog()
        self._zeros: deque[tuple[int, Vector, int]] = deque()
        self._phase = _Phase.REST
        self._agreed = 0
        self._rest_pf: Vector | None = None
        self._before_ns = (0, 0)
        self._pressed_ns = 0
        self._let_go_ns = 0
        self._peak_rel = 0.0
        self._seen_until_ns = 0

    @property
    def pressed(self) -> bool:
        """Tell whether the foot is pressed now."""
        return self._phase is _Phase.PRESSED

    @property
    def zero_n(self) -> Vector:
        """Return the force of the reference at rest [N], shape (3,); NaN as long as it is not known."""
        total_n, n = self._zero()
        if self._phase is _Phase.REST:
            now_n, n_now = self._reference.sum_within(self._before_ns)
            total_n, n = total_n + now_n, n + n_now
        return total_n / n if n else np.full(3, np.nan)

    def take(self, cycle: Cycle) -> CalibrationLoad | None:
        """Take note of a cycle; return the load that it brings to its end, if one."""
        self._reference.add(cycle.reference)
        scan, row = cycle.scan, self._row
        stamps = scan.t_ns[row]
        # Where forces go out after every conversion, most of a scan is that of before; a scan without any stamp has
        # nothing to say, but that its elements were not read.
        t_ns = int(stamps.mean()) if stamps.all() else cycle.forces.t_sent_ns
        if (stamps.all() and int(stamps.min()) <= self._seen_until_ns) or t_ns <= self._seen_until_ns:
            return None
        self._seen_until_ns = max(int(stamps.max()), t_ns)
        # The sum of a column that was read at once is no element.
        capacitance_pf = np.where(scan.reading[row] == Reading.OK, scan.capacitance_pf[row], np.nan)
        self._scans.append((t_ns, capacitance_pf, scan.reading[row], cycle.forces.force_n[row]))
        return self._step(t_ns, capacitance_pf)

    def finish(self) -> CalibrationLoad | None:
        """Return what the end of the recording leaves: a press that was let go a moment before, or was not."""
        if self._phase is _Phase.REST or not self._scans:
            return None
        phase, self._phase = self._phase, _Phase.REST
        if phase is _Phase.LET_GO:
            return self._load(None)
        self._let_go_ns = self._scans[-1][0]
        return self._without(Rejection.NOT_LET_GO, "the recording ends in it")

    def _step(self, t_ns: int, capacitance_pf: Vector) -> CalibrationLoad | None:
        match self._phase:
            case _Phase.REST:
                self._look_for_a_press(t_ns, capacitance_pf)
                return None
            case _Phase.PRESSED:
                return self._look_for_the_end(t_ns, capacitance_pf)
            case _Phase.LET_GO:
                return self._wait_for_rest(t_ns, capacitance_pf)

    def _look_for_a_press(self, t_ns: int, capacitance_pf: Vector) -> None:
        before_ns = (t_ns - _SLOW_START_NS - _REST_NS, t_ns - _SLOW_START_NS)
        rested = [entry[1] for entry in self._scans if before_ns[0] <= entry[0] <= before_ns[1]]
        if self._agreed == 0:
            self._before_ns = before_ns
            self._rest_pf = _mean(np.array(rested)) if len(rested) >= _LEAST_REST else None
            self._forget_until(before_ns[0])
        if not self._agrees(self._change_rel(capacitance_pf) > _PRESSED_REL):
            return
        self._begin()

    def _begin(self) -> None:
        self._phase = _Phase.PRESSED
        self._pressed_ns = self._scans[-_AGREED][0]
        self._peak_rel = 0.0
        while self._zeros and self._zeros[0][0] < self._before_ns[0] - _ZERO_NS:
            self._zeros.popleft()
        total_n, n = self._reference.sum_within(self._before_ns)
        if n:
            self._zeros.append((self._before_ns[1], total_n, n))

    def _look_for_the_end(self, t_ns: int, capacitance_pf: Vector) -> CalibrationLoad | None:
        change_rel = self._change_rel(capacitance_pf)
        self._peak_rel = max(self._peak_rel, change_rel)
        if self._agrees(change_rel < max(_PRESSED_REL, _LET_GO_REL * self._peak_rel)):
            self._phase = _Phase.LET_GO
            self._let_go_ns = self._scans[-_AGREED][0]
            return None
        if t_ns - self._pressed_ns < _LONGEST_NS:
            return None
        self._let_go_ns = t_ns
        load = self._without(Rejection.TOO_LONG, f"pressed for more than {_LONGEST_NS / 1e9:g} s")
        self._rest(t_ns)
        return load

    def _wait_for_rest(self, t_ns: int, capacitance_pf: Vector) -> CalibrationLoad | None:
        again = self._change_rel(capacitance_pf) > max(_PRESSED_REL, 2 * _LET_GO_REL * self._peak_rel)
        if self._agrees(again):
            # Pressed again at once: what stood before the first may have to stand before the second, too.
            between_ns = (self._let_go_ns + _RECOVERY_NS, self._scans[-_AGREED][0] - _SLOW_START_NS)
            rested = [entry[1] for entry in self._scans if between_ns[0] <= entry[0] <= between_ns[1]]
            load = self._load(between_ns if len(rested) >= _LEAST_REST else None)
            if len(rested) >= _LEAST_REST:
                self._before_ns, self._rest_pf = between_ns, _mean(np.array(rested))
            self._begin()
            return load
        if t_ns - self._let_go_ns < _RECOVERY_NS + _AFTER_NS:
            return None
        load = self._load((self._let_go_ns + _RECOVERY_NS, t_ns))
        self._rest(self._let_go_ns + _RECOVERY_NS)
        return load

    def _agrees(self, holds: bool) -> bool:  # noqa: FBT001 - reads like the sentence it counts
        """Tell whether enough scans in a row have said so; the count begins anew then."""
        self._agreed = self._agreed + 1 if holds else 0
        if self._agreed < _AGREED:
            return False
        self._agreed = 0
        return True

    def _change_rel(self, capacitance_pf: Vector) -> float:
        """Return by how much the elements have grown in the mean [1]; NaN without a rest or an element."""
        if self._rest_pf is None:
            return np.nan
        change_rel = capacitance_pf / self._rest_pf - 1
        there = ~np.isnan(change_rel)
        return float(change_rel[there].mean()) if there.any() else np.nan

    def _zero(self) -> tuple[Vector, int]:
        """Return the sum and the number of the reference's samples in the rests before the last presses."""
        total_n = sum((total_n for _, total_n, _ in self._zeros), np.zeros(3))
        return total_n, sum(n for _, _, n in self._zeros)

    def _rest(self, since_ns: int) -> None:
        """Wait for the next press; what was before is of no use any more."""
        self._phase = _Phase.REST
        self._rest_pf = None
        self._forget_until(since_ns)

    def _forget_until(self, t_ns: int) -> None:
        while self._scans and self._scans[0][0] < t_ns:
            self._scans.popleft()
        self._reference.forget_until(t_ns)

    def _load(self, after_ns: tuple[int, int] | None) -> CalibrationLoad:
        return weigh(self._press(after_ns))

    def _without(self, why: Rejection, words: str) -> CalibrationLoad:
        nothing, none_pf = np.full(3, np.nan), np.full(9, np.nan)
        t_ns = (self._pressed_ns + self._let_go_ns) // 2
        values = (nothing, nothing, none_pf, none_pf, none_pf, nothing)
        return CalibrationLoad(
            t_ns, 0.0, *values, n_samples=0, n_scans=0, saturated=False, rejection=why, words=words
        )

    def _press(self, after_ns: tuple[int, int] | None) -> Press:
        t_ns, capacitance_pf, reading, estimate_n = zip(*self._scans, strict=True)
        reference = self._reference.all()
        return Press(
            np.array(t_ns, np.int64),
            np.array(capacitance_pf),
            np.array(reading),
            np.array(estimate_n),
            *reference,
            self._before_ns,
            (self._pressed_ns, self._let_go_ns),
            after_ns,
            *self._zero(),
        )


def find_loads(cycles: Iterable[Cycle], row: int) -> list[CalibrationLoad]:
    """Return every press of a leg's foot, in its order, those that do not count among them.

    Args:
        cycles: Those of a recording with a reference.
        row: Row of the leg in the frames.
    """
    finder = LoadDetector(row)
    found = [finder.take(cycle) for cycle in cycles]
    return [load for load in (*found, finder.finish()) if load is not None]


def _mean(values: Vector) -> Vector:
    there = ~np.isnan(values)
    n = there.sum(axis=0)
    return np.where(n > 0, np.where(there, values, 0.0).sum(axis=0) / np.maximum(n, 1), np.nan)
