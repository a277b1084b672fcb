"""Range and force errors of a foot from its response table, gap contact included, by direction.

The same figures come from a response between the solved shapes, as a prediction, and from the table of a built foot, as
the measurement to compare it with.
"""

from typing import NamedTuple

import numpy as np

from footsense.foot.capacitor import Capacitor
from footsense.foot.directions import direction_grid, tangent_frame
from footsense.foot.response_table import FootResponse
from footsense.foot.specimen import Foot
from footsense.frames import Vector
from footsense.lab.design.inputs.boards import Converter
from footsense.lab.design.inputs.requirements import MAX_READABLE_CLOSURE_REL, Requirements
from footsense.lab.design.prediction.after_calibration import force_errors_after_calibration
from footsense.lab.design.prediction.closures import LoadDirections, design_loads
from footsense.lab.evaluation.cramer_rao import Unknowns, jacobian_um
from footsense.lab.training.load_cases import sensed_closure_um

#: Elevations at which the range is stated [deg], and azimuths over which the least counts [deg].
ELEVATIONS_DEG, _AZIMUTHS_DEG = (90, 75, 60, 45, 35), (0.0, 22.5, 45.0)
#: Bisections of the range, and forces at which the errors are stated, between the smallest and the largest.
_BISECTIONS, N_FORCE_LEVELS = 14, 5


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
    foot, board = Foot(response), requirements.board
    grids = [direction_grid(list(_AZIMUTHS_DEG), [float(elevation)]) for elevation in ELEVATIONS_DEG]
    by_elevation = [
        _max_force_readable_in_all_directions_n(foot, board, LoadDirections(grid, grid)) for grid in grids
    ]
    loads = design_loads(requirements.max_force_to_leg_axis_deg)
    all_directions_range_n = _max_force_readable_in_all_directions_n(foot, board, loads)
    force_n = np.geomspace(requirements.min_evaluated_force_n, requirements.max_n, N_FORCE_LEVELS)
    rows = [_mean_cramer_rao_bounds(foot, board, loads.normal, size * loads.direction) for size in force_n]
    direction_bound_deg, magnitude_bound_rel = np.array(rows).T
    calibrated_direction_error_deg, calibrated_magnitude_error_rel = force_errors_after_calibration(
        response, requirements.process, requirements.max_force_to_leg_axis_deg, float(force_n[-1])
    )
    return Assessment(
        response.design.unloaded_pf,
        np.array(by_elevation),
        all_directions_range_n,
        force_n,
        direction_bound_deg,
        magnitude_bound_rel,
        calibrated_direction_error_deg,
        calibrated_magnitude_error_rel,
    )


def _max_force_readable_in_all_directions_n(foot: Foot, board: Converter, loads: LoadDirections) -> float:
    """Return the largest force [N] that is readable in all given directions (one value), by bisection."""
    design = foot.response.design
    readable_um = (
        design.gap_um + design.film_equivalent_um - design.plate_distance_um(np.array(board.range_end_pf))
    )
    largest_um = min(MAX_READABLE_CLOSURE_REL * design.gap_um, float(readable_um))
    one_um = foot.response.free_element_closures_um(loads.normal, loads.direction).max()
    low, high = 0.0, 4.0 * largest_um / float(one_um)
    for _ in range(_BISECTIONS):
        middle = (low + high) / 2.0
        if sensed_closure_um(foot, loads.normal, middle * loads.direction).max() <= largest_um:
            low = middle
        else:
            high = middle
    return low


def closure_sigma_um(board: Converter, design: Capacitor, closure_um: Vector) -> Vector:
    """Return the standard deviation of measured closures [um] from a board's noise, shape of `closure_um`."""
    rest_um = design.gap_um + design.film_equivalent_um
    plates = design.unloaded_pf * rest_um
    sigma: Vector = (
        np.hypot((rest_um - closure_um) ** 2 * board.noise_pf, rest_um**2 * board.baseline_noise_pf) / plates
    )
    return sigma


def _mean_cramer_rao_bounds(
    foot: Foot, board: Converter, normal: Vector, force_n: Vector
) -> tuple[float, float]:
    """Return the Cramer-Rao bounds of direction [deg] and relative magnitude [1], rms, averaged over the loads."""
    closure_um = sensed_closure_um(foot, normal, force_n)
    slopes = jacobian_um(foot, normal, force_n, Unknowns.LEANING)
    whitened = slopes / closure_sigma_um(board, foot.response.design, closure_um)[..., None]
    inverse = np.linalg.inv(np.linalg.qr(whitened, mode="r"))[:, :3]
    direction = force_n / np.linalg.norm(force_n, axis=1, keepdims=True)
    across = np.stack(tangent_frame(direction), axis=1)
    angle = np.sqrt(((across @ inverse) ** 2).sum(axis=(1, 2)))
    size = np.sqrt(((direction[:, None] @ inverse) ** 2).sum(axis=(1, 2)))
    return float(np.degrees(angle).mean()), float(size.mean())
