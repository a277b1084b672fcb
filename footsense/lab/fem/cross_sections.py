"""Two-dimensional solves: the fringe field of an electrode, and the cross-section of the spacer.

Fringe field: half the width of two facing electrodes without thickness, film and air between them, the spacer beside
the cavity and the plates above and below of PDMS. Rubber beyond the plates counts as PDMS; neighbours and wires are
left out.

Spacer, in plane strain, to check its treatment as a traction law: one pitch of the array repeats sideways. The middle
plane of the spacer is a mirror, so only plate and rubber above it are solved: over the cavity nothing holds the plate,
over the bar either the law t_n = M [u_n] / t of `quarter`, or half of the spacer meshed as PDMS that may bulge into
the cavity.
"""

from collections.abc import Sequence
from typing import Any

import ngsolve as ng
import numpy as np
from netgen import occ

from footsense.foot.capacitor import EPS0_PF_UM_PER_MM2
from footsense.lab.fem.elasticity import strain_energy_density
from footsense.lab.fem.solids import rectangle
from footsense.lab.geometry import FootDesign

#: Where the field is cut off, beside and above the electrodes [mm]; doubling it moves the capacitance by 1e-3.
_DOMAIN_MARGIN_MM = 6.0
_POLYNOMIAL_ORDER = 4


def _electrode_mesh(design: FootDesign, gap_mm: float, film_mm: float) -> Any:
    """Return the mesh of the half plane x > 0 around a pair of electrodes, the lower one at z = 0."""
    edge, wide = design.electrode_mm / 2.0, design.electrode_mm / 2.0 + _DOMAIN_MARGIN_MM
    top = film_mm + gap_mm
    bands = [(-_DOMAIN_MARGIN_MM, 0.0), (0.0, film_mm), (film_mm, top), (top, top + _DOMAIN_MARGIN_MM)]
    parts = [
        rectangle(x_mm, z_mm, "air" if (z_mm[0], x_mm[0]) == (film_mm, 0.0) else "pdms")
        for z_mm in bands
        for x_mm in ((0.0, edge), (edge, wide))
    ]
    shape = occ.Glue(parts)
    near = 1e-9
    for border in shape.edges:
        if border.center.x < edge and abs(border.center.y) < near:
            border.name = "lower"
        elif border.center.x < edge and abs(border.center.y - top) < near:
            border.name = "upper"
    for vertex in shape.vertices:
        if abs(vertex.p.x - edge) < near and min(abs(vertex.p.y), abs(vertex.p.y - top)) < near:
            vertex.hpref = 1
    mesh = ng.Mesh(occ.OCCGeometry(shape, dim=2).GenerateMesh(maxh=2.0, grading=0.4))
    mesh.RefineHP(3, 0.15)
    return mesh


def fringed_and_plate_capacitance_pf(design: FootDesign, closure_um: float = 0.0) -> tuple[float, float]:
    """Return the capacitance of one flat element [pF] with fringe field, and by the parallel-plate formula.

    The four edges of the square each add what an edge of the cross-section adds per length.

    Args:
        design: The foot.
        closure_um: How far the electrodes have come together [um], spacer and all.
    """
    gap_mm, film_mm = 1e-3 * (design.gap_um - closure_um), 1e-3 * design.film_um
    mesh = _electrode_mesh(design, gap_mm, film_mm)
    space = ng.H1(mesh, order=_POLYNOMIAL_ORDER, dirichlet="lower|upper")
    u, v = space.TnT()
    permittivity = mesh.MaterialCF({"air": 1.0, "pdms": design.film_eps_r})
    form = ng.BilinearForm(permittivity * ng.grad(u) * ng.grad(v) * ng.dx, symmetric=True).Assemble()
    potential = ng.GridFunction(space)
    potential.Set(mesh.BoundaryCF({"upper": 1.0}, default=0.0), definedon=mesh.Boundaries("lower|upper"))
    rest = (form.mat * potential.vec).Evaluate()
    potential.vec.data -= form.mat.Inverse(space.FreeDofs(), "sparsecholesky") * rest
    field = ng.grad(potential)
    eps0_pf_per_mm = 1e-3 * EPS0_PF_UM_PER_MM2
    per_length = 2.0 * eps0_pf_per_mm * float(ng.Integrate(permittivity * field * field * ng.dx, mesh))
    plate = eps0_pf_per_mm * design.electrode_mm / (gap_mm + film_mm / design.film_eps_r)
    edges = 2.0 * (per_length - plate)
    return (plate + edges) * design.electrode_mm, plate * design.electrode_mm


