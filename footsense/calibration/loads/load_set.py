"""The loads of a foot as arrays, drift taken out: what a calibration is made of."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from footsense.calibration.loads.press import CalibrationLoad

Vector = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LoadSet:
    """CalibrationLoads that count.

    Attributes:
        force_n: What the reference felt [N], shape (n, 3), frame of the leg.
        sigma_n: Standard deviation of that mean, noise alone [N], shape (n, 3).
        capacitance_pf: What each element read [pF], shape (n, 9), stray included.
        rest_pf: What it reads unloaded at that time [pF], shape (n, 9).
    """

    force_n: Vector
    sigma_n: Vector
    capacitance_pf: Vector
    rest_pf: Vector

    @classmethod
    def of(cls, loads: Sequence[CalibrationLoad]) -> Self:
        """Take those of some loads that count."""
        good = [load for load in loads if load.rejection is None]
        return cls(
            force_n=np.array([load.force_n for load in good]).reshape(-1, 3),
            sigma_n=np.array([load.force_noise_n / np.sqrt(load.n_samples) for load in good]).reshape(-1, 3),
            capacitance_pf=np.array([load.capacitance_pf for load in good]).reshape(-1, 9),
            rest_pf=np.array([load.rest_pf for load in good]).reshape(-1, 9),
        )

    def __len__(self) -> int:
        """How many there are."""
        return len(self.force_n)

    def some(self, which: NDArray[np.intp] | NDArray[np.bool_]) -> Self:
        """Take some of them, by number or by mask."""
        return type(self)(
            force_n=self.force_n[which],
            sigma_n=self.sigma_n[which],
            capacitance_pf=self.capacitance_pf[which],
            rest_pf=self.rest_pf[which],
        )

    @property
    def unloaded_pf(self) -> Vector:
        """What each element of the free foot reads [pF], shape (9,): the median over the loads, drift left out."""
        unloaded_pf: Vector = np.median(self.rest_pf, axis=0)
        return unloaded_pf

    @property
    def undrifted_pf(self) -> Vector:
        """What each element would have read had it not drifted [pF], shape (n, 9)."""
        return self.capacitance_pf - self.rest_pf + self.unloaded_pf

    def spread(self) -> NDArray[np.intp]:
        """Return the loads in an order of which any beginning covers the forces well, shape (n,).

        The first is the one nearest to the mean; each next is the one farthest from all before it, by the angle between
        them and by their magnitudes.
        """
        size_n = np.linalg.norm(self.force_n, axis=1, keepdims=True)
        where = np.hstack([self.force_n / size_n, 0.5 * np.log(size_n)])
        order = [int(np.argmin(((where - where.mean(axis=0)) ** 2).sum(axis=1)))]
        away = np.full(len(self), np.inf)
        while len(order) < len(self):
            away = np.minimum(away, ((where - where[order[-1]]) ** 2).sum(axis=1))
            away[order[-1]] = -1.0
            order.append(int(np.argmax(away)))
        return np.array(order, dtype=np.intp)
