"""The elastic foot as a finite element problem: two bodies of rubber and PDMS, joined by the bars of the spacer.

Find u in each body, u = 0 where the leg holds the leg-side hemisphere, so that for all v

    sum over bodies of int 2 G eps(u):eps(v) + lambda div u div v
        + int over the bars of (G [u_t].[v_t] + M [u_n][v_n]) / t_spacer  =  int over the ground side of t.v

[u] = u_ground - u_leg. The spacer is a layer of 37 um that is 27 times wider than thick: it cannot spread sideways,
so its normal stiffness takes the confined modulus M = lambda + 2 G. The 500 um plates are *not* such layers (they
bend into the cavities, which is most of the closure), so they are meshed as solids. Over the cavities nothing
joins the bodies, and nothing outside the sheet. The 37 um themselves are left out of the coordinates.

Quadratic curved tetrahedra. Known limit: at the bars' edges the stress is singular down to the length t_spacer,
so closures converge from below, only linearly in the element size there.

Source:
    DESIGN section 6; materials as in `geometry`.
"""

from dataclasses import dataclass
from typing import Any

import ngsolve as ng
from netgen import occ

from footsense.lab.geometry import Material, SoleDesign


@dataclass(frozen=True, slots=True, kw_only=True)
class MeshSize:
    """How fine the mesh is, largest edge lengths [mm].

    Attributes:
        ball_mm: In the hemispheres.
        plate_mm: In the plates.
        surface_mm: On the curved surface that touches the ground, where the response is read.
        bar_mm: Along the edges of the spacer's bars, where the stress is singular.
        order: Polynomial order of displacement and geometry.
    """

    ball_mm: float = 2.5
    plate_mm: float = 1.5
    surface_mm: float = 1.5
    bar_mm: float = 0.25
    order: int = 2


#: What `footsense lab build` ships: with bars of 0.12 mm instead of 0.25 mm closures grow by 3 to 5 %.
SHIPPED = MeshSize()
#: What the tests and `--quick` use: seconds, and closures some 20 % too small.
COARSE = MeshSize(ball_mm=3.0, plate_mm=1.5, surface_mm=2.5, bar_mm=1.0)


def _half(sole: SoleDesign, side: str, up: float) -> list[Any]:
    """Return hemisphere and plate of the `ground` (up = -1) or `leg` (up = +1) side, named for the weak form."""
    flat = up * sole.plate_mm
    ball = occ.Sphere(occ.Pnt(0, 0, flat), sole.ball_radius_mm) * occ.HalfSpace(
        occ.Pnt(0, 0, flat), occ.Vec(0, 0, -up)
    )
    for face in ball.faces:
        face.name = f"curved_{side}" if abs(face.center.z - flat) > 0.1 * sole.ball_radius_mm else "flat"
    ball.mat(f"rubber_{side}")
    half = sole.sheet_mm / 2.0
    plate = occ.Box(occ.Pnt(-half, -half, min(0.0, flat)), occ.Pnt(half, half, max(0.0, flat)))
    plate.mat(f"pdms_{side}")
    return [ball, plate]


def build_mesh(sole: SoleDesign, size: MeshSize) -> Any:
    """Return the curved mesh of both bodies; faces `cavity0`..`cavity8`, `bars`, `curved_ground`, `curved_leg`."""
    ground, leg = _half(sole, "ground", -1.0), _half(sole, "leg", 1.0)
    side = sole.electrode_mm
    cavities = []
    for element, (x_mm, y_mm) in enumerate(sole.centres_mm):
        corner = occ.Pnt(x_mm - side / 2.0, y_mm - side / 2.0, 0.0)
        face = occ.WorkPlane(occ.Axes(corner, n=occ.Z, h=occ.X)).Rectangle(side, side).Face()
        face.name = f"cavity{element}"
        cavities.append(face)
    for body in (ground[1], leg[1]):
        body.maxh = size.plate_mm
    shape = occ.Glue([*ground, *leg, *cavities])
    for face in shape.faces:
        low, high = face.bounding_box
        in_plane = max(abs(low.z), abs(high.z)) < 1e-3
        if in_plane and not (face.name or "").startswith("cavity"):
            face.name = "bars"
        if face.name == "curved_ground":
            face.maxh = size.surface_mm
    inside = sole.sheet_mm / 2.0 - 1e-3
    for edge in shape.edges:
        low, high = edge.bounding_box
        in_plane = max(abs(low.z), abs(high.z)) < 1e-3
        if in_plane and max(abs(edge.center.x), abs(edge.center.y)) < inside:
            edge.maxh = size.bar_mm
    mesh = ng.Mesh(occ.OCCGeometry(shape).GenerateMesh(maxh=size.ball_mm, grading=0.4))
    mesh.Curve(size.order)
    return mesh


