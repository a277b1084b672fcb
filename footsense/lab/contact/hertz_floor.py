"""Ground model with the prescribed traction of a Hertz contact, as the cheaper models assume it."""

import math
from typing import Any

import ngsolve as ng

from footsense.lab.contact.body import Body
from footsense.lab.contact.floor import GROUND_FACE, ContactPatch
from footsense.lab.contact.load_case import LoadCase
from footsense.lab.fem.elasticity import hertz_pressure_shape


class PrescribedHertzFloor:
    """Ground model that exerts a Hertz pressure p ~ sqrt(1 - r^2/a^2) along the force.

    Attributes:
        target_n: Empty: there is no plane to move.
    """

    def __init__(self, case: LoadCase, body: Body) -> None:
        """Centre the patch on the point where the floor touches; `body` has no floor position."""
        self._case, self._moved, self._mesh = case, body.ground_displacement_mm, body.mesh
        self.target_n: list[Any] = []
        self._fraction = ng.Parameter(0.0)
        shape = hertz_pressure_shape(case.touch_point_mm, case.hertz_radius_mm)
        self._surface = ng.ds(GROUND_FACE, bonus_intorder=20)
        self._weight = shape / (ng.Integrate(shape * self._surface, self._mesh) / case.meshed_share)

    def virtual_work(self, u: Any, v: Any) -> Any:
        """Return the virtual work of the fixed Hertz traction along the test function v."""
        del u
        traction = self._fraction * ng.CF(tuple(self._case.force_n)) * self._weight
        return ng.InnerProduct(traction, v) * self._surface

    def set_load_fraction(self, fraction: float) -> None:
        """Set the traction to a fraction of the load case's force [1]."""
        self._fraction.Set(fraction)

    def accept_load_step(self) -> None:
        """Do nothing: a frictionless prescribed pressure has no state."""

    def patch(self) -> ContactPatch:
        """Return radius, approach and peak pressure of the Hertz patch."""
        n = ng.CF(tuple(self._case.normal))
        mean_mm = ng.Integrate(ng.InnerProduct(self._moved, n) * self._weight * self._surface, self._mesh)
        radius_mm = self._case.hertz_radius_mm
        return ContactPatch(
            radius_mm=radius_mm,
            approach_mm=mean_mm / self._case.meshed_share
            + radius_mm**2 / (5.0 * self._case.design.ball_radius_mm),
            peak_pressure_mpa=1.5 * self._case.normal_force_n / (math.pi * radius_mm**2),
        )
