"""Fidelity levels: models of the foot by name, cheapest first, and the response of a level to given loads.

- `half-space`: closures from the closed formula of a loaded half-space, without a mesh.
- `linear`: the response table. Closures may exceed the gap; the capacitance is held at that of a closed gap.
- `contact`: the table, and closed gaps that carry load. Simulator and training use it.
- `mesh`: as `linear`, with four finite element solves of each load in place of the table.

The formula:

1. Stress. A point force F on the surface of an incompressible half-space stresses it along rays alone,

       sigma = -3 / (2 pi) (F.r) r r / r^5,

   whatever the direction of F: Boussinesq's and Cerruti's solutions at nu = 1/2, where both become radial. Each
   side of the ball is taken as such a half-space (rubber has nu = 0.49), the contact patch as a point.
2. Sheet. The normal traction p = -sigma_zz on its plane is averaged over what each element has to carry: the square of
   one pitch around it, as far as the sheet reaches.
3. Statics. The sheet alone joins the two hemispheres, a half-space knows nothing of that. The traction
   a + b x + c y is added with which the sheet carries the whole force and its moment, as in a beam.
4. Cavities. They close by the pressure on the bars between them (`normalised_cavity_closure_mm`): p times the opening
   of the lattice over E' = E / (1 - nu^2).

Left out: the patch's size, the ball's and the sheet's edges, the PDMS plates (all is rubber), the shear traction.

Source:
    Johnson, Contact Mechanics, 1985, sections 3.2 and 3.6 (point forces), 13.2 (waves on a half-space);
    Koiter, Ingenieur-Archiv 28, 1959 (row of collinear cracks, the exact value).
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from timeit import default_timer
from typing import Any

import numpy as np

from footsense.foot.capacitor import Capacitor
from footsense.foot.force_errors import evaluate_force_errors
from footsense.foot.gap_contact import capacitance_pf, element_means
from footsense.foot.response_table import FootResponse
from footsense.foot.specimen import ContactLoads, Specimen
from footsense.frames import ELEMENTS, Vector
from footsense.lab.evaluation.evaluate_models import rms
from footsense.lab.fem.mesh import MeshSize
from footsense.lab.geometry import UM_PER_MM, FootDesign
from footsense.lab.training.load_cases import paper_training, paper_verification

#: Gauss points along the side of what an element carries: rays are long, so more change a closure by 1e-4.
_QUADRATURE_POINTS_PER_SIDE = 3

#: Waves of the lattice along each axis, to each side: the sum is then within 1e-3 of its end.
_N_HARMONICS = 100


def normalised_cavity_closure_mm(pitch_mm: float, bar_mm: float, *, crossing: bool = True) -> float:
    """Return the mean closure of cavities between bars that carry pressure, times E' over the mean pressure [mm].

    Bars that cross at the pitch carry a mean pressure p on a part of the area. Taken as spread evenly over the
    bars, their pressure bends the half-spaces by u_k = 2 p_k / (E' |k|) for each wave k of the lattice, E' = E / (1
    - nu^2), and the cavities close by the difference between cavity and bar: an upper bound, since an even pressure
    is not the one of least energy (10.2 against 9.3 E' / mm for bars along one direction, where the exact value is
    known).

    Args:
        pitch_mm: Distance of the bars [mm].
        bar_mm: Width of the bars [mm].
        crossing: Bars along both axes, else along one.
    """
    order = np.arange(-_N_HARMONICS, _N_HARMONICS + 1.0)
    open_rel = 1.0 - bar_mm / pitch_mm
    cavity = open_rel * np.sinc(order * open_rel)
    if crossing:
        wave = np.hypot(*np.meshgrid(order, order))
        cavity, open_rel = np.outer(cavity, cavity), open_rel**2
    else:
        wave = np.abs(order)
    wave[wave == 0.0] = np.inf
    # The pressure that the cavities do not carry is on the bars. Approach: work of the bars' pressure, both sides.
    pressure_rel = cavity / (1.0 - open_rel)
    approach_mm = (pressure_rel**2 * 4.0 * pitch_mm / (2.0 * math.pi * wave)).sum()
    # The approach is the mean of the closure over everything, and bars do not close.
    return float(approach_mm / open_rel)


class HalfSpace:
    """Closures of the elements by the closed formula of a loaded elastic half-space.

    Args:
        design: The foot.
    """

    def __init__(self, design: FootDesign) -> None:
        self._design = design
        place, share = np.polynomial.legendre.leggauss(_QUADRATURE_POINTS_PER_SIDE)
        half_mm = design.sheet_mm / 2.0
        centres = np.array(design.element_centres_mm)
        low = np.maximum(centres - design.pitch_mm / 2.0, -half_mm)
        high = np.minimum(centres + design.pitch_mm / 2.0, half_mm)
        along = (low + high)[:, None] / 2.0 + place[:, None] * (high - low)[:, None] / 2.0
        weight = share[:, None] * (high - low)[:, None] / 2.0
        shape = (len(centres), _QUADRATURE_POINTS_PER_SIDE, _QUADRATURE_POINTS_PER_SIDE)
        x_mm = np.broadcast_to(along[:, :, None, 0], shape).reshape(len(centres), -1)
        y_mm = np.broadcast_to(along[:, None, :, 1], shape).reshape(len(centres), -1)
        self._point_mm = np.stack([x_mm, y_mm, np.zeros_like(x_mm)], axis=-1)
        self._area_mm2 = (weight[:, :, None, 0] * weight[:, None, :, 1]).reshape(len(centres), -1)
        opening_mm = normalised_cavity_closure_mm(design.pitch_mm, design.pitch_mm - design.electrode_mm)
        self._um_per_mpa = UM_PER_MM * opening_mm / design.rubber.plane_strain_modulus_mpa

    def element_pressure_mpa(self, normal: Vector, force_n: Vector) -> Vector:
        """Return the mean pressure on each element [MPa], shape (n, 9).

        Args:
            normal: Inward unit normals of the ball at the contacts, shape (n, 3).
            force_n: Ground reactions on the foot [N], shape (n, 3).
        """
        touch_mm = self._design.touch_point_mm(normal)
        ray_mm = self._point_mm - touch_mm[:, None, None]
        squared_mm2 = (ray_mm**2).sum(axis=-1)
        along_n_mm = np.einsum("nepk,nk->nep", ray_mm, force_n)
        pressure = 1.5 / math.pi * along_n_mm * ray_mm[..., 2] ** 2 / (squared_mm2**2 * np.sqrt(squared_mm2))
        # Force and moments (0, 1, 2) of the pressure about the sheet's middle, and the planes that add to each.
        planes = np.stack([np.ones_like(self._area_mm2), self._point_mm[..., 0], self._point_mm[..., 1]])
        weighted = planes * self._area_mm2
        carried = np.einsum("kep,nep->nk", weighted, pressure)
        moment = np.cross(touch_mm, force_n)
        wanted = np.stack([force_n[:, 2], -moment[:, 1], moment[:, 0]], axis=1)
        inertia = np.einsum("kep,lep->kl", weighted, planes)
        added = np.linalg.solve(inertia, (wanted - carried).T)
        pressure += np.einsum("kn,kep->nep", added, planes)
        mean: Vector = (pressure * self._area_mm2).sum(axis=-1) / self._area_mm2.sum(axis=-1)
        return mean

    def closure_um(self, normal: Vector, force_n: Vector) -> Vector:
        """Return the mean closure of each element [um], shape (n, 9), under loads as in `element_pressure_mpa`.

        Raises:
            ValueError: A contact is not on the ground-side hemisphere.
        """
        if not normal[:, 2].min(initial=1.0) > 0.0:
            raise ValueError(
                f"the ground presses from below, got a contact normal with z = {normal[:, 2].min():.4f}"
            )
        return self.element_pressure_mpa(normal, force_n) * self._um_per_mpa


@dataclass(frozen=True, slots=True, eq=False)
class LevelResponse:
    """Closures [um] and capacitances [pF] of the elements under n loads, by one fidelity level.

    Attributes:
        closure_um: Mean closure of each gap [um], shape (n, 9).
        capacitance_pf: Capacitance of each element without stray [pF], shape (n, 9).
    """

    closure_um: Vector
    capacitance_pf: Vector


#: Of inward unit normals of the ball at the contacts [1] and ground reactions on the foot [N], both in the foot frame,
#: shape (n, 3).
FidelityLevel = Callable[[Vector, Vector], LevelResponse]


def _response_from_cell_closures(capacitor: Capacitor, cell_closures_um: Vector) -> LevelResponse:
    """Return closures and capacitances of the elements from the closures of their cells [um], shape (n, cells)."""
    distance_um = np.maximum(capacitor.gap_um - cell_closures_um, 0.0) + capacitor.film_equivalent_um
    return LevelResponse(element_means(cell_closures_um), capacitance_pf(capacitor, distance_um))


def fidelity_levels(
    response: FootResponse, foot_design: FootDesign, size: MeshSize
) -> dict[str, Callable[[], FidelityLevel]]:
    """Return a maker of each fidelity level of a foot by name, cheapest first; what it makes raises ValueError.

    Args:
        response: The foot's response table.
        foot_design: The foot of the table.
        size: Mesh of the level `mesh`, made and factorised once.
    """

    def half_space(model: HalfSpace, normal: Vector, force_n: Vector) -> LevelResponse:
        closure_um, capacitor = model.closure_um(normal, force_n), foot_design.capacitor
        return LevelResponse(closure_um, capacitor.capacitance_pf(np.minimum(closure_um, capacitor.gap_um)))

    def of_cells(
        closures_um: Callable[[Vector, Vector], Vector], normal: Vector, force_n: Vector
    ) -> LevelResponse:
        return _response_from_cell_closures(foot_design.capacitor, closures_um(normal, force_n))

    def mesh() -> FidelityLevel:
        # Here, and not above: the finite element library takes a second to load.
        from footsense.lab.fem.forward import DirectSolveFoot

        one = DirectSolveFoot(foot_design, size).cell_closures_um
        return partial(of_cells, lambda n, f: np.stack([one(*load) for load in zip(n, f, strict=True)]))

    return {
        "half-space": lambda: partial(half_space, HalfSpace(foot_design)),
        "linear": lambda: partial(of_cells, response.free_closure_um),
        "contact": lambda: partial(of_cells, Specimen(response).cell_closures_um),
        "mesh": mesh,
    }


def compare_levels(
    response: FootResponse,
    foot_design: FootDesign,
    size: MeshSize,
    n_solved: int,
    force_n: Callable[[Vector], Vector],
) -> list[dict[str, Any]]:
    """Return time of a load [s] and difference from the table with gap contact, by level, on the paper's loads.

    Args:
        response: Response table of the foot.
        foot_design: The foot.
        size: Resolution of the mesh.
        n_solved: Loads that the mesh is solved for.
        force_n: Forces [N] that a network reads from closures over the gap, shape (n, elements).
    """
    design = response.design
    paper_n = np.concatenate([paper_training(response).force_n, paper_verification(response).force_n])
    loads = ContactLoads.centred(paper_n)
    some = np.linspace(0, len(paper_n) - 1, n_solved).round().astype(int)
    answers: dict[str, LevelResponse] = {}
    rows: list[dict[str, Any]] = []
    for name, make_level in fidelity_levels(response, foot_design, size).items():
        on_mesh = name == "mesh"
        normal, own_n = (part[some] if on_mesh else part for part in loads)
        started = default_timer()
        level = make_level()
        before_s = default_timer() - started
        times_s = []
        for _ in range(1 if on_mesh else 3):
            started = default_timer()
            answers[name] = level(normal, own_n)
            times_s.append(default_timer() - started)
        rows.append(
            {"model": name, "seconds": min(times_s) / len(own_n), "before_s": before_s, "n": len(own_n)}
        )
    finest = answers["contact"]

    def read_n(answer: LevelResponse) -> Vector:
        closure_um = design.closure_um(answer.capacitance_pf, np.full(ELEMENTS, design.unloaded_pf))
        return force_n(closure_um / design.gap_um)

    for row in rows:
        own = answers[row["model"]]
        other = LevelResponse(*(part[some] for part in (finest.closure_um, finest.capacitance_pf)))
        reference = other if row["model"] == "mesh" else finest
        errors = evaluate_force_errors(read_n(reference), read_n(own))
        row |= {
            "closure_rel": rms(own.closure_um - reference.closure_um) / rms(reference.closure_um),
            "direction_deg": errors.direction_deg,
            "direction_max_deg": errors.direction_max_deg,
            "magnitude_gf": errors.magnitude_gf,
        }
    return rows
