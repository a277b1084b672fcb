"""Fidelity levels: models of the foot by name, cheapest first, and the response of a level to given loads.

- `half-space`: a formula, see there.
- `linear`: the response table. Closures may exceed the gap; the capacitance is held at that of a closed gap.
- `contact`: the table, and closed gaps that carry load. Simulator and training use it.
- `mesh`: as `linear`, with four finite element solves of each load in place of the table.

A level is a function of contact normals and forces, which raises ValueError for a load beyond its range.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from footsense.foot.capacitor import Capacitor
from footsense.foot.directions import directions
from footsense.foot.gap_contact import capacitance_pf, element_means
from footsense.foot.response_table import FootResponse
from footsense.foot.specimen import Foot
from footsense.frames import Vector
from footsense.lab.evaluation.half_space import HalfSpace
from footsense.lab.fem.mesh import COARSE_MESH, MeshSize
from footsense.lab.geometry import FootDesign

#: Names of the fidelity levels, cheapest first.
LEVEL_NAMES = ("half-space", "linear", "contact", "mesh")
#: Largest contact patch, over the ball's radius [1]: Hertz assumes a small one.
MAX_PATCH_RADIUS_REL = 0.3


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


def half_space_response(model: HalfSpace, normal: Vector, force_n: Vector) -> LevelResponse:
    """Return closures by the half-space formula, and capacitances of flat electrodes."""
    closure_um, capacitor = model.closure_um(normal, force_n), model.design.capacitor
    return LevelResponse(closure_um, capacitor.capacitance_pf(np.minimum(closure_um, capacitor.gap_um)))


def _response_from_cell_closures(capacitor: Capacitor, cell_closures_um: Vector) -> LevelResponse:
    """Return closures and capacitances of the elements from the closures of their cells [um], shape (n, cells)."""
    distance_um = np.maximum(capacitor.gap_um - cell_closures_um, 0.0) + capacitor.film_equivalent_um
    return LevelResponse(element_means(cell_closures_um), capacitance_pf(capacitor, distance_um))


def linear_response(response: FootResponse, normal: Vector, force_n: Vector) -> LevelResponse:
    """Return closures and capacitances by the linear response table, without gap contact."""
    return _response_from_cell_closures(response.design, response.free_closure_um(normal, force_n))


def gap_contact_response(foot: Foot, normal: Vector, force_n: Vector) -> LevelResponse:
    """Return closures and capacitances of the simulated foot: response table plus contact in closed gaps."""
    return _response_from_cell_closures(foot.response.design, foot.cell_closures_um(normal, force_n))


def mesh_level(foot_design: FootDesign, size: MeshSize = COARSE_MESH) -> FidelityLevel:
    """Return the level that solves each load on a mesh of the given size, made and factorised once."""
    # Here, and not above: the finite element library takes a second to load.
    from footsense.lab.fem.forward import DirectSolveFoot

    foot = DirectSolveFoot(foot_design, size)

    def answer(normal: Vector, force_n: Vector) -> LevelResponse:
        cells_um = np.stack([foot.cell_closures_um(*load) for load in zip(normal, force_n, strict=True)])
        return _response_from_cell_closures(foot_design.capacitor, cells_um)

    return answer


def fidelity_level(name: str, response: FootResponse, foot_design: FootDesign) -> FidelityLevel:
    """Return the named level of a foot.

    Args:
        name: One of `LEVEL_NAMES`.
        response: The foot's response table.
        foot_design: The foot of the table.

    Raises:
        ValueError: There is no such level.
    """
    if name not in LEVEL_NAMES:
        raise ValueError(f"no fidelity level {name!r}; there are {', '.join(LEVEL_NAMES)}")
    levels: dict[str, Callable[[], FidelityLevel]] = {
        "half-space": lambda: partial(half_space_response, HalfSpace(foot_design)),
        "linear": lambda: partial(linear_response, response),
        "contact": lambda: partial(gap_contact_response, Foot(response)),
        "mesh": lambda: mesh_level(foot_design),
    }
    return levels[name]()


def response_json(
    response: FootResponse,
    foot_design: FootDesign,
    direction_deg: tuple[float, float],
    force_n: float,
    name: str = "contact",
) -> dict[str, Any]:
    """Return closures [um] and capacitances [pF] under a centred load as JSON values.

    Args:
        response: The foot's response table.
        foot_design: The foot of the table.
        direction_deg: Azimuth and elevation (theta1, theta2) of the force [deg].
        force_n: Magnitude of the force [N].
        name: The fidelity level.

    Returns:
        `level`, `direction_deg`, `force_n`; `closure_um`, `capacitance_pf` (without stray) and `unloaded_pf`;
        the two as 3 x 3 lists, row 0 the most forward, column 0 the leftmost.

    Raises:
        ValueError: There is no such level, the load is beyond its range, or the force is not above 0.
    """
    if not (np.isfinite(force_n) and force_n > 0.0):
        raise ValueError(f"a contact presses with more than 0 N, got {force_n:g}")
    if not np.isfinite(direction_deg).all():
        raise ValueError(
            f"a direction is two finite angles, got {direction_deg[0]:g}, {direction_deg[1]:g} deg"
        )
    if not 0.0 <= direction_deg[1] <= 90.0:
        raise ValueError(f"an elevation is between 0 and 90 deg, got {direction_deg[1]:g}")
    normal = directions(*np.array(direction_deg)[:, None])
    hertz_patch_radius_mm = float(response.patch_radius_mm(normal, force_n * normal)[0])
    if hertz_patch_radius_mm > MAX_PATCH_RADIUS_REL * response.ball_radius_mm:
        raise ValueError(
            f"{force_n:g} N would flatten the ball over {hertz_patch_radius_mm:.1f} mm; the models hold up to "
            f"{MAX_PATCH_RADIUS_REL * response.ball_radius_mm:g} mm"
        )
    answer = fidelity_level(name, response, foot_design)(normal, force_n * normal)
    return {
        "level": name,
        "direction_deg": list(direction_deg),
        "force_n": force_n,
        "closure_um": answer.closure_um.reshape(3, 3).round(4).tolist(),
        "capacitance_pf": answer.capacitance_pf.reshape(3, 3).round(5).tolist(),
        "unloaded_pf": round(response.design.unloaded_pf, 5),
    }
