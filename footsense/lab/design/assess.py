"""Range and force errors of a foot from its response table, gap contact included.

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
from footsense.lab.evaluation.cramer_rao import force_bound, jacobian_um
from footsense.lab.evaluation.force_range import force_range, largest_loads_n
from footsense.lab.geometry import FootDesign
from footsense.lab.training.load_cases import sensed_closure_um

#: Loads at which the errors are stated, between the smallest and the largest.
_N_LOAD_LEVELS = 5
#: Errors of a test stand: lean of the stick [deg], uncertain share of a force [1], share of a closure that no model
#: explains [1], noise of a mean reading [pF]. As in the prior of `calibration/parameter_fit.py`.
_STICK_LEAN_DEG, _FORCE_REL, _MODEL_REL, _NOISE_PF = 1.5, 0.015, 0.005, 0.3e-3
#: Steps of the differences: gap over the designed one, stray [pF], stiffness [1], mount [rad].
_GAP_STEP_REL, _STRAY_STEP_PF, _STIFFNESS_STEP, _MOUNT_STEP = 0.01, 0.01, 0.01, 2e-3
#: Presses: azimuths and elevations [deg], and magnitudes over the largest load [1].
_PRESS_AZIMUTHS_DEG, _PRESS_ELEVATIONS_DEG = [30.0 * k for k in range(12)], [55.0, 75.0]
_PRESS_SIZES_REL = (0.35, 0.8)
#: Centred forces after calibration: azimuths and elevations [deg], and magnitude over the largest load [1].
_TEST_AZIMUTHS_DEG, _TEST_ELEVATIONS_DEG, _TEST_SIZE_REL = [0.0, 22.5, 45.0], [75.0, 60.0], 0.6


class Assessment(NamedTuple):
    """Predicted range [N] and force errors of one foot.

    Attributes:
        unloaded_pf: Capacitance of an unloaded element [pF].
        upright_range_n: Largest normal loads by lean, as `ForceRange` [N], shape (3,).
        centred_range_n: Largest centred force, likewise [N].
        design_range_n: Largest normal load under every load of the design [N].
        load_levels_n: Normal loads of the following errors [N], shape (levels,).
        direction_error_bound_deg: Cramer-Rao bound of the direction, mean over the design's loads [deg rms], shape
            (levels,).
        magnitude_error_bound_rel: The same of the magnitude over the force [1].
        calibrated_direction_error_deg: Error of the direction from the fabrication tolerances that calibration leaves
            [deg rms].
        calibrated_magnitude_error_rel: The same of the magnitude over the force [1].
    """

    unloaded_pf: float
    upright_range_n: Vector
    centred_range_n: float
    design_range_n: float
    load_levels_n: Vector
    direction_error_bound_deg: Vector
    magnitude_error_bound_rel: Vector
    calibrated_direction_error_deg: float
    calibrated_magnitude_error_rel: float


def assess_foot(foot_design: FootDesign, response: FootResponse, requirements: Requirements) -> Assessment:
    """Return predicted range and force errors of a foot from its response table."""
    foot, board = Specimen(response), requirements.board
    loads, stated = requirements.loads, force_range(foot, foot_design.loads.max_n, board.range_end_pf)
    levels_n = np.geomspace(requirements.min_load_n, requirements.max_load_n, _N_LOAD_LEVELS)
    bounds = [
        force_bound(foot, loads.normal, load_n * loads.force_n, noise_pf=board.noise_pf)
        for load_n in levels_n
    ]
    magnitude_rel = [
        GRAM_FORCE_N * (one.magnitude_rms_gf / np.linalg.norm(one.true_force_n, axis=1)).mean()
        for one in bounds
    ]
    return Assessment(
        response.design.unloaded_pf,
        stated.upright_n,
        stated.centred_n,
        float(largest_loads_n(foot, loads, board.range_end_pf).min()),
        levels_n,
        np.array([bound.direction_rms_deg.mean() for bound in bounds]),
        np.array(magnitude_rel),
        *_force_errors_after_calibration(response, requirements.process, requirements.max_load_n),
    )


def _force_errors_after_calibration(
    response: FootResponse, process: Process, max_load_n: float
) -> tuple[float, float]:
    """Return rms direction [deg] and relative magnitude errors [1] after calibration, over centred forces.

    Args:
        response: Response table of the foot.
        process: Its tolerances.
        max_load_n: Largest normal load [N].
    """
    presses = direction_grid(_PRESS_AZIMUTHS_DEG, _PRESS_ELEVATIONS_DEG)
    pressed_n = np.concatenate([size * max_load_n * presses for size in _PRESS_SIZES_REL])
    test = direction_grid(_TEST_AZIMUTHS_DEG, _TEST_ELEVATIONS_DEG)
    force_n = np.concatenate([pressed_n, _TEST_SIZE_REL * max_load_n * test])
    direction = force_n / np.linalg.norm(force_n, axis=1, keepdims=True)
    by_load = jacobian_um(Specimen(response), direction, force_n)
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
