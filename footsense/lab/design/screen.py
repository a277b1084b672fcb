"""Screening of all candidates, vectorised: force range, limiting factor, Cramer-Rao bound of the error.

The range is an estimate of `evaluation.force_range` without gap contact, so that hundreds of thousands of feet take
seconds; the contact patch has to be no wider than the response table holds, too.
Errors are the Cramer-Rao bound of one scan for an unknown force and contact (`evaluation.cramer_rao`), from the
smallest force to the largest.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from footsense.foot.directions import tangent_frame
from footsense.frames import Vector
from footsense.lab.design.candidates import Candidates
from footsense.lab.design.closures import ClosureModel, Influence
from footsense.lab.design.requirements import Converter, Requirements
from footsense.lab.design.shapes import RUBBER_POISSON, FootShapeLibrary
from footsense.lab.evaluation.force_range import MAX_READABLE_CLOSURE_REL, stated_loads
from footsense.lab.geometry import MIN_FITTED_ELEVATION_DEG, MIN_TABLE_ELEVATION_DEG

#: Feet evaluated at once, which limits memory.
_FEET_PER_CALL = 2000
#: Forces between the smallest and the largest at which errors are evaluated, evenly in the logarithm.
_N_FORCE_LEVELS = 3
#: The foot is trained beyond its range by this factor, and its patch has to be in the table there too [1].
TRAINED_RANGE_FACTOR = 1.5
#: What ends a foot's range, by number.
LIMIT_NAMES = ("gap", "converter", "patch")


class ScreeningResult(NamedTuple):
    """Force range [N], limiting factor and error bounds of n candidates.

    Attributes:
        range_n: Largest force in every direction of the design [N], shape (n,).
        limiting_factor_index: What ends it, a number in `LIMIT_NAMES`, shape (n,).
        direction_error_bound_deg: Cramer-Rao bound of the direction, mean over loads [deg rms], shape (n,); NaN if the
            largest force is beyond the range.
        magnitude_error_bound_rel: The same of the magnitude over the force [1].
    """

    range_n: Vector
    limiting_factor_index: NDArray[np.intp]
    direction_error_bound_deg: Vector
    magnitude_error_bound_rel: Vector


def patch_limit_n(feet: Candidates) -> Vector:
    """Return the force at which the contact patch reaches the response table's largest angle [N], shape (n,)."""
    widest = np.radians(MIN_TABLE_ELEVATION_DEG - MIN_FITTED_ELEVATION_DEG)
    limit: Vector = widest**3 * feet.rubber_mpa * feet.ball_radius_mm**2 / (0.75 * (1.0 - RUBBER_POISSON**2))
    return limit


def screen_candidates(
    library: FootShapeLibrary, requirements: Requirements, feet: Candidates
) -> ScreeningResult:
    """Return force range and error bounds of every candidate."""
    model = ClosureModel(library, stated_loads(requirements.max_force_to_leg_axis_deg))
    parts = [
        _screen_batch(model, requirements, feet.select(slice(first, first + _FEET_PER_CALL)))
        for first in range(0, len(feet.gap_um), _FEET_PER_CALL)
    ]
    return ScreeningResult(*(np.concatenate(field) for field in zip(*parts, strict=True)))


def _screen_batch(model: ClosureModel, requirements: Requirements, feet: Candidates) -> ScreeningResult:
    """Return force range and error bounds of one batch of candidates."""
    influence = model.influence(feet)
    by_gap = _force_at_closure_n(model, influence, feet, MAX_READABLE_CLOSURE_REL * feet.gap_um)
    readable = feet.unloaded_distance_um - feet.eps0_area_pf_um / requirements.board.range_end_pf
    by_converter = _force_at_closure_n(model, influence, feet, np.maximum(readable, 1e-9))
    limits = np.stack([by_gap, by_converter, patch_limit_n(feet) / TRAINED_RANGE_FACTOR])
    range_n, limit = limits.min(axis=0), limits.argmin(axis=0)
    direction, magnitude = np.full((2, len(range_n)), np.nan)
    able = np.flatnonzero(range_n >= requirements.max_n)
    if len(able):
        some = Influence(influence.point_force_um_per_n[able], influence.patch_correction_um_per_n[able])
        direction[able], magnitude[able] = _mean_error_bounds(model, some, feet.select(able), requirements)
    return ScreeningResult(range_n, limit, direction, magnitude)


