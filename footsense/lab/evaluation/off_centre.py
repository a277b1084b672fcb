"""Errors under loads that the paper leaves out: contacts off centre, and a second one beside the floor's.

Source:
    Aoyagi et al., end of section III A, where both are left for later.
"""

from collections.abc import Mapping
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
from footsense.frames import Vector
from footsense.lab.evaluation.evaluate_models import ForceEstimator
from footsense.lab.training.load_cases import FULL_SCALE_PF, measured_closure_rel

#: Force of the leaning loads [gf].
LEANING_GF = 20.0
#: Angles between force and contact normal; elevations of the forces, at which the table reaches the largest [deg].
LEANS_DEG, LEANING_ELEVATIONS_DEG = np.arange(0.0, 41.0, 5.0), (65.0, 75.0, 85.0)
#: Force of the floor beside a second load [gf], that load over it [1], and its lowest contact [deg].
FLOOR_GF, SECOND_REL, SECOND_MIN_ELEVATION_DEG = 50.0, (0.0, 0.05, 0.1, 0.2, 0.5, 1.0), 30.0

#: Errors at each level, and the level: `x`, and `errors` by estimator.
Rows = list[dict[str, Any]]


def _errors(
    response: FootResponse, estimators: Mapping[str, ForceEstimator], free_um: Vector, truth_n: Vector
) -> dict[str, Any]:
    """Return the force errors of each estimator on noisy closures, of the loads within the converter's range."""
    design, foot = response.design, Specimen(response)
    closure_um = design.closure_um(foot.capacitance_of_free_closures_pf(free_um), foot.unloaded_pf)
    noisy_um = measured_closure_rel(design, closure_um, np.random.default_rng(0)) * design.gap_um
    counted = design.capacitance_pf(closure_um).max(axis=1) < FULL_SCALE_PF
    return {
        name: asdict(evaluate_force_errors(truth_n[counted], read(noisy_um[counted])))
        for name, read in estimators.items()
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


def leaning_load_errors(response: FootResponse, estimators: Mapping[str, ForceEstimator]) -> Rows:
    """Return the errors of estimators, closures [um] to forces [N], at each lean.

    There are 108 directions of the force, and the contact is to four sides of each.
    """
    direction = direction_grid(5.0 + 10.0 * np.arange(36), list(LEANING_ELEVATIONS_DEG))
    force_n, rows = LEANING_GF * GRAM_FORCE_N * np.tile(direction, (4, 1)), []
    for lean_deg in LEANS_DEG.tolist():
        sides = [leaning_normals_to_a_side(direction, lean_deg, 90.0 * turn) for turn in range(4)]
        free_um = response.free_closure_um(np.concatenate(sides), force_n)
        rows.append({"x": lean_deg, "errors": _errors(response, estimators, free_um, force_n)})
    return rows


def second_load_errors(response: FootResponse, estimators: Mapping[str, ForceEstimator], draws: int) -> Rows:
    """Return the errors beside a second contact without friction, by its size."""
    direction, rng = np.tile(paper_directions("verification"), (draws, 1)), np.random.default_rng(0)
    normal = random_directions(rng, len(direction), SECOND_MIN_ELEVATION_DEG)
    floor_n = FLOOR_GF * GRAM_FORCE_N * direction
    floor_um, rows = response.free_closure_um(direction, floor_n), []
    for share in SECOND_REL:
        second_n = share * FLOOR_GF * GRAM_FORCE_N * normal
        free_um = floor_um + response.free_closure_um(normal, second_n)
        rows.append({"x": share, "errors": _errors(response, estimators, free_um, floor_n + second_n)})
    return rows