def fringe_readings(design: FootDesign, closures_um: Sequence[float]) -> list[dict[str, float]]:
    """Return an element's capacitance with and without edges, and the closures that both are read as, by closure."""
    both_pf = [fringed_and_plate_capacitance_pf(design, closed_um) for closed_um in closures_um]
    edged_pf, plates_pf = np.array(both_pf).T
    stray_pf = edged_pf[0] - plates_pf[0]
    read_um = design.capacitor.closure_um(edged_pf, edged_pf[0])
    corrected_um = design.capacitor.closure_um(edged_pf - stray_pf, edged_pf[0] - stray_pf)
    names = ("closed_um", "plates_pf", "edged_pf", "read_um", "corrected_um")
    columns = (closures_um, plates_pf, edged_pf, read_um, corrected_um)
    return [dict(zip(names, row, strict=True)) for row in zip(*columns, strict=True)]


#: Layers of thin elements around the corner of the bar, thickness of each over the next, order of the displacement.
_LAYERS, _LAYER_REL, _ORDER = 4, 0.15, 5
#: Pressure on top of the rubber [MPa].
_UNIFORM_PRESSURE_MPA = 0.01


def _strip_mesh(design: FootDesign, *, solid: bool) -> Any:
    """Return the mesh of half a pitch: x from mid-cavity to mid-bar, z up from the lower face of the plate."""
    border, end = design.electrode_mm / 2.0, design.pitch_mm / 2.0
    # One pitch of rubber above the plate: beyond it a row of bars presses like a plane.
    plate, top = design.plate_mm, design.plate_mm + design.pitch_mm
    half = design.spacer_mm / 2.0
    parts = [
        rectangle((0.0, border), (0.0, plate), "pdms"),
        rectangle((border, end), (0.0, plate), "pdms"),
        rectangle((0.0, border), (plate, top), "rubber"),
        rectangle((border, end), (plate, top), "rubber"),
    ]
    if solid:
        bar = rectangle((border, end), (-half, 0.0), "pdms")
        bar.faces.maxh = half
        parts.append(bar)
    shape = occ.Glue(parts)
    near = 1e-9
    for edge in shape.edges:
        x, z = edge.center.x, edge.center.y
        if x < near or x > end - near:
            edge.name = "mirror"
        elif abs(z - top) < near:
            edge.name = "pressed"
        elif abs(z) < near:
            edge.name = "cavity" if x < border else "bar"
        elif solid and abs(z + half) < near:
            edge.name = "middle"
    for vertex in shape.vertices:
        if abs(vertex.p.x - border) < near and vertex.p.y < near:
            vertex.hpref = 1
    mesh = ng.Mesh(occ.OCCGeometry(shape, dim=2).GenerateMesh(maxh=0.5, grading=0.3))
    mesh.RefineHP(_LAYERS, _LAYER_REL)
    return mesh


def cavity_strip_closure_um(design: FootDesign, *, solid: bool) -> float:
    """Return the mean cavity closure [um] under a uniform pressure, by plane strain.

    Args:
        design: The foot, for thicknesses, widths and materials.
        solid: Whether the spacer is meshed as PDMS; else it is the law.
    """
    mesh = _strip_mesh(design, solid=solid)
    space = ng.VectorH1(mesh, order=_ORDER, dirichletx="mirror", dirichlety="middle")
    u, v = space.TnT()
    form = ng.BilinearForm(space, symmetric=True)
    form += ng.Variation(
        strain_energy_density(design.pdms, u) * ng.dx("pdms")
        + strain_energy_density(design.rubber, u) * ng.dx("rubber")
    )
    if not solid:  # the jump is twice the displacement of one side
        form += 2.0 * design.pdms.confined_modulus_mpa / design.spacer_mm * u[1] * v[1] * ng.ds("bar")
    load = ng.LinearForm(-_UNIFORM_PRESSURE_MPA * v[1] * ng.ds("pressed")).Assemble()
    form.Assemble()
    moved = ng.GridFunction(space)
    moved.vec.data = form.mat.Inverse(space.FreeDofs(), "sparsecholesky") * load.vec
    width_mm = design.electrode_mm / 2.0
    return float(-2.0e3 * ng.Integrate(moved[1] * ng.ds("cavity"), mesh) / width_mm)