def _force_at_closure_n(
    model: ClosureModel, influence: Influence, feet: Candidates, closure_um: Vector
) -> Vector:
    """Return the least force at which some element reaches a given closure, over all loads [N], shape (n,).

    An electrode that bends reads as closed a little more than its mean: its closest parts count most.
    """
    direction, normal = model.loads
    pressing = (direction * normal).sum(axis=1) ** (2.0 / 3.0)
    point = np.einsum("nmce,mc->nme", influence.point_force_um_per_n[:, :, 0], direction)
    patch = (
        np.einsum("nmce,mc->nme", influence.patch_correction_um_per_n[:, :, 0], direction) * pressing[:, None]
    )
    read, open_um = closure_um[:, None, None], feet.unloaded_distance_um[:, None, None]
    # The mean d of distances D - d that reads as r: d + v d^2 / (D - d) = r to second order, v the relative variance.
    even = 1.0 - model.unevenness
    total = open_um + read
    wanted = (total - np.sqrt(total**2 - 4.0 * even * read * open_um)) / (2.0 * even)
    most = 1e6
    force = np.clip(wanted / np.maximum(point, 1e-12), 0.0, most)
    for _ in range(12):
        # Newton for F point + F^(5/3) patch = wanted; the patch's part is small and may be negative.
        grown = force ** (2.0 / 3.0)
        slope = np.maximum(point + (5.0 / 3.0) * grown * patch, 0.2 * np.maximum(point, 1e-12))
        force = np.clip(force - (force * (point + grown * patch) - wanted) / slope, 0.0, most)
    least: Vector = force.min(axis=(1, 2))
    return least


def closure_sigma_um(board: Converter, feet: Candidates, closure_um: Vector) -> Vector:
    """Return the standard deviation of measured closures [um] by candidate, shape of `closure_um`."""
    shape = (-1, *(1,) * (closure_um.ndim - 1))
    open_um, plates = feet.unloaded_distance_um.reshape(shape), feet.eps0_area_pf_um.reshape(shape)
    now, rest = (open_um - closure_um) ** 2 * board.noise_pf, open_um**2 * board.baseline_noise_pf
    sigma: Vector = np.hypot(now, rest) / plates
    return sigma


def _mean_error_bounds(
    model: ClosureModel, influence: Influence, feet: Candidates, requirements: Requirements
) -> tuple[Vector, Vector]:
    """Return Cramer-Rao bounds of direction [deg] and relative magnitude [1], averaged over loads, (n,) each."""
    direction = model.loads.direction
    across = np.stack(tangent_frame(direction), axis=1)
    angles, sizes = [], []
    for force_n in np.geomspace(requirements.min_evaluated_force_n, requirements.max_n, _N_FORCE_LEVELS):
        closure, slopes = model.closures_and_jacobian_um(
            influence, np.full((len(feet.gap_um), len(direction)), force_n)
        )
        whitened = slopes / closure_sigma_um(requirements.board, feet, closure)[..., None]
        information = np.einsum("nmei,nmej->nmij", whitened, whitened)
        covariance = np.linalg.inv(information)[..., :3, :3]  # over the squared force
        angles.append(np.einsum("mtc,nmcd,mtd->nm", across, covariance, across))
        sizes.append(np.einsum("mc,nmcd,md->nm", direction, covariance, direction))
    direction_bound_deg = np.degrees(np.sqrt(np.array(angles)).mean(axis=(0, 2)))
    return direction_bound_deg, np.sqrt(np.array(sizes)).mean(axis=(0, 2))
