"""Range and force errors of a foot from its response table, gap contact included, by direction.

The same figures come from a response between the solved shapes, as a prediction, and from the table of a built foot, as
the measurement to compare it with.
"""

from typing import NamedTuple

import numpy as np

from footsense.foot.directions import direction_grid
from footsense.foot.force_errors import GRAM_FORCE_N
from footsense.foot.response_table import FootResponse
from footsense.foot.specimen import Foot
from footsense.frames import Vector
from footsense.lab.design.after_calibration import force_errors_after_calibration
from footsense.lab.design.requirements import Requirements
from footsense.lab.evaluation.cramer_rao import Unknowns, force_bound
from footsense.lab.evaluation.force_range import LoadDirections, force_limits, stated_loads

#: Elevations at which the range is stated [deg], and azimuths over which the least counts [deg].
ELEVATIONS_DEG, _AZIMUTHS_DEG = (90, 75, 60, 45, 35), [0.0, 22.5, 45.0]
#: Forces at which the errors are stated, between the smallest and the largest.
N_FORCE_LEVELS = 5


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
        *force_errors_after_calibration(
            response, requirements.process, requirements.max_force_to_leg_axis_deg, requirements.max_n
        ),
    )
