"""Detect presses (press, dwell, release) of a foot, cycle by cycle.

The foot's own capacitances detect a press: they change by a hundred times their noise where the force of a robust
reference changes by a few times its own. `reduce_press` evaluates the press after a pause without load.
"""

from collections import deque
from collections.abc import Iterable
from enum import Enum, auto

import numpy as np

from footsense.calibration.loads import (
    CalibrationLoad,
    Press,
    RejectedPress,
    Rejection,
    Span,
    column_means,
    unsaturated_samples_n,
)
from footsense.calibration.reduction import reduce_press
from footsense.frames import Codes, Cycle, Reading, ReferenceSamples, Vector

_NS_PER_MS = 1_000_000

#: Mean change of the elements that begins a press [1]: 20 fF of 5 pF, that of some 10 mN.
_PRESS_THRESHOLD_REL = 0.005
#: Share of the largest change below which the foot is released: rubber keeps some hundredths for a while.
_RELEASE_THRESHOLD_OF_PEAK_REL = 0.15
#: Unloaded span before a press, and its distance from a press that begins slowly [ns].
_UNLOADED_SPAN_BEFORE_PRESS_NS = 500 * _NS_PER_MS
_UNLOADED_TO_PRESS_MARGIN_NS = 100 * _NS_PER_MS
#: Most of the rubber's recovery after a release, and the unloaded span that follows it [ns].
_RECOVERY_WAIT_NS = 100 * _NS_PER_MS
_UNLOADED_SPAN_AFTER_PRESS_NS = 200 * _NS_PER_MS
#: Age up to which unloaded spans contribute to the offset of the reference [ns].
_OFFSET_MAX_AGE_NS = 10_000 * _NS_PER_MS
#: Longest press [ns]; a longer load has changed the unloaded reading.
_MAX_PRESS_DURATION_NS = 60_000 * _NS_PER_MS
#: Scans in a row that make a transition: a single one may be misread.
_N_AGREEING_SCANS = 2
#: Fewest scans of an unloaded span.
_MIN_UNLOADED_SCANS = 2


class _Phase(Enum):
    """State of the press detector."""

    UNLOADED = auto()
    PRESSED = auto()
    RELEASED = auto()


