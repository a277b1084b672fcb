"""The tare: what every element of a foot reads while nothing presses it.

A tare averages a window of scans, and is refused with the numbers that decided it if the readings moved (the foot is
not quiet) or if they are not those of the free foot. Nothing here tracks drift: a baseline changes by a tare only, and
every tare is judged against the same expected readings, so that many small steps cannot lead into a load.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from footsense.frames import ELEMENTS, Command, CommandKind, Flag, Outcome, Reading, Result, State

Vector = NDArray[np.float64]

#: A leg that was silent for so many scans may come back with another foot: its baseline is forgotten.
_SILENT_SCANS = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class TareLimits:
    """When a tare is granted.

    Attributes:
        window_frames: Scans that are averaged, at least 2.
        noise_limit_ff: Largest standard deviation of any element over the window [fF].
        unloaded_limit_rel: Largest deviation of any element from what the free foot reads [1].
    """

    window_frames: int
    noise_limit_ff: float
    unloaded_limit_rel: float


@dataclass(frozen=True, slots=True)
class Verdict:
    """The end of a tare.

    Attributes:
        result: DONE, or why it was refused.
        reason: The same in words, with numbers.
        baseline_pf: The new baseline [pF], shape (9,), or None if refused.
    """

    result: Result
    reason: str
    baseline_pf: Vector | None = None


class TareWindow:
    """Collects the readings of one leg until there are enough to judge.

    Args:
        limits: When to grant.
        unloaded_pf: What the free foot is expected to read [pF], shape (9,).
    """

    def __init__(self, limits: TareLimits, unloaded_pf: Vector) -> None:
        self._limits = limits
        self._unloaded_pf = unloaded_pf
        self._readings_pf: list[Vector] = []

    def add(self, capacitance_pf: Vector, reading: NDArray[np.uint8]) -> Verdict | None:
        """Take one scan of the leg and return the verdict once the window is full.

        Args:
            capacitance_pf: Readings without stray [pF], shape (9,), NaN where there is none.
            reading: How each element answered, shape (9,).

        Returns:
            None while the window is not full; a reading that is missing ends the tare at once.
        """
        if (reading == Reading.NO_ANSWER).any():
            return Verdict(Result.ABSENT, "the leg does not answer")
        missing = np.flatnonzero(~np.isfinite(capacitance_pf))
        if missing.size:
            return Verdict(Result.ELEMENT_FAULT, f"elements {_names(missing)} give no reading")
        self._readings_pf.append(capacitance_pf)
        if len(self._readings_pf) < self._limits.window_frames:
            return None
        return self._judge(np.stack(self._readings_pf))

    def _judge(self, readings_pf: Vector) -> Verdict:
        noise_ff = readings_pf.std(axis=0, ddof=1) * 1e3
        worst = int(noise_ff.argmax())
        if noise_ff[worst] > self._limits.noise_limit_ff:
            return Verdict(
                Result.NOT_QUIET,
                f"the foot is not quiet: element {worst} varies by {noise_ff[worst]:.1f} fF rms, "
                f"at most {self._limits.noise_limit_ff:g} fF is allowed",
            )
        mean_pf = readings_pf.mean(axis=0)
        deviation_rel = mean_pf / self._unloaded_pf - 1
        worst = int(np.abs(deviation_rel).argmax())
        if abs(deviation_rel[worst]) > self._limits.unloaded_limit_rel:
            return Verdict(
                Result.LOADED,
                f"the foot is not unloaded: element {worst} reads {mean_pf[worst]:.3f} pF, "
                f"{deviation_rel[worst]:+.1%} from the {self._unloaded_pf[worst]:.3f} pF expected of the free foot "
                f"(unloaded_pf), at most {self._limits.unloaded_limit_rel:.1%} is allowed",
            )
        return Verdict(
            Result.DONE, f"tared over {len(readings_pf)} scans, {noise_ff.max():.2f} fF rms", mean_pf
        )


class Baselines:
    """The baselines of all legs, and the tares that are being taken.

    Every leg is tared at start, again and again until that succeeds.

    Args:
        unloaded_pf: What each element of the free foot is expected to read [pF], shape (legs, 9).
        limits: When a tare is granted.

    Attributes:
        baseline_pf: Unloaded capacitance without stray [pF], shape (legs, 9), NaN until a tare has succeeded.
        flags: TARE_REFUSED where an older baseline is in use, shape (legs,).
    """

    def __init__(self, unloaded_pf: Vector, limits: TareLimits) -> None:
        n_legs = len(unloaded_pf)
        self.baseline_pf = np.full((n_legs, ELEMENTS), np.nan)
        self.flags = np.zeros(n_legs, np.uint8)
        self._unloaded_pf = unloaded_pf
        self._limits = limits
        self._windows = {leg: self._window(leg) for leg in range(n_legs)}
        self._commanded: set[int] = set()
        self._refusal: dict[int, Result] = {}
        self._silent_scans = np.zeros(n_legs, np.int64)

    def begin(self, leg: int) -> None:
        """Tare a leg because it was asked for; a tare that is being taken already serves."""
        self._windows.setdefault(leg, self._window(leg))
        self._commanded.add(leg)

    def observe(self, capacitance_pf: Vector, reading: NDArray[np.uint8]) -> tuple[Outcome, ...]:
        """Take one scan of all legs [pF], shape (legs, 9), and return the tares that ended with it."""
        self._forget_silent(reading)
        outcomes = []
        for leg, window in list(self._windows.items()):
            verdict = window.add(capacitance_pf[leg], reading[leg])
            outcome = None if verdict is None else self._conclude(leg, verdict)
            if outcome is not None:
                outcomes.append(outcome)
        return tuple(outcomes)

    def mark_untared(self, state: NDArray[np.uint8]) -> None:
        """Write TARING or NO_BASELINE over the state of every leg without a baseline."""
        for leg in np.flatnonzero(np.isnan(self.baseline_pf[:, 0])).tolist():
            state[leg] = State.NO_BASELINE if leg in self._refusal else State.TARING

    def _window(self, leg: int) -> TareWindow:
        return TareWindow(self._limits, self._unloaded_pf[leg])

    def _forget_silent(self, reading: NDArray[np.uint8]) -> None:
        if not reading.any() and not self._silent_scans.any():
            return
        silent = (reading == Reading.NO_ANSWER).all(axis=1)
        self._silent_scans = np.where(silent, self._silent_scans + 1, 0)
        for leg in np.flatnonzero(self._silent_scans == _SILENT_SCANS).tolist():
            self.baseline_pf[leg] = np.nan
            self._refusal.pop(leg, None)
            self._windows.setdefault(leg, self._window(leg))

    def _conclude(self, leg: int, verdict: Verdict) -> Outcome | None:
        """Take or refuse a baseline; a tare that nobody asked for says the same refusal only once."""
        del self._windows[leg]
        commanded = leg in self._commanded
        self._commanded.discard(leg)
        repeated = self._refusal.get(leg) is verdict.result
        if verdict.baseline_pf is not None:
            self.baseline_pf[leg] = verdict.baseline_pf
            self.flags[leg] = 0
            self._refusal.pop(leg, None)
        elif np.isnan(self.baseline_pf[leg, 0]):
            if verdict.result is Result.ABSENT and not commanded:
                self._windows[leg] = self._window(leg)  # nothing was judged: the tare waits for the leg
                return None
            self._refusal[leg] = verdict.result
            self._windows[leg] = self._window(leg)
        else:
            self.flags[leg] = Flag.TARE_REFUSED
        if repeated and not commanded:
            return None
        return Outcome(Command(CommandKind.TARE, leg), verdict.result, verdict.reason)


def _names(elements: NDArray[np.intp]) -> str:
    return "0 to 8" if len(elements) == ELEMENTS else ", ".join(map(str, elements.tolist()))
