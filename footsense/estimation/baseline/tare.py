"""The tare: what every element of a foot reads while nothing presses it.

A tare averages a window of scans, and is refused with the numbers that decided it if the readings moved (the foot is
not quiet) or if they are not those of the free foot. Every tare is judged against the same expected readings, so that
many small steps cannot lead into a load. Elements that are missing are left out; they have no zero until they are back.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from footsense.estimation.faults.leg_status import OPEN_REL, SILENT
from footsense.frames import ELEMENTS, Reading, Result

Vector = NDArray[np.float64]


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
        zero_pf: The new zero [pF], shape (9,), NaN for elements that were missing; None if refused.
    """

    result: Result
    reason: str
    zero_pf: Vector | None = None


class TareWindow:
    """Collects the readings of one leg until there are enough to judge.

    Args:
        limits: When to grant.
        unloaded_pf: What the free foot is expected to read [pF], shape (9,).
        foot: The foot whose fingerprint that is; empty where it is that of any foot.
    """

    def __init__(self, limits: TareLimits, unloaded_pf: Vector, foot: str = "") -> None:
        self._limits = limits
        self._foot = foot
        self._unloaded_pf = unloaded_pf
        self._readings_pf: list[Vector] = []
        self._missing = np.zeros(ELEMENTS, bool)
        self._newest_ns = 0

    def add(
        self,
        capacitance_pf: Vector,
        reading: NDArray[np.uint8],
        t_ns: NDArray[np.int64],
        missing: NDArray[np.bool_],
    ) -> Verdict | None:
        """Take a frame of the leg and return the verdict once the window is full.

        Args:
            capacitance_pf: Readings without stray [pF], shape (9,), NaN where there is none.
            reading: How each element answered, shape (9,).
            t_ns: Stamp of each [ns], shape (9,).
            missing: Elements that the tare has to do without, shape (9,).

        Returns:
            None while the window is not full. A frame counts if every element has been read anew since the one that
            counted before; a reading that failed ends the tare at once.
        """
        if np.isin(reading, SILENT).any():
            return Verdict(Result.ABSENT, "the leg does not answer")
        failed = np.flatnonzero((reading != Reading.OK) & ~missing)
        if failed.size:
            return Verdict(Result.ELEMENT_FAULT, f"elements {_names(failed)} give no reading")
        if not (np.isfinite(capacitance_pf) | missing).all() or t_ns[~missing].min() <= self._newest_ns:
            return None
        self._newest_ns = int(t_ns.max())
        self._missing = self._missing | missing
        self._readings_pf.append(capacitance_pf)
        if len(self._readings_pf) < self._limits.window_frames:
            return None
        return self._judge(np.stack(self._readings_pf))

    def _judge(self, readings_pf: Vector) -> Verdict:
        noise_ff = np.where(self._missing, 0.0, readings_pf.std(axis=0, ddof=1) * 1e3)
        worst = int(noise_ff.argmax())
        if noise_ff[worst] > self._limits.noise_limit_ff:
            return Verdict(
                Result.NOT_QUIET,
                f"the foot is not quiet: element {worst} varies by {noise_ff[worst]:.1f} fF rms, "
                f"at most {self._limits.noise_limit_ff:g} fF is allowed",
            )
        zero_pf = np.where(self._missing, np.nan, readings_pf.mean(axis=0))
        deviation_rel = np.where(self._missing, 0.0, zero_pf / self._unloaded_pf - 1)
        worst = int(np.abs(deviation_rel).argmax())
        if abs(deviation_rel[worst]) > self._limits.unloaded_limit_rel:
            opened = deviation_rel[worst] < OPEN_REL - 1
            what = "the foot is not unloaded" + (f", or another than {self._foot}" if self._foot else "")
            return Verdict(
                Result.ELEMENT_FAULT if opened else Result.LOADED,
                f"{'an element is open' if opened else what}: element {worst} reads "
                f"{zero_pf[worst]:.3f} pF, {deviation_rel[worst]:+.1%} from the {self._unloaded_pf[worst]:.3f} pF "
                f"expected of {self._foot or 'the free foot (unloaded_pf)'}, "
                f"at most {self._limits.unloaded_limit_rel:.1%} is allowed",
            )
        without = f" without elements {_names(np.flatnonzero(self._missing))}" if self._missing.any() else ""
        return Verdict(
            Result.DONE, f"tared over {len(readings_pf)} scans, {noise_ff.max():.2f} fF rms{without}", zero_pf
        )


def _names(elements: NDArray[np.intp]) -> str:
    return "0 to 8" if len(elements) == ELEMENTS else ", ".join(map(str, elements.tolist()))
