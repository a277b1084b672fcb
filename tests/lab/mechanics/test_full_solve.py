"""The full solve against Hertz, statics, and the cheaper models that it must come down to."""

import dataclasses

import ngsolve as ng
import numpy as np
import pytest
from msgspec.structs import replace
from netgen import occ

from footsense.lab.contact import equilibrium, full_solve
from footsense.lab.contact.body import Body
from footsense.lab.contact.element_closures import cell_means, sampled_closure_um
from footsense.lab.contact.equilibrium import ConvergenceError, Equilibrium
from footsense.lab.contact.full_solve import FootContactModel
from footsense.lab.contact.load_case import LoadCase
from footsense.lab.contact.mesh import ContactMeshSize, build_mesh
from footsense.lab.contact.plane_floor import PlaneFloor
from footsense.lab.fem.elasticity import mixed_strain_energy_density, strain_energy_density
from footsense.lab.geometry import Material
from tests.lab.released import FOOT_DESIGN

pytestmark = [pytest.mark.lab, pytest.mark.slow]

COARSE = ContactMeshSize(ball_mm=4.5, plate_mm=2.5, bar_mm=2.0, patch_element_rel=0.5)
#: For what holds on any mesh.
ROUGH = ContactMeshSize(ball_mm=5.0, plate_mm=3.5, bar_mm=4.0, patch_element_rel=0.8)
UP = np.array([0.0, 0.0, 1.0])
#: A contact behind the middle: the normal tilts forward, the force stays upright.
LEANING = np.array([np.sin(0.35), 0.0, np.cos(0.35)])
#: Newtons in a gram-force.
GRAM_FORCE_N = 9.80665e-3


def test_a_light_load_is_hertz_on_the_linear_foot() -> None:
    """At 5 gf: the closed formulas for the patch, the small-strain foot under a Hertz patch for the rest.

    A ball is no half-space: the foot behind the patch yields too, so the floor comes further than a^2/R, by a share
    that grows with a/R = 0.04. The linear foot knows that compliance; its approach is met more closely.
    """
    force = 5.0 * GRAM_FORCE_N * UP
    fine = dataclasses.replace(COARSE, patch_element_rel=0.3)
    solved = FootContactModel(FOOT_DESIGN, mesh_size=fine).solve(UP, force)
    linear = FootContactModel(
        FOOT_DESIGN, mesh_size=fine, finite_strain=False, floor="hertz", gaps="open"
    ).solve(UP, force)
    a_mm = np.cbrt(0.75 * force[2] * FOOT_DESIGN.ball_radius_mm / FOOT_DESIGN.rubber.plane_strain_modulus_mpa)
    assert solved.patch.radius_mm == pytest.approx(a_mm, rel=0.04)
    assert solved.patch.peak_pressure_mpa == pytest.approx(1.5 * force[2] / (np.pi * a_mm**2), rel=0.05)
    assert 1.0 < solved.patch.approach_mm / (a_mm**2 / FOOT_DESIGN.ball_radius_mm) < 1.1
    assert solved.patch.approach_mm == pytest.approx(linear.patch.approach_mm, rel=0.02)
    np.testing.assert_allclose(solved.closure_um, linear.closure_um, atol=0.005 * linear.closure_um.max())


def test_the_spacer_carries_the_prescribed_force() -> None:
    """Statics of the ground side: with open gaps all of a leaning force goes through the bars, to 1e-5."""
    force = 0.5 * UP
    case = LoadCase(FOOT_DESIGN, LEANING, force, 0.7)
    mesh = build_mesh(FOOT_DESIGN, ROUGH, LEANING, case.hertz_radius_mm, is_half_foot=case.is_mirrored_at_y0)
    body = Body(FOOT_DESIGN, mesh, ROUGH.order, case.floor_axes)
    floor = PlaneFloor(case, body, ROUGH.patch_element_rel * case.hertz_radius_mm)
    form = body.weak_form(floor, finite_strain=True, gap_contact=False)
    floor.set_load_fraction(1.0)
    Equilibrium(body, form, 0.5).solve(1e-6)
    jump = body.ground_displacement_mm - body.leg_displacement_mm
    pdms = FOOT_DESIGN.pdms
    across = (
        np.array([pdms.shear_modulus_mpa, pdms.shear_modulus_mpa, pdms.confined_modulus_mpa])
        / FOOT_DESIGN.spacer_mm
    )
    carried = [across[k] * ng.Integrate(jump[k] * ng.ds("bars"), mesh) / case.meshed_share for k in (0, 2)]
    np.testing.assert_allclose(carried, force[[0, 2]], atol=1e-5 * 0.5)
    samples_um = sampled_closure_um(
        FOOT_DESIGN, mesh, body.ground_displacement_mm, body.leg_displacement_mm, is_half_foot=True
    )
    integral = (
        1000.0
        * ng.Integrate(jump[2] * ng.ds("cavity"), mesh)
        / case.meshed_share
        / FOOT_DESIGN.electrode_mm**2
    )
    # The Gauss points of the cells do not see the closure fall to zero at the bars as exactly as the mesh does.
    assert cell_means(samples_um).mean(axis=1).sum() == pytest.approx(integral, rel=0.01)


