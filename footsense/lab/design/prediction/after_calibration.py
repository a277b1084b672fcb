"""Force errors that remain after calibration of a foot with fabrication tolerances, to first order.

A foot's gaps, strays, stiffness and mount deviate from the design with the process's tolerances as a normal prior. A
test stand presses the foot from all sides at two magnitudes; its readings narrow the prior to a posterior, with the
errors that the calibration assumes:

    P = (P0^-1 + sum_k H_k^T S_k^-1 H_k)^-1,    H = d(closures) / d(deviations)

The posterior's closures at a load, explained by a least-squares change of the force, are the error of that load. The
film drops out, as the unloaded reading contains it.
"""

import numpy as np

from footsense.foot.directions import direction_grid, rotation, tangent_frame
from footsense.foot.response_table import FootResponse
from footsense.foot.specimen import Deviations, Foot
from footsense.frames import ELEMENTS, Vector
from footsense.lab.design.inputs.processes import Process

#: Errors of a test stand: lean of the stick [deg], uncertain share of a force [1], share of a closure that no model
#: explains [1], noise of a mean reading [pF]. As in the prior of `calibration/parameter_fit.py`.
_STICK_LEAN_DEG, _FORCE_REL, _MODEL_REL, _NOISE_PF = 1.5, 0.015, 0.005, 0.3e-3
#: Steps of the differences: gap over the designed one, stray [pF], stiffness [1], mount [rad].
_GAP_STEP_REL, _STRAY_STEP_PF, _STIFFNESS_STEP, _MOUNT_STEP = 0.01, 0.01, 0.01, 2e-3
#: Presses: azimuths and elevations [deg], and magnitudes over the largest force [1].
_AZIMUTHS_DEG, _ELEVATIONS_DEG, _SIZES_REL = tuple(range(0, 360, 30)), (55.0, 75.0), (0.35, 0.8)


def force_errors_after_calibration(
    response: FootResponse, process: Process, max_lean_deg: float, max_n: float
) -> tuple[float, float]:
    """Return rms direction [deg] and relative magnitude errors [1] after calibration, over the design loads.

    Args:
        response: Response table of the foot.
        process: Its tolerances.
        max_lean_deg: Largest angle between a force and the leg's axis [deg].
        max_n: Largest force [N].
    """
    presses = direction_grid(list(map(float, _AZIMUTHS_DEG)), list(_ELEVATIONS_DEG))
    pressed_n = np.concatenate([size * max_n * presses for size in _SIZES_REL])
    test = direction_grid([0.0, 22.5, 45.0], [90.0 - max_lean_deg / 2.0, 90.0 - max_lean_deg])
    tested_n = 0.6 * max_n * test
    slopes = _jacobians_and_closures_um(response, np.concatenate([pressed_n, tested_n]))
    by_deviation, by_force, by_normal, closure = slopes
    n = len(pressed_n)
    prior = _prior_sigma(process, response.design.gap_um)
    information = np.diag(1.0 / prior**2)
    design = response.design
    per_pf = (design.gap_um + design.film_equivalent_um) / design.unloaded_pf
    for k in range(n):
        lean = np.radians(_STICK_LEAN_DEG) * by_normal[k]
        force = _FORCE_REL * by_force[k] * np.linalg.norm(pressed_n[k]) / np.sqrt(3.0)
        variance = (_MODEL_REL * closure[k]) ** 2 + (_NOISE_PF * per_pf) ** 2
        spread = np.diag(variance) + lean @ lean.T + force @ force.T
        information += by_deviation[k].T @ np.linalg.solve(spread, by_deviation[k])
    root = np.linalg.cholesky(np.linalg.inv(information))
    angles, sizes = [], []
    for k in range(n, n + len(tested_n)):
        unknown = np.concatenate([by_force[k], by_normal[k]], axis=1)
        error_n = np.linalg.pinv(unknown)[:3] @ by_deviation[k] @ root
        size = np.linalg.norm(tested_n[k - n])
        direction = tested_n[k - n] / size
        angles.append(((np.stack(tangent_frame(direction)) @ error_n) ** 2).sum() / size**2)
        sizes.append(((direction @ error_n) ** 2).sum() / size**2)
    return float(np.degrees(np.sqrt(np.mean(angles)))), float(np.sqrt(np.mean(sizes)))