class LoadDetector:
    """Detects the presses of one leg, cycle by cycle, and reduces each to a calibration load.

    Args:
        row: Row of the leg in the frames.
    """

    def __init__(self, row: int) -> None:
        self._row = row
        self._scans: deque[tuple[int, Vector, Codes]] = deque()
        self._reference: deque[ReferenceSamples] = deque()
        self._offsets: deque[tuple[int, Vector]] = deque()
        self._phase = _Phase.UNLOADED
        self._n_agreeing = 0
        self._baseline_pf: Vector | None = None
        self._before_ns = (0, 0)
        self._pressed_ns = 0
        self._released_ns = 0
        self._peak_rel = 0.0
        self._newest_ns = 0

    @property
    def is_pressed(self) -> bool:
        """Whether the foot is being pressed at the latest cycle."""
        return self._phase is _Phase.PRESSED

    @property
    def reference_offset_n(self) -> Vector:
        """Reading of the reference sensor while unloaded [N], shape (3,); NaN until measured."""
        samples_n = self._offset_samples_n()
        if self._phase is _Phase.UNLOADED:
            now_n = unsaturated_samples_n(join_references(self._reference), self._before_ns)
            samples_n = np.concatenate([samples_n, now_n])
        return column_means(samples_n)

    def process_cycle(self, cycle: Cycle) -> CalibrationLoad | RejectedPress | None:
        """Process a cycle; return the load or rejected press that is complete with this cycle, else None."""
        if cycle.reference is not None and len(cycle.reference.t_ns):
            self._reference.append(cycle.reference)
        scan, row = cycle.scan, self._row
        stamps = scan.t_ns[row]
        # A scan counts once all its elements have been read anew; those without a stamp were not read.
        read_ns = stamps[stamps > 0]
        t_ns = int(read_ns.mean()) if read_ns.size else cycle.forces.t_sent_ns
        if int(read_ns.min(initial=t_ns)) <= self._newest_ns:
            return None
        self._newest_ns = int(read_ns.max(initial=t_ns))
        capacitance_pf = np.where(scan.reading[row] == Reading.OK, scan.capacitance_pf[row], np.nan)
        self._scans.append((t_ns, capacitance_pf, scan.reading[row]))
        match self._phase:
            case _Phase.UNLOADED:
                self._await_press(t_ns, capacitance_pf)
                return None
            case _Phase.PRESSED:
                return self._await_release(t_ns, capacitance_pf)
            case _Phase.RELEASED:
                return self._await_recovery(t_ns, capacitance_pf)

    def finish(self) -> CalibrationLoad | RejectedPress | None:
        """End the recording: return the load or rejection of a press still in progress, else None."""
        phase, self._phase = self._phase, _Phase.UNLOADED
        if phase is _Phase.UNLOADED:
            return None
        if phase is _Phase.RELEASED:
            return reduce_press(self._recorded_press(None))
        return RejectedPress(Rejection.NOT_RELEASED, "the recording ends in it")

    def _await_press(self, t_ns: int, capacitance_pf: Vector) -> None:
        """Update the baseline while unloaded, and switch to pressed once a press begins."""
        if self._n_agreeing == 0:
            self._before_ns = (
                t_ns - _UNLOADED_TO_PRESS_MARGIN_NS - _UNLOADED_SPAN_BEFORE_PRESS_NS,
                t_ns - _UNLOADED_TO_PRESS_MARGIN_NS,
            )
            self._baseline_pf = self._mean_pf(self._before_ns)
            self._drop_samples_before(self._before_ns[0])
        if self._confirm_change(change=self._mean_change_rel(capacitance_pf) > _PRESS_THRESHOLD_REL):
            self._begin_press()

    def _begin_press(self) -> None:
        """Switch to pressed, and store the reference offset from the unloaded span before."""
        self._phase = _Phase.PRESSED
        self._pressed_ns = self._scans[-_N_AGREEING_SCANS][0]
        self._peak_rel = 0.0
        while self._offsets and self._offsets[0][0] < self._before_ns[0] - _OFFSET_MAX_AGE_NS:
            self._offsets.popleft()
        before_n = unsaturated_samples_n(join_references(self._reference), self._before_ns)
        if len(before_n):
            self._offsets.append((self._before_ns[1], before_n))

    def _await_release(self, t_ns: int, capacitance_pf: Vector) -> RejectedPress | None:
        """Switch to released once the capacitances fall; return a rejection if the press is too long."""
        change_rel = self._mean_change_rel(capacitance_pf)
        self._peak_rel = max(self._peak_rel, change_rel)
        if self._confirm_change(
            change=change_rel < max(_PRESS_THRESHOLD_REL, _RELEASE_THRESHOLD_OF_PEAK_REL * self._peak_rel)
        ):
            self._phase = _Phase.RELEASED
            self._released_ns = self._scans[-_N_AGREEING_SCANS][0]
        elif t_ns - self._pressed_ns >= _MAX_PRESS_DURATION_NS:
            self._end_press(t_ns)
            return RejectedPress(
                Rejection.TOO_LONG, f"pressed for more than {_MAX_PRESS_DURATION_NS / 1e9:g} s"
            )
        return None

    def _await_recovery(self, t_ns: int, capacitance_pf: Vector) -> CalibrationLoad | RejectedPress | None:
        """Return the load or rejection of a released press once the unloaded span after it is complete."""
        recovered_ns = self._released_ns + _RECOVERY_WAIT_NS
        pressed_rel = max(_PRESS_THRESHOLD_REL, 2 * _RELEASE_THRESHOLD_OF_PEAK_REL * self._peak_rel)
        if self._confirm_change(change=self._mean_change_rel(capacitance_pf) > pressed_rel):
            # Pressed again at once: the span between is unloaded for both presses, if it is long enough.
            between_ns = (recovered_ns, self._scans[-_N_AGREEING_SCANS][0] - _UNLOADED_TO_PRESS_MARGIN_NS)
            between_pf = self._mean_pf(between_ns)
            load = reduce_press(self._recorded_press(None if between_pf is None else between_ns))
            if between_pf is not None:
                self._before_ns, self._baseline_pf = between_ns, between_pf
            self._begin_press()
            return load
        if t_ns < recovered_ns + _UNLOADED_SPAN_AFTER_PRESS_NS:
            return None
        load = reduce_press(self._recorded_press((recovered_ns, t_ns)))
        self._end_press(recovered_ns)
        return load

    def _confirm_change(self, *, change: bool) -> bool:
        """Return whether enough scans in a row show a change; reset the count once they do."""
        self._n_agreeing = (self._n_agreeing + 1) % _N_AGREEING_SCANS if change else 0
        return change and self._n_agreeing == 0

    def _mean_pf(self, span_ns: Span) -> Vector | None:
        """Return the mean reading of each element in a time span [pF], shape (9,); None if it has too few scans."""
        scans = [entry[1] for entry in self._scans if span_ns[0] <= entry[0] <= span_ns[1]]
        return column_means(np.array(scans)) if len(scans) >= _MIN_UNLOADED_SCANS else None

    def _mean_change_rel(self, capacitance_pf: Vector) -> float:
        """Return the relative capacitance change from the baseline, mean over elements [1]; NaN without a baseline."""
        if self._baseline_pf is None:
            return np.nan
        return float(column_means((capacitance_pf / self._baseline_pf - 1)[:, None])[0])

    def _offset_samples_n(self) -> Vector:
        """Return the reference samples of the unloaded spans before recent presses [N], shape (n, 3)."""
        return np.concatenate([np.zeros((0, 3)), *(samples_n for _, samples_n in self._offsets)])

    def _end_press(self, since_ns: int) -> None:
        """Switch to unloaded, and drop the samples before `since_ns` [ns]."""
        self._phase = _Phase.UNLOADED
        self._baseline_pf = None
        self._drop_samples_before(since_ns)

    def _drop_samples_before(self, t_ns: int) -> None:
        """Drop scans and reference samples older than `t_ns` [ns]."""
        while self._scans and self._scans[0][0] < t_ns:
            self._scans.popleft()
        while self._reference and int(self._reference[0].t_ns[-1]) < t_ns:
            self._reference.popleft()

    def _recorded_press(self, unloaded_after_ns: Span | None) -> Press:
        """Return the buffered samples as one press."""
        t_ns, capacitance_pf, reading = zip(*self._scans, strict=True)
        return Press(
            np.array(t_ns, np.int64),
            np.array(capacitance_pf),
            np.array(reading),
            join_references(self._reference),
            self._before_ns,
            (self._pressed_ns, self._released_ns),
            unloaded_after_ns,
            self._offset_samples_n(),
        )


def join_references(blocks: Iterable[ReferenceSamples]) -> ReferenceSamples:
    """Return the reference samples of several cycles as one block, sorted by time."""
    none = ReferenceSamples(np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros(0, np.bool_))
    t_ns, force_n, saturated = (np.concatenate(parts) for parts in zip(none, *blocks, strict=True))
    order = np.argsort(t_ns, kind="stable")
    return ReferenceSamples(t_ns[order], force_n[order], saturated[order])
