"""Sizes of the feet of a robot that stands, by its weight: nobody knows each force, but all together carry the robot.

The electrodes give the direction of a force, not its size: the stiffness of the rubber and a common factor of the gains
leave no residual. With the force along each leg by the foot's electrodes and stiffness as known, f, the sizes s are
what minimises

    sum over the postures of ((sum_legs s f - m g) / sigma)^2 + sum_legs ((s - 1) / sigma_0)^2

Postures that lean to all sides on each tripod give all sizes; a common factor is as sure as the robot's mass.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from footsense.calibration.evaluation import DesignModels
from footsense.calibration.standing.recording import StandingLoads
from footsense.errors import CalibrationError
from footsense.foot.parameters import FootParameters
from footsense.frames import Vector
from footsense.sim.fabrication import size_sigma_rel

#: Standard deviation of a posture's sum over the weight [1]: legs that lean by up to 10 deg, and directions.
_SUM_SIGMA_REL = 0.02
#: Shortest time in which all feet are at rest [ns].
_SHORTEST_NS = 200_000_000
#: Largest deviation of a sum after the fit, and of the feet's mean size from what was known that is not named, over
#: their standard deviations [1].
_MOST_SUM_SIGMAS, _MOST_MEAN_SIGMAS = 3.0, 2.0
#: Standard deviation of all sizes together [1]: of the mass, and of rubber that creeps under a posture.
_COMMON_SIGMA_REL = 0.03
_GRAVITY_M_PER_S2 = 9.80665


class FeetSizes(NamedTuple):
    """Sizes of the feet of a robot.

    Attributes:
        size_rel: True over estimated force of each foot [1], shape (feet,).
        sigma_rel: Standard deviation of that [1], shape (feet,).
        n_postures: Postures of the robot that were used.
        doubt: Why the mass may be wrong, as one line; empty if nothing says so.
    """

    size_rel: Vector
    sigma_rel: Vector
    n_postures: int
    doubt: str


def common_postures(feet: Sequence[StandingLoads]) -> Vector:
    """Return the changes of all feet's readings while all are at rest [pF], shape (postures, feet, 9).

    Args:
        feet: The loads of all feet of a robot, of one recording.
    """
    found = []
    for begin_ns in sorted({span.begin_ns for foot in feet for span in foot.spans}):
        at_rest = [
            next((span for span in foot.spans if span.begin_ns <= begin_ns <= span.end_ns), None)
            for foot in feet
        ]
        spans = [span for span in at_rest if span is not None]
        if len(spans) == len(feet) and min(span.end_ns for span in spans) - begin_ns >= _SHORTEST_NS:
            found.append([span.change_pf for span in spans])
    return np.array(found).reshape(-1, len(feet), 9)


def weigh_feet(along_n: Vector, sigma_rel: Vector, mass_kg: float) -> FeetSizes:
    """Return the sizes of feet by the weight of their robot.

    Args:
        along_n: Force of each foot along its leg in each posture [N], shape (postures, feet); zero where it hangs.
        sigma_rel: Standard deviation of each size as known before [1], shape (feet,).
        mass_kg: Mass of the robot [kg].

    Raises:
        CalibrationError: No posture has a load, or their sums differ more than the feet's tolerances explain.
    """
    loaded = along_n.any(axis=1)
    along_n, weight_n = along_n[loaded], mass_kg * _GRAVITY_M_PER_S2
    if not len(along_n):
        raise CalibrationError(
            "there is no time in which every foot stands still or hangs, and one carries a load; hold each posture for "
            "a second"
        )
    shares = along_n / (_SUM_SIGMA_REL * weight_n)
    covariance = np.linalg.inv(shares.T @ shares + np.diag(sigma_rel**-2.0))
    size_rel = covariance @ (shares.sum(axis=0) / _SUM_SIGMA_REL + sigma_rel**-2.0)
    off_rel = along_n @ size_rel / weight_n - 1.0
    if np.abs(off_rel).max() > _MOST_SUM_SIGMAS * _SUM_SIGMA_REL:
        sums_n = along_n @ size_rel
        raise CalibrationError(
            f"the feet carry {sums_n.min():.3g} to {sums_n.max():.3g} N in {len(along_n)} postures, and a robot of "
            f"{mass_kg:g} kg weighs {weight_n:.3g} N: check the mass, and that it touches nothing but the ground, with "
            "its legs upright"
        )
    mean_rel, mean_sigma_rel = size_rel.mean() - 1.0, float(np.sqrt((sigma_rel**2).sum())) / len(sigma_rel)
    doubt = (
        f"the feet's mean size is {mean_rel:+.0%} from what was known of them, {abs(mean_rel) / mean_sigma_rel:.1f} "
        f"times its standard deviation: check the mass of {mass_kg:g} kg"
        if abs(mean_rel) > _MOST_MEAN_SIGMAS * mean_sigma_rel
        else ""
    )
    return FeetSizes(size_rel, np.hypot(np.sqrt(np.diag(covariance)), _COMMON_SIGMA_REL), len(along_n), doubt)


def sizes_by_weight(
    models: DesignModels,
    recordings: Sequence[Sequence[StandingLoads]],
    feet: Sequence[FootParameters],
    mass_kg: float,
) -> FeetSizes:
    """Return the sizes of all feet of a robot that stood.

    Args:
        models: Models of the feet's type.
        recordings: Loads of each foot in each recording.
        feet: Parameters of the feet, in the same order.
        mass_kg: Mass of the robot [kg].

    Raises:
        CalibrationError: As of `weigh_feet`.
    """
    postures_pf = np.concatenate([common_postures(one) for one in recordings])
    along_n = np.zeros(postures_pf.shape[:2])
    for row, foot in enumerate(feet if len(postures_pf) else []):
        change_pf = postures_pf[:, row]
        load = models.estimate_in_foot_frame(
            foot.unloaded_pf + change_pf, foot.unloaded_pf, foot.stray_pf, foot.gain_rel
        )
        along_n[:, row] = np.where(change_pf.any(axis=1), load.force_n @ foot.force_matrix[2], 0.0)
    sigma_rel = np.array([size_sigma_rel(foot) or foot.error_rel for foot in feet])
    return weigh_feet(along_n, sigma_rel, mass_kg)
