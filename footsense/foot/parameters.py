"""Calibration parameters by which one foot differs from its design, and what they make of a force.

Stray, unloaded reading, gap and gain belong to the electrodes and act before the network, the rest behind it. With p
the force that the network of the design estimates from the foot's own closures,

    f = M p,        M = (1 + stiffness) * mount^T

M is exact for a linear solid, even where gaps close at the design's closures. A layer that learnt the residual by
cross-validated ridge regression found nothing in most feet, and made leaning loads worse where rubber creeps: 2.0 deg
in place of 1.8.
"""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from footsense.frames import ELEMENTS, Vector


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FootParameters:
    """Calibration parameters of one foot: stray, baseline, gaps, gains, stiffness, mounting, remaining error.

    Attributes:
        stray_pf: Capacitance of the wiring in parallel with each element [pF], shape (elements,).
        unloaded_pf: Reading of each element of the unloaded foot, stray included [pF], shape (elements,).
        gap_um: Air gap of each element [um], shape (elements,).
        gain_rel: Closure of each element by the design's electrodes over its real closure [1], shape (elements,).
        stiffness_rel: Stiffness of the whole foot over the design's, minus one [1].
        mount: Rotation from the leg's frame to the foot's, shape (3, 3).
        error_rel: Standard deviation of the remaining error over the force [1].
    """

    stray_pf: Vector
    unloaded_pf: Vector
    gap_um: Vector
    gain_rel: Vector = field(default_factory=lambda: np.ones(ELEMENTS))
    stiffness_rel: float = 0.0
    mount: Vector = field(default_factory=lambda: np.eye(3))
    error_rel: float = 0.0

    def __post_init__(self) -> None:
        """Check the physical limits.

        Raises:
            ValueError: A value is impossible; the message names it.
        """
        for name, smallest in (("gap_um", self.gap_um.min()), ("gain_rel", self.gain_rel.min())):
            if smallest <= 0.0:
                raise ValueError(f"{name}: has to be above 0, got {smallest:g}")
        if (self.unloaded_pf <= self.stray_pf).any():
            raise ValueError("unloaded_pf: has to be above stray_pf at every element")
        if not self.stiffness_rel > -1.0:
            raise ValueError(f"stiffness_rel: has to be above -1, got {self.stiffness_rel:g}")
        mirrored = np.linalg.det(self.mount) < 0.0
        if mirrored or not np.allclose(self.mount @ self.mount.T, np.eye(3), atol=1e-6):
            raise ValueError("mount: is no rotation")
        if not self.error_rel >= 0.0:
            raise ValueError(f"error_rel: is a standard deviation, not below 0, got {self.error_rel:g}")

    @property
    def force_matrix(self) -> Vector:
        """Matrix, shape (3, 3), from the force estimated by the design's network to the force in the leg's frame."""
        matrix: Vector = (1.0 + self.stiffness_rel) * self.mount.T
        return matrix

    def as_lists(self) -> dict[str, Any]:
        """Return all parameters as lists and floats by name, for a JSON file."""
        return {name: np.asarray(getattr(self, name)).tolist() for name in self.__slots__}