def gap_sigma_um(process: Process, gap_um: float) -> float:
    """Return the rms deviation of the gap that a process causes [um]."""
    return float(np.hypot(process.gap_tolerance_um, process.gap_tolerance_rel * gap_um))


def _prior_sigma(process: Process, gap_um: float) -> Vector:
    """Return prior standard deviations: nine gaps [um], nine strays [pF], stiffness [1], mounting angles [rad]."""
    gap = gap_sigma_um(process, gap_um)
    sigma = [
        gap,
        process.stray_tolerance_pf,
        process.stiffness_tolerance_rel,
        np.radians(process.mount_tolerance_deg),
    ]
    prior: Vector = np.maximum(np.repeat(sigma, [ELEMENTS, ELEMENTS, 1, 3]), 1e-6)
    return prior


def _jacobians_and_closures_um(
    response: FootResponse, force_n: Vector
) -> tuple[Vector, Vector, Vector, Vector]:
    """Return closure Jacobians by deviations (n, 9, 22), force (n, 9, 3) and normal (n, 9, 2), and the closures [um].

    Args:
        response: The foot.
        force_n: Centred loads [N], shape (n, 3).
    """
    design = response.design
    normal = force_n / np.linalg.norm(force_n, axis=1, keepdims=True)
    one = np.eye(ELEMENTS)

    def sensed_closure_um(
        deviations: Deviations, normal: Vector = normal, force_n: Vector = force_n
    ) -> Vector:
        """Return the sensed closures [um] of a deviating foot under given loads."""
        foot = Foot(response, deviations)
        return design.closure_um(foot.capacitance_pf(normal, force_n), foot.unloaded_pf)

    def slope(ahead: Deviations, behind: Deviations, step: float) -> Vector:
        """Return the central difference quotient of two closure arrays."""
        return (sensed_closure_um(ahead) - sensed_closure_um(behind)) / (2.0 * step)

    gap, stray, stiff, turn = _GAP_STEP_REL * design.gap_um, _STRAY_STEP_PF, _STIFFNESS_STEP, _MOUNT_STEP
    columns = [slope(Deviations(gap_um=gap * unit), Deviations(gap_um=-gap * unit), gap) for unit in one]
    columns += [
        slope(Deviations(stray_pf=stray * unit), Deviations(stray_pf=-stray * unit), stray) for unit in one
    ]
    columns.append(slope(Deviations(stiffness_rel=stiff), Deviations(stiffness_rel=-stiff), stiff))
    columns += [
        slope(Deviations(mount=rotation(turn * axis)), Deviations(mount=rotation(-turn * axis)), turn)
        for axis in np.eye(3)
    ]
    size = np.linalg.norm(force_n, axis=1, keepdims=True)
    designed = Deviations()
    forces = []
    for axis in np.eye(3):
        ahead, behind = (
            sensed_closure_um(designed, normal, force_n + sign * 1e-3 * size * axis) for sign in (1.0, -1.0)
        )
        forces.append((ahead - behind) / (2e-3 * size))
    turns = []
    for across in tangent_frame(normal):
        ahead, behind = (
            sensed_closure_um(
                designed,
                (moved := normal + sign * 1e-3 * across) / np.linalg.norm(moved, axis=1, keepdims=True),
            )
            for sign in (1.0, -1.0)
        )
        turns.append((ahead - behind) / 2e-3)
    closure = sensed_closure_um(designed)
    return np.stack(columns, 2), np.stack(forces, 2), np.stack(turns, 2), closure
