"""Range and force errors of a foot from its response table, gap contact included, by direction.

The same figures come from a response between the solved shapes, as a prediction, and from the table of a built foot, as
the measurement to compare it with.

Calibration: force errors that remain after calibration of a foot with fabrication tolerances, to first order.

A foot's gaps, strays, stiffness and mount deviate from the design with the process's tolerances as a normal prior. A
test stand presses the foot from all sides at two magnitudes; its readings narrow the prior to a posterior, with the
errors that the calibration assumes:

    P = (P0^-1 + sum_k H_k^T S_k^-1 H_k)^-1,    H = d(closures) / d(deviations)

The posterior's closures at a load, explained by a least-squares change of the force, are the error of that load. The
film drops out, as the unloaded reading contains it.
"""

from typing import NamedTuple

import numpy as np

from footsense.foot.directions import direction_grid, rotation, tangent_frame
from footsense.foot.force_errors import GRAM_FORCE_N
from footsense.foot.response_table import FootResponse
from footsense.foot.specimen import Deviations, Specimen
from footsense.frames import ELEMENTS, Vector
from footsense.lab.design.processes import Process
from footsense.lab.design.requirements import Requirements
from footsense.lab.evaluation.cramer_rao import Unknowns, force_bound, jacobian_um
from footsense.lab.evaluation.force_range import LoadDirections, force_limits, stated_loads
from footsense.lab.training.load_cases import sensed_closure_um

#: Elevations at which the range is stated [deg], and azimuths over which the least counts [deg].
ELEVATIONS_DEG, _AZIMUTHS_DEG = (90, 75, 60, 45, 35), [0.0, 22.5, 45.0]
#: Forces at which the errors are stated, between the smallest and the largest.
N_FORCE_LEVELS = 5
#: Errors of a test stand: lean of the stick [deg], uncertain share of a force [1], share of a closure that no model
#: explains [1], noise of a mean reading [pF]. As in the prior of `calibration/parameter_fit.py`.
_STICK_LEAN_DEG, _FORCE_REL, _MODEL_REL, _NOISE_PF = 1.5, 0.015, 0.005, 0.3e-3
#: Steps of the differences: gap over the designed one, stray [pF], stiffness [1], mount [rad].
_GAP_STEP_REL, _STRAY_STEP_PF, _STIFFNESS_STEP, _MOUNT_STEP = 0.01, 0.01, 0.01, 2e-3
#: Presses: azimuths and elevations [deg], and magnitudes over the largest force [1].
_PRESS_AZIMUTHS_DEG, _PRESS_ELEVATIONS_DEG = [30.0 * k for k in range(12)], [55.0, 75.0]
_PRESS_SIZES_REL = (0.35, 0.8)


class Assessment(NamedTuple):
    """Predicted range [N] and force errors of one foot, by direction.

    Attributes:
        unloaded_pf: Capacitance of an unloaded element [pF].
        range_by_elevation_n: Largest centred force at each of `ELEVATIONS_DEG` [N].
        all_directions_range_n: Largest force in every direction of the design, leaning contacts included [N].
        force_levels_n: Force magnitudes of the following errors [N], shape (levels,).
        direction_error_bound_deg: Cramer-Rao bound of the direction, mean over directions [deg rms], shape (levels,).
        magnitude_error_bound_rel: The same of the magnitude over the force [1].
        calibrated_direction_error_deg: Error of the direction from the fabrication tolerances that calibration leaves
            [deg rms].
        calibrated_magnitude_error_rel: The same of the magnitude over the force [1].
    """

    unloaded_pf: float
    range_by_elevation_n: Vector
    all_directions_range_n: float
    force_levels_n: Vector
    direction_error_bound_deg: Vector
    magnitude_error_bound_rel: Vector
    calibrated_direction_error_deg: float
    calibrated_magnitude_error_rel: float


def assess_foot(response: FootResponse, requirements: Requirements) -> Assessment:
    """Return predicted range and force errors of a foot from its response table."""
    foot, board = Specimen(response), requirements.board
    grid = np.concatenate([direction_grid(_AZIMUTHS_DEG, [float(e)]) for e in ELEVATIONS_DEG])
    centred_n = force_limits(foot, LoadDirections(grid, grid), board.range_end_pf).range_n
    loads = stated_loads(requirements.max_force_to_leg_axis_deg)
    levels_n = np.geomspace(requirements.min_evaluated_force_n, requirements.max_n, N_FORCE_LEVELS)
    bounds = [
        force_bound(
            foot,
            loads.normal,
            force_n * loads.direction,
            Unknowns.LEANING,
            noise_pf=board.noise_pf,
            baseline_noise_pf=board.baseline_noise_pf,
        )
        for force_n in levels_n
    ]
    return Assessment(
        response.design.unloaded_pf,
        centred_n.reshape(len(ELEVATIONS_DEG), -1).min(axis=1),
        float(force_limits(foot, loads, board.range_end_pf).range_n.min()),
        levels_n,
        np.array([bound.direction_rms_deg.mean() for bound in bounds]),
        GRAM_FORCE_N * np.array([bound.magnitude_rms_gf.mean() for bound in bounds]) / levels_n,
        *_force_errors_after_calibration(
            response, requirements.process, requirements.max_force_to_leg_axis_deg, requirements.max_n
        ),
    )


