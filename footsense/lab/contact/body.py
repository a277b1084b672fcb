"""Finite element space and weak form of a foot on the mesh of one load case.

Unknowns are the displacements of the two sides, which meet nowhere but through the spacer, and a pressure in the
rubber. Between the sides:

    bars       a layer of thickness t_s: (G [u_t].[v_t] + (lambda + 2 G) [u_n].[v_n]) / t_s
    cavities   unilateral contact of the electrode planes, k <[u_z] - g> [v_z], without friction, small sliding

with [u] = u_ground - u_leg and the gap g at rest. k is raised until no point is deeper than MAX_PENETRATION_REL g.
"""

from collections.abc import Sequence
from typing import Any

import ngsolve as ng
import ngsolve.comp
import numpy as np

from footsense.frames import Vector
from footsense.lab.contact.floor import GROUND_FACE, FloorModel
from footsense.lab.fem.elasticity import BondedLayer, mixed_strain_energy_density, strain_energy_density
from footsense.lab.geometry import FootDesign

#: Stiffness k of a closed gap to begin with [MPa/mm].
INITIAL_GAP_STIFFNESS_MPA_PER_MM = 200.0
#: Deepest penetration of a closed gap, over the gap [1].
MAX_PENETRATION_REL = 0.01


class Body:
    """The foot's finite element unknowns (displacements, pressure, floor position) and weak form.

    Attributes:
        design: The foot.
        mesh: Mesh of the whole foot, or of its half with y > 0.
        space: Displacement of the ground side, of the leg side, pressure of the rubber, and position of the floor along
            each free axis.
        state: The present iterate, a grid function of `space`.
    """

    def __init__(self, design: FootDesign, mesh: Any, order: int, axes: tuple[int, ...] = ()) -> None:
        self.design, self.mesh, self._axes = design, mesh, axes
        ground_displacement_mm = ng.VectorH1(
            mesh, order=order, definedon="rubber_ground|pdms_ground", dirichlety="mirror"
        )
        leg_displacement_mm = ng.VectorH1(
            mesh, order=order, definedon="rubber_leg|pdms_leg", dirichlet="curved_leg", dirichlety="mirror"
        )
        pressure = ng.H1(mesh, order=order - 1, definedon="rubber_ground|rubber_leg")
        # No ng.Compress here: it would lose what dirichlety holds.
        self.space = ground_displacement_mm * leg_displacement_mm * pressure
        for _ in axes:
            self.space *= ng.NumberSpace(mesh)
        self.state = ng.GridFunction(self.space)
        self._gap_stiffness = ng.Parameter(INITIAL_GAP_STIFFNESS_MPA_PER_MM)
        self._points = ngsolve.comp.IntegrationRuleSpaceSurface(
            mesh, order=2 * order + 2, definedon=mesh.Boundaries("cavity")
        )

    @property
    def ground_displacement_mm(self) -> Any:
        """Current displacement of the ground-side body [mm], a grid function."""
        return self.state.components[0]

    @property
    def leg_displacement_mm(self) -> Any:
        """Current displacement of the leg-side body [mm], a grid function."""
        return self.state.components[1]

    def weak_form(self, floor: FloorModel, *, finite_strain: bool, gap_contact: bool) -> Any:
        """Return the nonlinear weak form: internal virtual work minus that of the ground contact."""
        trial, test = self.space.TnT()
        (u_ground, u_leg, p, *_), (v_ground, v_leg, *_) = trial, test
        weak_form = ng.BilinearForm(self.space, symmetric=True)
        rubber, pdms = self.design.rubber, self.design.pdms
        for side, u in (("ground", u_ground), ("leg", u_leg)):
            mixed = mixed_strain_energy_density(rubber, u, p, finite_strain=finite_strain).Compile()
            plain = strain_energy_density(pdms, u, finite_strain=finite_strain).Compile()
            weak_form += ng.Variation(mixed * ng.dx(f"rubber_{side}"))
            weak_form += ng.Variation(plain * ng.dx(f"pdms_{side}"))
        jump, jump_v = u_ground - u_leg, v_ground - v_leg
        bars = BondedLayer(pdms, self.design.spacer_mm)
        weak_form += bars.traction(jump) * jump_v * ng.ds(bars.face_pattern)
        if gap_contact:
            deep = jump[2] - self.design.gap_um * 1e-3
            stress = self._gap_stiffness * ng.IfPos(deep, deep, 0.0)
            weak_form += stress * jump_v[2] * ng.ds("cavity", intrules=self._points.GetIntegrationRules())
        weak_form += floor.virtual_work(self._relative_to_floor(trial), -self._relative_to_floor(test))
        area_mm2 = ng.Integrate(ng.CF(1.0) * ng.ds(GROUND_FACE), self.mesh)
        for target_n, e in zip(floor.target_n, test[3:], strict=True):
            weak_form += -target_n / area_mm2 * e * ng.ds(GROUND_FACE)
        return weak_form

    def _relative_to_floor(self, functions: Sequence[Any]) -> Any:
        """Return the ground-side displacement relative to the floor [mm], from functions of `space`."""
        floor = [ng.CF(0.0)] * 3
        for axis, position in zip(self._axes, functions[3:], strict=True):
            floor[axis] = position
        return functions[0] - ng.CF(tuple(floor))

    @property
    def ground_relative_to_floor_mm(self) -> Any:
        """Current ground-side displacement relative to the floor [mm]."""
        return self._relative_to_floor(self.state.components)

    @property
    def floor_position_mm(self) -> Vector:
        """Current position of the floor [mm], shape (3,)."""
        position = np.zeros(3)
        for axis, component in zip(self._axes, self.state.components[3:], strict=True):
            position[axis] = component.vec[0]
        return position

    def move_floor(self, position_mm: Vector) -> None:
        """Set the position of the floor [mm], shape (3,), along the axes in which it may move."""
        for axis, component in zip(self._axes, self.state.components[3:], strict=True):
            component.vec[0] = float(position_mm[axis])

    def penetration_rel(self) -> float:
        """Return the deepest overlap of the two electrode planes over the gap [1]; negative while the gap is open."""
        gap_mm = self.design.gap_um * 1e-3
        deep = ng.GridFunction(self._points)
        deep.Interpolate(
            self.ground_displacement_mm[2] - self.leg_displacement_mm[2] - gap_mm,
            definedon=self.mesh.Boundaries("cavity"),
        )
        return float(np.max(deep.vec.FV().NumPy())) / gap_mm

    def stiffen_gaps(self, factor: float) -> None:
        """Multiply the penalty stiffness of closed gaps by a factor."""
        self._gap_stiffness.Set(self._gap_stiffness.Get() * factor)
