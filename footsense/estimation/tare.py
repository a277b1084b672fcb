"""Tare: a baseline from the mean reading of every element of an unloaded foot.

A tare averages a window of scans. It is refused, with the numbers that decided it, if the readings move (the foot is
not quiet) or differ from those of the free foot. Every tare is compared with the same expected readings, so that many
small steps cannot lead into a load. Missing elements are left out; they have no baseline until they are back.

Every tare ends: with a baseline, or with a refusal, at the latest after `MAX_WINDOWS` times the window and the time in
which a reading settles. One that waited for as long as it takes would be done by itself, when nobody expects it.

A leg without a baseline, as after a restart while the robot walks, is tared by itself in one of its next swings. Its
window moves on by a quarter after a refusal by the readings. Where a window takes more than a tenth of a second, which
a swing of a fast gait takes, half of one is enough; a load that changes slowly moves its readings by half, so that half
of the noise is allowed.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from footsense.estimation.elements import OPEN_ELEMENT_THRESHOLD_REL
from footsense.estimation.network import READINGS
from footsense.estimation.settings import LONG_SILENCE_NS, MEMORY_S, SLOW_PERIOD_NS, MountedFeet, TareLimits
from footsense.frames import (
    ELEMENTS,
    CapFrame,
    Codes,
    Command,
    CommandKind,
    CommandResult,
    Mask,
    Reading,
    Result,
    Stamps,
    State,
    Vector,
)
from footsense.leg_words import IS_SILENT

#: Time that a tare may take over that of its window [1], and scans in which a step has passed through the readings.
MAX_WINDOWS = 3
SETTLING_SCANS = READINGS + 1
#: Refusals that the readings of another scan may undo.
_BY_READINGS = (Result.NOT_QUIET, Result.LOADED)
# Plain numbers: to compare with an enumeration's member costs a microsecond each time.
_BUS_STUCK, _SILENT = int(Reading.BUS_STUCK), frozenset(np.flatnonzero(IS_SILENT).tolist())


class TareResult(NamedTuple):
    """Result of a tare: new baseline [pF], or the reason for its refusal.

    Attributes:
        result: DONE, or why it was refused.
        reason: The same in words, with numbers.
        baseline_pf: The new baseline [pF], shape (elements,), NaN for elements that were missing; None if refused.
    """

    result: Result
    reason: str
    baseline_pf: Vector | None = None


class TareWindow:
    """Collects one leg's readings for a tare until there are enough scans.

    Args:
        limits: Limits.
        unloaded_pf: Expected reading of the free foot [pF], shape (elements,).
        scan_ns: Time of a scan [ns].
        foot: Name of the foot that `unloaded_pf` was measured on; empty where it is a design value.
    """

    def __init__(self, limits: TareLimits, unloaded_pf: Vector, scan_ns: int, foot: str = "") -> None:
        self._limits = limits
        self._n_scans, self._scan_ns = limits.window_scans, scan_ns
        self._longest_ns = (MAX_WINDOWS * limits.window_scans + SETTLING_SCANS) * scan_ns
        self._started_ns = 0  # at the first frame
        self._n_unsteady = np.zeros(ELEMENTS, np.int64)
        self._foot = foot
        self._unloaded_pf = unloaded_pf
        self._readings_pf: list[Vector] = []
        self._newest_ns = 0

    def go_on(self) -> None:
        """Wait for further scans after a refusal by the readings, of which the newest are kept."""
        shorter = max(self._limits.window_scans // 2, SLOW_PERIOD_NS // self._scan_ns, 2)
        self._n_scans = min(self._limits.window_scans, shorter)
        self._readings_pf = self._readings_pf[max(self._n_scans // 4, 1) - self._n_scans :]
        self._started_ns, self._n_unsteady = 0, np.zeros(ELEMENTS, np.int64)

    def add(
        self,
        capacitance_pf: Vector,
        reading: Codes,
        t_ns: Stamps,
        unusable: Mask,
        now_ns: int,
    ) -> TareResult | None:
        """Add the leg's readings of one scan; return the result once there are enough scans or too few, else None.

        Args:
            capacitance_pf: Readings without stray [pF], shape (elements,), NaN where there is none.
            reading: How each element answered, shape (elements,).
            t_ns: Stamp of each [ns], shape (elements,).
            unusable: Elements to leave out, shape (elements,).
            now_ns: Current time [ns].

        Returns:
            None while the window is not full and has time. A frame counts if every element has been read anew since
            the one before; a failed reading ends the tare at once.
        """
        if not _SILENT.isdisjoint(reading.tobytes()):
            return TareResult(Result.ABSENT, "the leg does not answer")
        failed = np.flatnonzero((reading != Reading.OK) & ~unusable)
        if failed.size:
            return TareResult(Result.ELEMENT_FAULT, f"elements {_element_list_text(failed)} give no reading")
        self._started_ns = self._started_ns or now_ns
        unsteady = ~(np.isfinite(capacitance_pf) | unusable)
        if not unsteady.any() and t_ns[~unusable].min() > self._newest_ns:
            self._newest_ns = int(t_ns.max())
            self._readings_pf.append(np.where(unusable, np.nan, capacitance_pf))
            if len(self._readings_pf) == self._n_scans:
                return self._tare_result(np.stack(self._readings_pf))
        self._n_unsteady += unsteady
        if now_ns - self._started_ns < self._longest_ns:
            return None
        most = self._n_unsteady.max()
        late = self._n_unsteady == most if most else ~unusable & (t_ns <= self._newest_ns)
        return TareResult(
            Result.ELEMENT_FAULT,
            f"elements {_element_list_text(np.flatnonzero(late))} give no steady readings: "
            f"{len(self._readings_pf)} of {self._n_scans} scans in {self._longest_ns * 1e-9:.1f} s",
        )

    def _tare_result(self, readings_pf: Vector) -> TareResult:
        """Return the result of a tare from the collected readings [pF], shape (scans, elements), NaN where left out."""
        is_left_out = np.isnan(readings_pf).any(axis=0)
        noise_ff = np.where(is_left_out, 0.0, readings_pf.std(axis=0, ddof=1) * 1e3)
        worst, limits = int(noise_ff.argmax()), self._limits
        limit_ff = limits.noise_limit_ff * self._n_scans / limits.window_scans
        if noise_ff[worst] > limit_ff:
            return TareResult(
                Result.NOT_QUIET,
                f"the foot is not quiet: element {worst} varies by {noise_ff[worst]:.1f} fF rms, "
                f"at most {limit_ff:g} fF is allowed",
            )
        baseline_pf = np.where(is_left_out, np.nan, readings_pf.mean(axis=0))
        deviation_rel = np.where(is_left_out, 0.0, baseline_pf / self._unloaded_pf - 1)
        worst = int(np.abs(deviation_rel).argmax())
        what = "the foot is not unloaded" + (f", or another than {self._foot}" if self._foot else "")
        if abs(deviation_rel[worst]) > self._limits.unloaded_limit_rel:
            opened = deviation_rel[worst] < OPEN_ELEMENT_THRESHOLD_REL - 1
            return TareResult(
                Result.ELEMENT_FAULT if opened else Result.LOADED,
                f"{'an element is open' if opened else what}: element {worst} reads "
                f"{baseline_pf[worst]:.3f} pF, {deviation_rel[worst]:+.1%} from the {self._unloaded_pf[worst]:.3f} pF "
                f"expected of {self._foot or 'the free foot (unloaded_pf)'}, "
                f"at most {self._limits.unloaded_limit_rel:.1%} is allowed",
            )
        mean_rel = float(deviation_rel[~is_left_out].mean())
        if mean_rel > self._limits.mean_limit_rel:
            return TareResult(
                Result.LOADED,
                f"{what}: its elements read {mean_rel:+.1%} on average from what is expected of "
                f"{self._foot or 'the free foot (unloaded_pf)'}, at most {self._limits.mean_limit_rel:+.1%} is allowed",
            )
        left_out = _element_list_text(np.flatnonzero(is_left_out))
        without = f" without elements {left_out}" if left_out else ""
        return TareResult(
            Result.DONE,
            f"tared over {len(readings_pf)} scans, {noise_ff.max():.2f} fF rms{without}",
            baseline_pf,
        )


class Tares:
    """Tares in progress: of every leg at start, repeated until successful, and later on command.

    Args:
        limits: Limits.
        feet: The feet.
        scan_ns: Time of a scan [ns].

    Attributes:
        in_progress: Window of every tare in progress, by leg.
        untared: Legs without a baseline.
        refused: Legs with a refused tare that keep an older baseline.
        heard_ns: Time at which each leg last answered [ns].
    """

    def __init__(self, limits: TareLimits, feet: MountedFeet, scan_ns: int) -> None:
        self._limits, self._feet, self._scan_ns = limits, feet, scan_ns
        self.heard_ns = [0] * len(feet.names)
        self.untared = set(range(len(feet.names)))
        self.refused: set[int] = set()
        self.in_progress = {leg: self._new_window(leg) for leg in self.untared}
        self._commanded: set[int] = set()
        self._refusals: dict[int, Result] = {}

    @property
    def states(self) -> dict[int, State]:
        """State of every leg without a baseline, by row: TARING, or NO_BASELINE after a refused tare."""
        return {leg: State.NO_BASELINE if leg in self._refusals else State.TARING for leg in self.untared}

    def command(self, leg: int) -> None:
        """Start a tare on command, unless one on command is in progress already: both then end together."""
        if leg not in self._commanded:
            self.in_progress[leg] = self._new_window(leg)
        self._commanded.add(leg)

    def refuse(self, leg: int) -> None:
        """Refuse a tare of a leg with a baseline, and with it the one in progress: the refusal answers both."""
        self.refused.add(leg)
        self._commanded.discard(leg)
        self.in_progress.pop(leg, None)

    def restart_silent_legs(self, reading: Codes, now_ns: int) -> list[int]:
        """Start a new tare of every leg silent for too long, whose baseline is to be discarded; return these legs.

        Args:
            reading: How each element answered, shape (legs, elements).
            now_ns: Current time [ns].
        """
        in_turn, lost = reading.tobytes(), []
        for leg, heard_ns in enumerate(self.heard_ns):
            codes = in_turn[ELEMENTS * leg : ELEMENTS * (leg + 1)]
            if not _SILENT.issuperset(codes):
                self.heard_ns[leg] = now_ns
                continue
            # A stuck bus may be the fault of another leg: a robot that stands would lose all its forces until each foot
            # has swung.
            allowed_ns = 1e9 * MEMORY_S if _BUS_STUCK in codes else LONG_SILENCE_NS
            if now_ns - heard_ns >= allowed_ns and leg not in self.untared:
                lost.append(leg)
                self.untared.add(leg)
                self._refusals.pop(leg, None)
                self.in_progress.setdefault(leg, self._new_window(leg))
        return lost

    def add(
        self,
        scan: CapFrame,
        unusable: Mask,
        now_ns: int,
        contact_refusal: Callable[[int], str | None],
    ) -> tuple[dict[int, Vector], tuple[CommandResult, ...]]:
        """Add a frame of all legs to the tares in progress; return new baselines by leg [pF], and the results.

        A tare without a command repeats a refusal silently, and waits silently for a leg that does not answer.

        Args:
            scan: The frame, its readings without stray, NaN where there is none.
            unusable: Elements to leave out, shape (legs, elements).
            now_ns: Current time [ns].
            contact_refusal: Returns why a leg must not be tared now, as its foot is in contact; None if it may.
        """
        tared_pf, results = {}, []
        for leg, window in list(self.in_progress.items()):
            of_leg = scan.capacitance_pf[leg], scan.reading[leg], scan.t_ns[leg], unusable[leg]
            tared = window.add(*of_leg, now_ns)
            if tared is None:
                continue
            if tared.baseline_pf is not None and (in_contact := contact_refusal(leg)):
                tared = TareResult(Result.LOADED, in_contact)
            del self.in_progress[leg]
            commanded = leg in self._commanded
            self._commanded.discard(leg)
            before = self._refusals.get(leg)
            # Of a foot that is loaded and moves now and then it is no news that it moves.
            is_known = tared.result is before or (before, tared.result) == (Result.LOADED, Result.NOT_QUIET)
            is_news = commanded or not is_known
            if tared.baseline_pf is not None:
                self.untared.discard(leg)
                self.refused.discard(leg)
                self._refusals.pop(leg, None)
                tared_pf[leg] = tared.baseline_pf
            elif leg not in self.untared:
                self.refused.add(leg)
            else:
                if tared.result in _BY_READINGS:
                    window.go_on()
                    self.in_progress[leg] = window
                else:
                    self.in_progress[leg] = self._new_window(leg)
                if commanded or tared.result is not Result.ABSENT:
                    self._refusals[leg] = tared.result if is_news or before is None else before
                else:
                    is_news = False
            if is_news:
                results.append(CommandResult(Command(CommandKind.TARE, leg), tared.result, tared.reason))
        return tared_pf, tuple(results)

    def _new_window(self, leg: int) -> TareWindow:
        return TareWindow(self._limits, self._feet.unloaded_pf[leg], self._scan_ns, self._feet.names[leg])


def _element_list_text(elements: NDArray[np.intp]) -> str:
    return f"0 to {ELEMENTS - 1}" if len(elements) == ELEMENTS else ", ".join(map(str, elements.tolist()))
