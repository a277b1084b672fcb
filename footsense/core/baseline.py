"""The tare: what every element of a foot reads while nothing presses it.

A tare averages a window of scans, and is refused with the numbers that decided it if the readings moved (the foot is
not quiet) or if they are not those of an unloaded foot. Nothing here tracks drift: a baseline changes by a tare only.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from footsense.frames import ELEMENTS, Result

Vector = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class TareLimits:
    """When a tare is granted.

    Attributes:
        window_frames: Scans that are averaged, at least 2.
        noise_limit_ff: Largest standard deviation of any element over the window [fF].
        unloaded_limit_rel: Largest deviation of any element from its reference [1].
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
    baseline_pf: Vector | None


class TareWindow:
    """Collects the readings of one leg until there are enough to judge.

    Args:
        limits: When to grant.
    """

    def __init__(self, limits: TareLimits) -> None:
        self._limits = limits
        self._readings_pf: list[Vector] = []

    def add(self, capacitance_pf: Vector, reference_pf: Vector) -> Verdict | None:
        """Take one scan of the leg and return the verdict once the window is full.

        Args:
            capacitance_pf: Readings without stray [pF], shape (9,), NaN where there is none.
            reference_pf: What an unloaded foot is expected to read [pF], shape (9,).

        Returns:
            None while the window is not full; a reading that is missing ends the tare at once.
        """
        missing = np.flatnonzero(~np.isfinite(capacitance_pf))
        if missing.size:
            return Verdict(Result.ELEMENT_FAULT, f"elements {_names(missing)} give no reading", None)
        self._readings_pf.append(capacitance_pf)
        if len(self._readings_pf) < self._limits.window_frames:
            return None
        return self._judge(np.stack(self._readings_pf), reference_pf)

    def _judge(self, readings_pf: Vector, reference_pf: Vector) -> Verdict:
        noise_ff = readings_pf.std(axis=0, ddof=1) * 1e3
        worst = int(noise_ff.argmax())
        if noise_ff[worst] > self._limits.noise_limit_ff:
            return Verdict(
                Result.NOT_QUIET,
                f"the foot is not quiet: element {worst} varies by {noise_ff[worst]:.1f} fF rms, "
                f"at most {self._limits.noise_limit_ff:g} fF is allowed",
                None,
            )
        mean_pf = readings_pf.mean(axis=0)
        deviation_rel = mean_pf / reference_pf - 1
        worst = int(np.abs(deviation_rel).argmax())
        if abs(deviation_rel[worst]) > self._limits.unloaded_limit_rel:
            return Verdict(
                Result.LOADED,
                f"the foot is not unloaded: element {worst} reads {mean_pf[worst]:.3f} pF, "
                f"{deviation_rel[worst]:+.1%} from the {reference_pf[worst]:.3f} pF of a free one, "
                f"at most {self._limits.unloaded_limit_rel:.1%} is allowed",
                None,
            )
        return Verdict(
            Result.DONE, f"tared over {len(readings_pf)} scans, {noise_ff.max():.2f} fF rms", mean_pf
        )


def _names(elements: NDArray[np.intp]) -> str:
    return "0 to 8" if len(elements) == ELEMENTS else ", ".join(map(str, elements.tolist()))
