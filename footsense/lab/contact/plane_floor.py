"""Ground model: a rigid plane with Coulomb friction, whose position is an unknown of the solve.

The plane has the inward normal n and is moved by q from where it just touches the ball at X_c. A point X of the
surface that has moved by u lies d = -n.(X + u - X_c - q) behind it, and the traction per undeformed area is

    p = E_n <d>   along n,        t = -E_t s,  |t| <= mu p,        s = (1 - n n^T)(u - q) - anchor,

a penalty law with stiffness E_n = E_t = 50 E* / h on elements of size h. With h = 0.3 a the penetration in the
middle of a Hertz patch is 0.004 a^2/R, half a percent of the approach. The anchor is where a point sticks; after
each load step it follows the points that slip or are in the air: Coulomb's law in increments.

The derivative of the cap mu p is left out of the tangent, which keeps it symmetric and costs a step or two.
"""

import math
from typing import Any

import ngsolve as ng
import ngsolve.comp

from footsense.lab.contact.body import Body
from footsense.lab.contact.floor import GROUND_FACE, ContactPatch
from footsense.lab.contact.load_case import LoadCase

#: E_n h / E* [1].
PENALTY_STIFFNESS_REL = 50.0
#: Added under the root of |s|^2 [mm2], for its derivative at s = 0.
SLIP_REGULARISATION_MM2 = 1e-24
#: Halvings of the search for the floor's place before a load step.
MAX_BISECTIONS = 30


class PlaneFloor:
    """Rigid plane with Coulomb friction that presses on the ball.

    Attributes:
        target_n: Prescribed force on the meshed part along each free axis [N].
    """

    def __init__(self, case: LoadCase, body: Body, element_mm: float) -> None:
        """Create the floor where it just touches the unloaded ball.

        Args:
            case: Normal, force and friction.
            body: The foot, with the position of the floor along the free axes of the case among its unknowns.
            element_mm: Size of the elements under the patch [mm].
        """
        self._case, self._body, self._mesh = case, body, body.mesh
        self._moved = body.ground_relative_to_floor_mm
        self.target_n = [ng.Parameter(0.0) for _ in case.floor_axes]
        self._fraction = self._settled_fraction = 0.0
        self._stiffness = PENALTY_STIFFNESS_REL * case.design.rubber.plane_strain_modulus_mpa / element_mm
        region = self._mesh.Boundaries(GROUND_FACE)
        points = ngsolve.comp.IntegrationRuleSpaceSurface(
            self._mesh, order=2 * body.ground_displacement_mm.space.globalorder + 3, definedon=region
        )
        self._region = region
        self._anchor = ng.GridFunction(points**3)
        self._surface = ng.ds(GROUND_FACE, intrules=points.GetIntegrationRules())

    def _contact_pressure_mpa(self, u: Any) -> Any:
        """Return the contact pressure p [MPa] of a displacement relative to the floor."""
        here = ng.CF((ng.x, ng.y, ng.z)) - ng.CF(tuple(self._case.touch_point_mm))
        behind = -ng.InnerProduct(ng.CF(tuple(self._case.normal)), here + u)
        return self._stiffness * ng.IfPos(behind, behind, 0.0)

    def _tangential_displacement_mm(self, u: Any) -> Any:
        """Return the tangential part of a displacement relative to the floor [mm]."""
        n = ng.CF(tuple(self._case.normal))
        return u - ng.InnerProduct(u, n) * n

    def _friction_traction_mpa(self, u: Any) -> Any:
        """Return the friction traction [MPa] of a displacement, limited by the current iterate's pressure."""
        slid = self._tangential_displacement_mm(u) - self._anchor
        distance = ng.sqrt(ng.InnerProduct(slid, slid) + SLIP_REGULARISATION_MM2)
        cap = self._case.friction * self._contact_pressure_mpa(self._moved)
        return -slid * ng.IfPos(self._stiffness * distance - cap, cap / distance, self._stiffness)

    def virtual_work(self, u: Any, v: Any) -> Any:
        """Return the virtual work of contact pressure and friction along the test function v."""
        traction = self._contact_pressure_mpa(u) * ng.CF(
            tuple(self._case.normal)
        ) + self._friction_traction_mpa(u)
        return ng.InnerProduct(traction, v) * self._surface

    def _equal_area_radius_mm(self) -> float:
        """Return the radius of the circle with the same area as the contact patch [mm]."""
        touching = ng.IfPos(self._contact_pressure_mpa(self._moved), 1.0, 0.0)
        area = ng.Integrate(touching * self._surface, self._mesh) / self._case.meshed_share
        return math.sqrt(area / math.pi)

    def set_load_fraction(self, fraction: float) -> None:
        """Set the prescribed fraction of the force [1], and move the floor until the patch has the radius by Hertz.

        A Newton step depends on which points touch, not on how hard: with the right patch it nearly arrives.
        """
        self._fraction = fraction
        for axis, target_n in zip(self._case.floor_axes, self.target_n, strict=True):
            target_n.Set(fraction * self._case.meshed_share * self._case.force_n[axis])
        start, low, high = (
            self._body.floor_position_mm,
            0.0,
            self._case.hertz_radius_mm**2 / self._case.design.ball_radius_mm,
        )
        grown = self._case.hertz_radius_mm * math.cbrt(fraction)
        if self._settled_fraction > 0.0:
            grown = self._equal_area_radius_mm() * math.cbrt(fraction / self._settled_fraction)
        for _ in range(MAX_BISECTIONS):
            middle = 0.5 * (low + high)
            self._body.move_floor(start + middle * self._case.normal)
            low, high = (middle, high) if self._equal_area_radius_mm() < grown else (low, middle)

    def accept_load_step(self) -> None:
        """Update the friction state after a load step: slipping points keep at most Coulomb's friction."""
        anchor = (
            self._tangential_displacement_mm(self._moved)
            + self._friction_traction_mpa(self._moved) / self._stiffness
        )
        moved = ng.GridFunction(self._anchor.space)
        moved.Interpolate(anchor, definedon=self._region)
        self._anchor.vec.data = moved.vec
        self._settled_fraction = self._fraction

    def patch(self) -> ContactPatch:
        """Return radius, approach and peak pressure of the current contact patch."""
        # Point by point a penalty's pressure wavers about the true one; its linear projection does not.
        pressure = ng.GridFunction(ng.H1(self._mesh, order=1, definedon=self._region))
        pressure.Set(self._contact_pressure_mpa(self._moved), definedon=self._region, bonus_intorder=5)
        return ContactPatch(
            radius_mm=self._equal_area_radius_mm(),
            approach_mm=float(self._case.normal @ self._body.floor_position_mm),
            peak_pressure_mpa=float(pressure.vec.FV().NumPy().max()),
        )