@pytest.mark.parametrize("material", [Material(5.2, 0.49), Material(3.0, 0.40)])
def test_a_homogeneous_stretch_is_exact(material: Material) -> None:
    """Patch test: an affine field is in balance inside, and its stress is the slope of the stored energy."""
    stretch = np.array([[1.3, 0.2, 0.0], [0.0, 0.9, 0.1], [0.05, 0.0, 0.95]])
    mesh = ng.Mesh(occ.OCCGeometry(occ.Box(occ.Pnt(0, 0, 0), occ.Pnt(1, 1, 1))).GenerateMesh(maxh=0.5))
    space = ng.VectorH1(mesh, order=2, dirichlet=".*") * ng.H1(mesh, order=1)
    u, p = space.TrialFunction()
    affine = ng.CF(tuple((stretch - np.eye(3)).ravel()), dims=(3, 3)) * ng.CF((ng.x, ng.y, ng.z))
    state = ng.GridFunction(space)
    state.components[0].Set(affine)
    state.components[1].Set(material.lame_lambda_mpa * (np.linalg.det(stretch) - 1.0))

    def stored_mpa(gradient: np.ndarray) -> float:
        volume = np.linalg.det(gradient)
        shear = 0.5 * material.shear_modulus_mpa * ((gradient**2).sum() - 3.0 - 2.0 * np.log(volume))
        return float(shear + 0.5 * material.lame_lambda_mpa * (volume - 1.0) ** 2)

    direction = np.array([[0.3, -0.1, 0.2], [0.4, 0.1, 0.0], [0.0, 0.5, -0.2]])
    slope = (stored_mpa(stretch + 1e-5 * direction) - stored_mpa(stretch - 1e-5 * direction)) / 2e-5
    along = ng.GridFunction(space)
    along.components[0].Set(ng.CF(tuple(direction.ravel()), dims=(3, 3)) * ng.CF((ng.x, ng.y, ng.z)))
    for stored in (
        mixed_strain_energy_density(material, u, p, finite_strain=True),
        strain_energy_density(material, u, finite_strain=True),
    ):
        form = ng.BilinearForm(space, symmetric=True)
        form += ng.Variation(stored * ng.dx)
        residual = state.vec.CreateVector()
        form.Apply(state.vec, residual)
        inside = np.array(list(space.FreeDofs()), dtype=bool)
        assert np.abs(residual.FV().NumPy()[inside]).max() < 1e-12
        assert ng.InnerProduct(residual, along.vec) == pytest.approx(slope, rel=1e-7)


def test_a_closed_gap_is_entered_by_less_than_a_hundredth() -> None:
    """200 gf on a contact far behind: rear gaps close, no point is deeper than 20 um and 1 %."""
    closed = FootContactModel(FOOT_DESIGN, mesh_size=ROUGH, finite_strain=False, floor="hertz").solve(
        LEANING, 200.0 * GRAM_FORCE_N * UP
    )
    assert 0.0 < closed.penetration_rel <= 0.01
    assert FOOT_DESIGN.gap_um < closed.cell_closures_um.max() <= 1.01 * FOOT_DESIGN.gap_um
    assert closed.closure_um.argmax() in {6, 8}
    film_pf = 8.8541878128 * 16.0 / (17.0 / 2.7)
    assert FOOT_DESIGN.capacitor.unloaded_pf < closed.capacitance_pf.max() < film_pf


def test_a_force_outside_the_cone_of_friction_is_refused() -> None:
    """The tangent of 20 deg is more than 0.3, and no floor pulls."""
    with pytest.raises(ValueError, match=r"friction 0\.3 .* holds less than"):
        FootContactModel(FOOT_DESIGN, mesh_size=ROUGH, friction=0.3).solve(LEANING, UP)
    with pytest.raises(ValueError, match="pressed with -1 N"):
        FootContactModel(FOOT_DESIGN, mesh_size=ROUGH).solve(UP, -UP)
    with pytest.raises(ValueError, match="length 1"):
        FootContactModel(FOOT_DESIGN, mesh_size=ROUGH).solve(2.0 * UP, UP)


def test_rubber_near_incompressible_does_not_lock() -> None:
    """From nu = 0.49 to 0.4999 closures change by what elasticity asks: 2 % more volume stiffness, no more."""
    sums = []
    for poisson in (0.49, 0.4999):
        foot_design = replace(FOOT_DESIGN, rubber=replace(FOOT_DESIGN.rubber, poisson=poisson))
        solved = FootContactModel(foot_design, mesh_size=ROUGH, floor="hertz", gaps="open").solve(
            UP, 0.2 * UP
        )
        sums.append(solved.closure_um.sum())
    assert abs(sums[1] / sums[0] - 1.0) < 0.05


def test_half_and_whole_foot_agree() -> None:
    """A load turned by 90 deg, meshed half and whole: rows become columns, within a rough mesh's noise of 10 %."""
    leaning = FootContactModel(FOOT_DESIGN, mesh_size=ROUGH, finite_strain=False, floor="hertz", gaps="open")
    forward = leaning.solve(LEANING, UP).closure_um.reshape(3, 3)
    sideways = leaning.solve(LEANING[[1, 0, 2]], UP).closure_um.reshape(3, 3)
    np.testing.assert_allclose(sideways, forward.T, atol=0.1 * forward.max())


def test_a_load_that_does_not_converge_is_no_number(monkeypatch: pytest.MonkeyPatch) -> None:
    """The error names the load and the residual."""
    monkeypatch.setattr(equilibrium, "MAX_NEWTON_STEPS", 0)
    monkeypatch.setattr(full_solve, "MAX_STEP_HALVINGS", 0)
    with pytest.raises(ConvergenceError, match=r"at 100% of the load: residual .* after 0 Newton steps"):
        FootContactModel(FOOT_DESIGN, mesh_size=ROUGH).solve(UP, UP)
