"""The Hertz patch in place of a floor: the traction that the cheaper models assume."""

import math
from typing import Any

import ngsolve as ng
import numpy as np
from numpy.typing import NDArray

from footsense.lab.contact.floor import FACE, Patch
from footsense.lab.contact.load_case import LoadCase
from footsense.lab.fem.elasticity import hertz_shape


class HertzFloor:
    """The traction that a Hertz patch would exert: p ~ sqrt(1 - r^2/a^2), along the force.

    Attributes:
        axes: None: there is no plane to move.
        target_n: No prescribed force, shape (0,).
    """

    def __init__(self, case: LoadCase, moved: Any) -> None:
        """Lay the patch where the floor would touch; `moved` as for the plane."""
        self._case, self._moved, self._mesh = case, moved, moved.space.mesh
        self.axes: tuple[int, ...] = ()
        self.target_n = np.zeros(0)
        self._fraction = ng.Parameter(0.0)
        shape = hertz_shape(case.touch_mm, case.hertz_mm)
        self._surface = ng.ds(FACE, bonus_intorder=20)
        self._weight = shape / (ng.Integrate(shape * self._surface, self._mesh) / case.share)

    def work(self, u: Any, v: Any) -> Any:
        """Return the work along v of a traction that does not depend on u."""
        del u
        traction = self._fraction * ng.CF(tuple(self._case.force_n)) * self._weight
        return ng.InnerProduct(traction, v) * self._surface

    def aim(self, fraction: float) -> None:
        """Exert this fraction of the force."""
        self._fraction.Set(fraction)

    def move(self, step_mm: NDArray[np.float64]) -> None:
        """Do nothing: the Hertz pressure does not move."""

    def settle(self) -> None:
        """Do nothing: a pressure without friction has no state."""

    def withdraw(self) -> None:
        """Do nothing: the next `aim` sets the force."""

    def patch(self) -> Patch:
        """Return the patch; a parabolic floor would have come a^2/(5R) further than loaded points on average."""
        n = ng.CF(tuple(self._case.normal))
        mean_mm = ng.Integrate(ng.InnerProduct(self._moved, n) * self._weight * self._surface, self._mesh)
        radius_mm = self._case.hertz_mm
        return Patch(
            radius_mm=radius_mm,
            approach_mm=mean_mm / self._case.share + radius_mm**2 / (5.0 * self._case.design.ball_radius_mm),
            peak_mpa=1.5 * self._case.pressing_n / (math.pi * radius_mm**2),
        )
