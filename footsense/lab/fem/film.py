"""A soft film without gaps in place of the spacer: the gelled polyurethane of the paper's outlook (section VI).

The film fills the whole area between the plates, electrodes and bars alike, and takes the place of the bars in the
weak form of `quarter`: an elastic layer between the two bodies,

    int over the film of (G [u_t].[v_t] + M [u_n][v_n]) / t_film

As a layer it needs no elements of its own, so that nothing in it can lock, however soft or incompressible it is. It
is bonded to two plates that are far stiffer and cannot spread sideways but near its rim, so that it resists being
pressed with the confined modulus M = lambda + 2 G and not with E. How near: a pressure in such a layer dies away over

    l = t sqrt(M / (12 G))

from the rim, lateral flow being a parabola between the two plates.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import ngsolve as ng
import numpy as np

from footsense.foot.capacitor import CapacitorDesign
from footsense.foot.response_table import FootResponse
from footsense.lab.fem.adjoint import UM_PER_MM, class_field
from footsense.lab.fem.mesh import MeshSize, build_mesh, quarter_cells
from footsense.lab.fem.quarter import SOLVED, Parity, Quarter
from footsense.lab.geometry import FootDesign, Material
from footsense.lab.response import tabulate


@dataclass(frozen=True, slots=True, kw_only=True)
class FilmDesign:
    """The film and the capacitors in it.

    Attributes:
        film_mm: Thickness, that of the spacer [mm].
        gel: Gelled polyurethane; the paper gives E = 20 kPa, Poisson's ratio is a choice.
        eps_r: Relative permittivity of the gel [1], a choice: capacitance and sensitivity are proportional to it.
    """

    film_mm: float
    gel: Material = field(default_factory=lambda: Material(0.020, 0.49))
    eps_r: float = 5.0

    @property
    def relief_mm(self) -> float:
        """Distance from the rim over which the film is not confined [mm]."""
        return self.film_mm * float(np.sqrt(self.gel.confined_mpa / (12.0 * self.gel.shear_mpa)))

    def capacitor(self, design: FootDesign) -> CapacitorDesign:
        """Return the capacitor: one of eps_r times the area, with the film's thickness as a gap of air."""
        return CapacitorDesign(
            gap_um=UM_PER_MM * self.film_mm,
            film_um=0.0,
            film_eps_r=1.0,
            electrode_area_mm2=self.eps_r * design.electrode_mm**2,
        )


class FilmQuarter(Quarter):
    """One symmetry class of the foot with the film, factorised.

    Attributes:
        film: The film.
    """

    def __init__(
        self, design: FootDesign, size: MeshSize, parity: Parity, mesh: Any, film: FilmDesign
    ) -> None:
        """Assemble and factorise."""
        self.film = film
        super().__init__(design, size, parity, mesh)

    @property
    def faces(self) -> str:
        """Faces of the film in the mesh, joined by `|`."""
        return "|".join(["bars", *(cell.name for cell in quarter_cells(self.design))])

    def _form(self) -> Any:
        """Return the bilinear form: that of the bars, and the film over the electrodes."""
        form = super()._form()
        (u_ground, u_leg, *_), (v_ground, v_leg, *_) = self.space.TnT()
        over_electrodes = self.faces.removeprefix("bars|")
        form += self.bar_traction(u_ground - u_leg) * (v_ground - v_leg) * ng.ds(over_electrodes)
        return form

    def bar_traction(self, jump: Any) -> Any:
        """Return the traction [MPa] that the film puts against a jump u_ground - u_leg [mm]."""
        gel = self.film.gel
        across = (gel.shear_mpa, gel.shear_mpa, gel.confined_mpa)
        return ng.CF(tuple(across[k] / self.film.film_mm * jump[k] for k in range(3)))


def film_response(design: FootDesign, size: MeshSize, film: FilmDesign) -> FootResponse:
    """Return the response table of the foot with the film; its free closures are those of the film.

    Its `design` is still that of the gaps: take `FilmDesign.capacitor`.
    """
    mesh = build_mesh(design, size)
    fields, unknowns = {}, 0
    for parity in SOLVED:
        quarter = FilmQuarter(design, size, parity, mesh, film)
        fields[parity] = class_field(quarter)
        unknowns = quarter.n_unknowns
    return tabulate(design, size, fields, {"elements": int(mesh.ne), "unknowns": unknowns})


def upright_closure_um(design: FootDesign, size: MeshSize, films: Sequence[FilmDesign]) -> list[float]:
    """Return for each film the mean closure over the electrodes [um/N] under an upright force, spread over the ball."""
    mesh = build_mesh(design, size)
    electrodes = ng.ds("|".join(cell.name for cell in quarter_cells(design)))
    electrodes_mm2 = ng.Integrate(ng.CF(1.0) * electrodes, mesh)
    ball_mm2 = ng.Integrate(ng.CF(1.0) * ng.ds("curved_ground"), mesh)
    closures = []
    for film in films:
        quarter = FilmQuarter(design, size, Parity(1, 1), mesh, film)
        moved = quarter.solve(quarter.traction_load(ng.CF((0.0, 0.0, 0.25 / ball_mm2))))
        ground, leg, *_ = moved.components
        closures.append(UM_PER_MM * ng.Integrate((ground[2] - leg[2]) * electrodes, mesh) / electrodes_mm2)
    return closures
