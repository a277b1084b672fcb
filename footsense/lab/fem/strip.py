"""Plane-strain model of the spacer's cross-section, to check its treatment as a traction law.

One pitch of the array repeats sideways. The middle plane of the spacer is a mirror, so only plate and rubber above it
are solved: over the cavity nothing holds the plate, over the bar either the law t_n = M [u_n] / t of `quarter`, or
half of the spacer meshed as PDMS that may bulge into the cavity.
"""

from typing import Any

import ngsolve as ng
from netgen import occ

from footsense.lab.fem.elasticity import strain_energy_density
from footsense.lab.fem.solids import rectangle
from footsense.lab.geometry import FootDesign

#: Layers of thin elements around the corner of the bar, thickness of each over the next, order of the displacement.
_LAYERS, _LAYER_REL, _ORDER = 4, 0.15, 5
#: Pressure on top of the rubber [MPa].
_UNIFORM_PRESSURE_MPA = 0.01


def _mesh(design: FootDesign, *, solid: bool) -> Any:
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
    mesh = _mesh(design, solid=solid)
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
