"""Errors under loads that the paper leaves out: contacts off centre, and a second one beside the floor's.

Source:
    Aoyagi et al., end of section III A, where both are left for later.
"""

from dataclasses import asdict
from typing import Any

import numpy as np

from footsense.foot.directions import (
    direction_grid,
    normalized,
    paper_directions,
    random_directions,
)
from footsense.foot.force_errors import GRAM_FORCE_N, evaluate_force_errors
from footsense.foot.response_table import FootResponse
from footsense.foot.specimen import Specimen
from footsense.frames import Mask, Vector
from footsense.lab.evaluation.evaluate_models import ForceEstimator
from footsense.lab.training.load_cases import FULL_SCALE_PF, measured_closure_rel

#: Force of the leaning loads, and that of the share within the converter's range [gf].
LEANING_GF, IN_RANGE_GF = 20.0, 100.0
#: Angles between force and contact normal; elevations of the forces, at which the table reaches the largest [deg].
LEANS_DEG, LEANING_ELEVATIONS_DEG = np.arange(0.0, 41.0, 5.0), (65.0, 75.0, 85.0)
#: Force of the floor beside a second load [gf], that load over it [1], and its lowest contact [deg].
FLOOR_GF, SECOND_REL, SECOND_MIN_ELEVATION_DEG = 50.0, (0.0, 0.05, 0.1, 0.2, 0.5, 1.0), 30.0

#: Errors at each level, and the level: `x`, `errors` by estimator, and for leans the share `in_range`.
Rows = list[dict[str, Any]]


class ComparedEstimators:
    """Force estimators under test, fed with noisy closures.

    Args:
        response: The foot's table.
        force_n: The estimators: closures [um] to forces [N], by name.
    """

    def __init__(self, response: FootResponse, force_n: dict[str, ForceEstimator]) -> None:
        self.response, self._force_n = response, force_n
        self._foot = Specimen(response)

    def measured_um(self, free_um: Vector) -> tuple[Vector, Mask]:
        """Return noisy closures [um], shape (n, 9), and which loads are within the converter's range, shape (n,)."""
        design, foot = self.response.design, self._foot
        closure_um = design.closure_um(foot.capacitance_of_free_closures_pf(free_um), foot.unloaded_pf)
        noisy_um = measured_closure_rel(design, closure_um, np.random.default_rng(0)) * design.gap_um
        return noisy_um, design.capacitance_pf(closure_um).max(axis=1) < FULL_SCALE_PF

    def errors(self, measured_um: Vector, truth_n: Vector, counted: Mask) -> dict[str, Any]:
        """Return the force errors of each estimator on measured closures [um], by its name."""
        return {
            name: asdict(evaluate_force_errors(truth_n[counted], read(measured_um[counted])))
            for name, read in self._force_n.items()
        }


def leaning_normals_to_a_side(force: Vector, lean_deg: float, turn_deg: float) -> Vector:
    """Return unit vectors inclined to forces by an angle [deg], shape (n, 3).

    Args:
        force: Directions, shape (n, 3), none along z.
        lean_deg: The angle [deg].
        turn_deg: Side of the lean: 0 is down the meridian, 90 across it [deg].
    """
    along = normalized(force)
    across = normalized(np.cross([0.0, 0.0, 1.0], along))
    lean, turn = np.radians([lean_deg, turn_deg])
    side = np.cos(turn) * np.cross(across, along) + np.sin(turn) * across
    inclined: Vector = np.cos(lean) * along + np.sin(lean) * side
    return inclined


def leaning_load_errors(tested: ComparedEstimators) -> Rows:
    """Return the errors at each lean: 108 directions of the force, the contact to four sides of each."""
    direction = direction_grid(5.0 + 10.0 * np.arange(36), list(LEANING_ELEVATIONS_DEG))
    unit, rows = np.tile(direction, (4, 1)), []
    for lean_deg in LEANS_DEG.tolist():
        sides = [leaning_normals_to_a_side(direction, lean_deg, 90.0 * turn) for turn in range(4)]
        free_um = [
            tested.response.free_closure_um(np.concatenate(sides), gf * GRAM_FORCE_N * unit)
            for gf in (LEANING_GF, IN_RANGE_GF)
        ]
        measured_um, counted = tested.measured_um(free_um[0])
        errors = tested.errors(measured_um, LEANING_GF * GRAM_FORCE_N * unit, counted)
        rows.append(
            {"x": lean_deg, "errors": errors, "in_range": float(tested.measured_um(free_um[1])[1].mean())}
        )
    return rows


def second_load_errors(tested: ComparedEstimators, draws: int) -> Rows:
    """Return the errors beside a second contact without friction, by its size."""
    direction, rng = np.tile(paper_directions("verification"), (draws, 1)), np.random.default_rng(0)
    normal = random_directions(rng, len(direction), SECOND_MIN_ELEVATION_DEG)
    floor_n = FLOOR_GF * GRAM_FORCE_N * direction
    floor_um, rows = tested.response.free_closure_um(direction, floor_n), []
    for share in SECOND_REL:
        second_n = share * FLOOR_GF * GRAM_FORCE_N * normal
        free_um = floor_um + tested.response.free_closure_um(normal, second_n)
        measured_um, counted = tested.measured_um(free_um)
        rows.append({"x": share, "errors": tested.errors(measured_um, floor_n + second_n, counted)})
    return rows
