"""Fringe field of an electrode, in two dimensions.

Half the width of two facing electrodes without thickness is solved, film and air between them, the spacer beside the
cavity and the plates above and below of PDMS. Rubber beyond the plates counts as PDMS; neighbours and wires are left
out.
"""

from collections.abc import Sequence
from typing import Any

import ngsolve as ng
import numpy as np
from netgen import occ

from footsense.foot.capacitor import EPS0_PF_UM_PER_MM2
from footsense.lab.geometry import FootDesign

#: Where the field is cut off, beside and above the electrodes [mm]; doubling it moves the capacitance by 1e-3.
_DOMAIN_MARGIN_MM = 6.0
_POLYNOMIAL_ORDER = 4


def _rectangle(x_mm: tuple[float, float], z_mm: tuple[float, float], name: str) -> Any:
    """Return a rectangle of a two-dimensional cross-section as a named face."""
    face = occ.MoveTo(x_mm[0], z_mm[0]).Rectangle(x_mm[1] - x_mm[0], z_mm[1] - z_mm[0]).Face()
    face.name = name
    return face


def _electrode_mesh(design: FootDesign, gap_mm: float, film_mm: float) -> Any:
    """Return the mesh of the half plane x > 0 around a pair of electrodes, the lower one at z = 0."""
    edge, wide = design.electrode_mm / 2.0, design.electrode_mm / 2.0 + _DOMAIN_MARGIN_MM
    top = film_mm + gap_mm
    bands = [(-_DOMAIN_MARGIN_MM, 0.0), (0.0, film_mm), (film_mm, top), (top, top + _DOMAIN_MARGIN_MM)]
    parts = [
        _rectangle(x_mm, z_mm, "air" if (z_mm[0], x_mm[0]) == (film_mm, 0.0) else "pdms")
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