def _elastic(material: Material, u: Any, v: Any) -> Any:
    """Return 2 G eps(u):eps(v) + lambda div u div v."""

    def eps(w: Any) -> Any:
        return 0.5 * (ng.Grad(w) + ng.Grad(w).trans)

    return 2.0 * material.shear_mpa * ng.InnerProduct(eps(u), eps(v)) + material.lame_mpa * ng.div(
        u
    ) * ng.div(v)


class Solid:
    """The factorised foot: any number of loads after one factorisation.

    Attributes:
        sole: The foot.
        size: Fineness of the mesh.
        mesh: The mesh, in mm, foot frame, origin in the middle of the spacer.
        space: Displacements of the ground side times those of the leg side.
    """

    def __init__(self, sole: SoleDesign, size: MeshSize) -> None:
        self.sole, self.size = sole, size
        self.mesh = build_mesh(sole, size)
        ground = ng.VectorH1(self.mesh, order=size.order, definedon="rubber_ground|pdms_ground")
        leg = ng.VectorH1(
            self.mesh, order=size.order, definedon="rubber_leg|pdms_leg", dirichlet="curved_leg"
        )
        self.space = ng.Compress(ground) * ng.Compress(leg)
        (u_ground, u_leg), (v_ground, v_leg) = self.space.TnT()
        form = ng.BilinearForm(self.space, symmetric=True)
        for side, u, v in (("ground", u_ground, v_ground), ("leg", u_leg, v_leg)):
            form += _elastic(sole.rubber, u, v) * ng.dx(f"rubber_{side}")
            form += _elastic(sole.pdms, u, v) * ng.dx(f"pdms_{side}")
        form += self.bar_traction(u_ground - u_leg) * (v_ground - v_leg) * ng.ds("bars")
        with ng.TaskManager():
            form.Assemble()
            self._inverse = form.mat.Inverse(self.space.FreeDofs(), "sparsecholesky")

    @property
    def n_unknowns(self) -> int:
        """Unknown displacements."""
        return int(self.space.ndof)

    def bar_traction(self, jump: Any) -> Any:
        """Return the traction [MPa] that the spacer's bars put against a jump u_ground - u_leg [mm]."""
        pdms = self.sole.pdms
        across = ng.CF((pdms.shear_mpa, pdms.shear_mpa, pdms.confined_mpa)) / self.sole.spacer_mm
        return ng.CF(tuple(across[k] * jump[k] for k in range(3)))

    def closure_functional(self, element: int) -> Any:
        """Return the mean closure of an element's cavity as a linear form of the displacement."""
        v_ground, v_leg = self.space.TestFunction()
        form = ng.LinearForm(self.space)
        form += (v_ground[2] - v_leg[2]) / self.sole.electrode_mm**2 * ng.ds(f"cavity{element}")
        return form.Assemble()

    def traction_load(self, traction_mpa: Any, extra_order: int = 20) -> Any:
        """Return the load of a traction on the ground-side surface as a linear form."""
        v_ground, _ = self.space.TestFunction()
        form = ng.LinearForm(self.space)
        form += traction_mpa * v_ground * ng.ds("curved_ground", bonus_intorder=extra_order)
        return form.Assemble()

    def solve(self, load: Any) -> Any:
        """Return the displacement [mm] under an assembled load, a grid function of `space`."""
        displacement = ng.GridFunction(self.space)
        with ng.TaskManager():
            displacement.vec.data = self._inverse * load.vec
        return displacement