def _force_errors_after_calibration(
    response: FootResponse, process: Process, max_lean_deg: float, max_n: float
) -> tuple[float, float]:
    """Return rms direction [deg] and relative magnitude errors [1] after calibration, over the design loads.

    Args:
        response: Response table of the foot.
        process: Its tolerances.
        max_lean_deg: Largest angle between a force and the leg's axis [deg].
        max_n: Largest force [N].
    """
    presses = direction_grid(_PRESS_AZIMUTHS_DEG, _PRESS_ELEVATIONS_DEG)
    pressed_n = np.concatenate([size * max_n * presses for size in _PRESS_SIZES_REL])
    test = direction_grid([0.0, 22.5, 45.0], [90.0 - max_lean_deg / 2.0, 90.0 - max_lean_deg])
    force_n = np.concatenate([pressed_n, 0.6 * max_n * test])
    direction = force_n / np.linalg.norm(force_n, axis=1, keepdims=True)
    by_load = jacobian_um(Specimen(response), direction, force_n, Unknowns.LEANING)
    by_deviation = _deviation_jacobian_um(response, direction, force_n)
    closure_um = sensed_closure_um(Specimen(response), direction, force_n)
    design, tolerances = response.design, process.rms_deviations(response.design.gap_um)
    sigma = (
        tolerances.gap_um,
        tolerances.stray_pf,
        tolerances.stiffness_rel,
        np.radians(tolerances.mount_deg),
    )
    prior = np.maximum(np.repeat(sigma, [ELEMENTS, ELEMENTS, 1, 3]), 1e-6)
    information = np.diag(1.0 / prior**2)
    per_pf = (design.gap_um + design.film_equivalent_um) / design.unloaded_pf
    for k in range(len(pressed_n)):
        force = _FORCE_REL / np.sqrt(3.0) * by_load[k, :, :3]
        lean = np.radians(_STICK_LEAN_DEG) * by_load[k, :, 3:]
        variance = (_MODEL_REL * closure_um[k]) ** 2 + (_NOISE_PF * per_pf) ** 2
        spread = np.diag(variance) + lean @ lean.T + force @ force.T
        information += by_deviation[k].T @ np.linalg.solve(spread, by_deviation[k])
    root = np.linalg.cholesky(np.linalg.inv(information))
    angles, sizes = [], []
    for k in range(len(pressed_n), len(force_n)):
        error_rel = np.linalg.pinv(by_load[k])[:3] @ by_deviation[k] @ root
        angles.append(((np.stack(tangent_frame(direction[k])) @ error_rel) ** 2).sum())
        sizes.append(((direction[k] @ error_rel) ** 2).sum())
    return float(np.degrees(np.sqrt(np.mean(angles)))), float(np.sqrt(np.mean(sizes)))


def _deviation_jacobian_um(response: FootResponse, normal: Vector, force_n: Vector) -> Vector:
    """Return the derivatives of the sensed closures by a foot's deviations, shape (n, 9, 22).

    They are nine gaps [um], nine strays [pF], the stiffness [1], and three mounting angles [rad].
    """
    gap_step_um = _GAP_STEP_REL * response.design.gap_um
    both = (1.0, -1.0)
    element, axes = np.eye(ELEMENTS), np.eye(3)
    pairs: list[tuple[float, list[Deviations]]] = [
        *((gap_step_um, [Deviations(gap_um=s * gap_step_um * one) for s in both]) for one in element),
        *((_STRAY_STEP_PF, [Deviations(stray_pf=s * _STRAY_STEP_PF * one) for s in both]) for one in element),
        (_STIFFNESS_STEP, [Deviations(stiffness_rel=s * _STIFFNESS_STEP) for s in both]),
        *((_MOUNT_STEP, [Deviations(mount=rotation(s * _MOUNT_STEP * one)) for s in both]) for one in axes),
    ]
    columns = []
    for step, (ahead, behind) in pairs:
        change_um = sensed_closure_um(Specimen(response, ahead), normal, force_n)
        change_um -= sensed_closure_um(Specimen(response, behind), normal, force_n)
        columns.append(change_um / (2.0 * step))
    return np.stack(columns, 2)
