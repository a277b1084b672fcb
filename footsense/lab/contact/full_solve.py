"""Solution of one load case from mesh to capacitances: mesh, load steps, equilibrium, evaluation."""

from dataclasses import KW_ONLY, dataclass, field
from typing import Literal

import numpy as np

from footsense.frames import Vector
from footsense.lab.contact.body import MAX_PENETRATION_REL, Body
from footsense.lab.contact.element_closures import capacitance_pf, cell_means, sampled_closure_um
from footsense.lab.contact.equilibrium import ConvergenceError, Equilibrium
from footsense.lab.contact.floor import ContactPatch, FloorModel
from footsense.lab.contact.hertz_floor import PrescribedHertzFloor
from footsense.lab.contact.load_case import LoadCase
from footsense.lab.contact.mesh import ContactMeshSize, build_mesh
from footsense.lab.contact.plane_floor import PlaneFloor
from footsense.lab.geometry import FootDesign

#: Residual of the result, over the force [1].
TOLERANCE_REL = 1e-6
#: Residual of the load steps on the way [1].
LOAD_STEP_TOLERANCE_REL = 1e-3
#: A load step that does not converge is halved this often before the load is given up.
MAX_STEP_HALVINGS = 4
#: Factor by which the gaps are stiffened when they are entered too deep, and how often. Gaps that start stiff make
#: their points of contact flicker from step to step.
GAP_STIFFENING, MAX_GAP_STIFFENINGS = 9.0, 3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ContactModelSolution:
    """Closures, capacitances and contact of the foot under one load.

    Attributes:
        closure_um: Mean closure of each gap [um], shape (9,).
        capacitance_pf: Capacitance of each element without stray [pF], shape (9,).
        cell_closures_um: Mean closures of 6 x 6 square cells of each element [um], shape (9, 36): flat index 6 ix + iy,
            cell 0 the most forward and leftmost.
        penetration_rel: Deepest penetration of a closed gap, over the gap [1]; below 0 while all are open.
        patch: Contact between floor and ball.
        newton_steps: Newton steps of all load steps, each one factorisation.
        n_unknowns: Free unknowns.
    """

    closure_um: Vector
    capacitance_pf: Vector
    cell_closures_um: Vector
    penetration_rel: float
    patch: ContactPatch
    newton_steps: int
    n_unknowns: int


@dataclass(frozen=True, slots=True)
class FootContactModel:
    """Finite-strain contact model of a foot; finite strain, floor contact and gap contact can each be switched off.

    Attributes:
        design: The foot.
        mesh_size: Resolution of the mesh.
        friction: Coulomb's coefficient of the floor [1].
        finite_strain: Neo-Hookean solids, else Hooke's.
        floor: `solved` for a rigid plane, `hertz` for the Hertz patch's traction.
        gaps: `contact` for gaps that close, `open` for planes that pass through each other.
    """

    design: FootDesign
    _: KW_ONLY
    mesh_size: ContactMeshSize = field(default_factory=ContactMeshSize)
    friction: float = 0.7
    finite_strain: bool = True
    floor: Literal["solved", "hertz"] = "solved"
    gaps: Literal["contact", "open"] = "contact"

    def solve(self, normal: Vector, force_n: Vector) -> ContactModelSolution:
        """Return closures, capacitances and contact patch of the foot under one load.

        Args:
            normal: Unit normal of the ball at the contact, pointing into the ball [1, foot frame], shape (3,).
            force_n: Ground reaction on the foot [N, foot frame], shape (3,).

        Returns:
            The equilibrium.

        Raises:
            ValueError: The normal is no unit vector, or the floor cannot exert the force.
            ConvergenceError: No equilibrium was found.
        """
        case = LoadCase(self.design, normal, force_n, self.friction)
        mesh = build_mesh(
            self.design, self.mesh_size, normal, case.hertz_radius_mm, is_half_foot=case.is_mirrored_at_y0
        )
        solved = self.floor == "solved"
        body = Body(self.design, mesh, self.mesh_size.order, case.floor_axes if solved else ())
        element_mm = self.mesh_size.patch_element_rel * case.hertz_radius_mm
        floor: FloorModel = PlaneFloor(case, body, element_mm) if solved else PrescribedHertzFloor(case, body)
        contact = self.gaps == "contact"
        weak_form = body.weak_form(floor, finite_strain=self.finite_strain, gap_contact=contact)
        equations = Equilibrium(body, weak_form, float(np.linalg.norm(force_n)))
        newton_steps = self._apply_load(body, floor, equations)
        stiffenings = 0
        while contact and body.penetration_rel() > MAX_PENETRATION_REL:
            if stiffenings == MAX_GAP_STIFFENINGS:
                raise ConvergenceError(f"a gap is entered by {body.penetration_rel():.1%} of its height")
            body.stiffen_gaps(GAP_STIFFENING)
            newton_steps += equations.solve(LOAD_STEP_TOLERANCE_REL)
            stiffenings += 1
        newton_steps += equations.solve(TOLERANCE_REL)
        samples_um = sampled_closure_um(
            self.design,
            mesh,
            body.ground_displacement_mm,
            body.leg_displacement_mm,
            is_half_foot=case.is_mirrored_at_y0,
        )
        cell_closures_um = cell_means(samples_um)
        return ContactModelSolution(
            closure_um=cell_closures_um.mean(axis=1),
            capacitance_pf=capacitance_pf(self.design, samples_um),
            cell_closures_um=cell_closures_um,
            penetration_rel=body.penetration_rel(),
            patch=floor.patch(),
            newton_steps=newton_steps,
            n_unknowns=equations.n_unknowns,
        )

    def _apply_load(self, body: Body, floor: FloorModel, equations: Equilibrium) -> int:
        """Apply the load, halving the load step when Newton fails; return the number of Newton steps.

        Returns:
            Newton steps of the load steps that held.

        Raises:
            ConvergenceError: A step failed after MAX_STEP_HALVINGS.
        """
        done, stride, halvings, newton_steps = 0.0, 1.0, 0, 0
        start = body.state.vec.CreateVector()
        while done < 1.0:
            start.data = body.state.vec
            goal = min(done + stride, 1.0)
            # Steps equal in patch area: a^2 grows with the force to the 2/3.
            floor.set_load_fraction(goal**1.5)
            try:
                newton_steps += equations.solve(LOAD_STEP_TOLERANCE_REL)
            except ConvergenceError as error:
                if halvings == MAX_STEP_HALVINGS:
                    raise ConvergenceError(f"at {goal**1.5:.0%} of the load: {error}") from error
                body.state.vec.data = start
                stride, halvings = stride / 2.0, halvings + 1
                continue
            if goal < 1.0:
                floor.accept_load_step()
            done = goal
        return newton_steps
