"""The Hertz patch in place of a floor: the traction that the cheaper models assume."""

import math
from typing import Any

import ngsolve as ng

from footsense.lab.contact.body import Body
from footsense.lab.contact.floor import GROUND_FACE, ContactPatch
from footsense.lab.contact.load_case import LoadCase
from footsense.lab.fem.elasticity import hertz_pressure_shape


class HertzFloor:
    """The traction that a Hertz patch would exert: p ~ sqrt(1 - r^2/a^2), along the force.

    Attributes:
        target_n: Empty: there is no plane to move.
    """

    def __init__(self, case: LoadCase, body: Body) -> None:
        """Lay the patch where the floor would touch; `body` without a position of the floor."""
        self._case, self._moved, self._mesh = case, body.ground_displacement_mm, body.mesh
        self.target_n: list[Any] = []
        self._fraction = ng.Parameter(0.0)
        shape = hertz_pressure_shape(case.touch_point_mm, case.hertz_radius_mm)
        self._surface = ng.ds(GROUND_FACE, bonus_intorder=20)
        self._weight = shape / (ng.Integrate(shape * self._surface, self._mesh) / case.meshed_share)

    def work(self, u: Any, v: Any) -> Any:
        """Return the work along v of a traction that does not depend on u."""
        del u
        traction = self._fraction * ng.CF(tuple(self._case.force_n)) * self._weight
        return ng.InnerProduct(traction, v) * self._surface

    def set_load_fraction(self, fraction: float) -> None:
        """Exert this fraction of the load case's force."""
        self._fraction.Set(fraction)

    def accept_load_step(self) -> None:
        """Do nothing: a pressure without friction has no state."""

    def patch(self) -> ContactPatch:
        """Return the patch; a parabolic floor would have come a^2/(5R) further than loaded points on average."""
        n = ng.CF(tuple(self._case.normal))
        mean_mm = ng.Integrate(ng.InnerProduct(self._moved, n) * self._weight * self._surface, self._mesh)
        radius_mm = self._case.hertz_radius_mm
        return ContactPatch(
            radius_mm=radius_mm,
            approach_mm=mean_mm / self._case.meshed_share
            + radius_mm**2 / (5.0 * self._case.design.ball_radius_mm),
            peak_pressure_mpa=1.5 * self._case.normal_force_n / (math.pi * radius_mm**2),
        )
