"""Array form of the accepted calibration loads of a foot."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from footsense.calibration.loads.press import CalibrationLoad
from footsense.foot.directions import normalized
from footsense.frames import ELEMENTS, Mask, Vector


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LoadSet:
    """Accepted calibration loads of one foot as arrays, one row per load.

    Attributes:
        force_n: Reference force [N], shape (n, 3), leg frame.
        sigma_n: Standard deviation of that mean by noise alone [N], shape (n, 3).
        capacitance_pf: Reading of each element, stray included [pF], shape (n, 9).
        baseline_pf: Unloaded reading at that time [pF], shape (n, 9).
    """

    force_n: Vector
    sigma_n: Vector
    capacitance_pf: Vector
    baseline_pf: Vector

    @classmethod
    def from_loads(cls, loads: Sequence[CalibrationLoad]) -> Self:
        """Return a list of calibration loads in array form."""
        widths = {"force_n": 3, "sigma_n": 3, "capacitance_pf": ELEMENTS, "baseline_pf": ELEMENTS}
        return cls(
            **{
                name: np.array([getattr(load, name) for load in loads]).reshape(-1, width)
                for name, width in widths.items()
            }
        )

    @classmethod
    def joined(cls, sets: Sequence[Self]) -> Self:
        """Return the loads of several sets, one behind the other."""
        return cls(**{name: np.concatenate([getattr(one, name) for one in sets]) for name in cls.__slots__})

    def __len__(self) -> int:
        """Return the number of loads."""
        return len(self.force_n)

    def subset(self, which: NDArray[np.intp] | Mask) -> Self:
        """Return the selected loads, by index or by mask."""
        return type(self)(**{name: getattr(self, name)[which] for name in self.__slots__})

    @property
    def median_baseline_pf(self) -> Vector:
        """Median unloaded reading of each element over the loads [pF], shape (9,)."""
        unloaded_pf: Vector = np.median(self.baseline_pf, axis=0)
        return unloaded_pf

    @property
    def drift_corrected_pf(self) -> Vector:
        """Readings under load, corrected for drift of the unloaded reading [pF], shape (n, 9)."""
        return self.capacitance_pf - self.baseline_pf + self.median_baseline_pf

    def space_filling_order(self) -> NDArray[np.intp]:
        """Return an order of the loads, shape (n,), whose first k cover the forces evenly for any k.

        The first load is the nearest to the mean; each next one is the farthest from all before it, by direction and
        magnitude (farthest-point sampling).
        """
        log_magnitude = np.log(np.linalg.norm(self.force_n, axis=1, keepdims=True))
        points = np.hstack([normalized(self.force_n), 0.5 * log_magnitude])
        order = [int(np.argmin(((points - points.mean(axis=0)) ** 2).sum(axis=1)))]
        distance = np.full(len(self), np.inf)
        while len(order) < len(self):
            distance = np.minimum(distance, ((points - points[order[-1]]) ** 2).sum(axis=1))
            distance[order[-1]] = -1.0
            order.append(int(np.argmax(distance)))
        return np.array(order, dtype=np.intp)
