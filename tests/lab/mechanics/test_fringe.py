"""The field at the edges of an electrode by Palmer's formula, against the field solved in two dimensions.

Half the width of two facing electrodes without thickness is solved, film and air between them, the spacer beside the
cavity and the plates above and below of PDMS. Rubber beyond the plates counts as PDMS; neighbours and wires are left
out.
"""

from typing import Any

import ngsolve as ng
import numpy as np
import pytest
from netgen import occ

from footsense.foot.capacitor import EPS0_PF_UM_PER_MM2
from footsense.foot.gap_contact import CELLS_PER_ELEMENT, fringe_pf
from footsense.foot.type_folders import released_names
from footsense.lab.foot_file import load_foot
from footsense.lab.geometry import FootDesign
from tests.lab.released import RELEASED

pytestmark = pytest.mark.lab

#: Where the field is cut off, beside and above the electrodes, over their side [1]; doubling it moves what edges add
#: by 2e-3.
_DOMAIN_MARGIN_REL = 6.0
_POLYNOMIAL_ORDER = 4


def _rectangle(x_mm: tuple[float, float], z_mm: tuple[float, float], name: str) -> Any:
    """Return a rectangle of a two-dimensional cross-section as a named face."""
    face = occ.MoveTo(x_mm[0], z_mm[0]).Rectangle(x_mm[1] - x_mm[0], z_mm[1] - z_mm[0]).Face()
    face.name = name
    return face


def _electrode_mesh(design: FootDesign, gap_mm: float, film_mm: float) -> Any:
    """Return the mesh of the half plane x > 0 around a pair of electrodes, the lower one at z = 0."""
    margin = _DOMAIN_MARGIN_REL * design.electrode_mm
    edge, wide = design.electrode_mm / 2.0, design.electrode_mm / 2.0 + margin
    top = film_mm + gap_mm
    bands = [(-margin, 0.0), (0.0, film_mm), (film_mm, top), (top, top + margin)]
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


def solved_fringe_pf(design: FootDesign, closure_um: float) -> float:
    """Return what the four edges of a flat element add to its plates [pF], each what an edge of the section adds."""
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
    return 2.0 * (per_length - plate) * design.electrode_mm


@pytest.mark.parametrize("foot_type", released_names())
@pytest.mark.parametrize("closed_rel", [0.0, 0.5])
def test_the_formula_of_the_edges_is_the_field(foot_type: str, closed_rel: float) -> None:
    """To a fiftieth, with the gap open and half closed: 37 to 290 um between electrodes of 4 to 11 mm."""
    design = load_foot(RELEASED.parent / foot_type / "foot.yaml")
    closure_um = closed_rel * design.gap_um
    spacing_um = np.full(9 * CELLS_PER_ELEMENT, design.gap_um + design.film_um - closure_um)
    assert fringe_pf(design.capacitor, spacing_um) == pytest.approx(
        solved_fringe_pf(design, closure_um), rel=0.02
    )
