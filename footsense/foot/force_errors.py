"""Direction and magnitude errors of estimated forces, in the paper's units [deg, gf].

Direction error: angle between true and estimated force [deg]. Magnitude error: | |f| - |f_est| | [gf].
"""

from dataclasses import dataclass

import numpy as np

from footsense.foot.directions import angles_between_deg
from footsense.frames import Vector

#: One gram-force [N], by the standard acceleration of free fall.
GRAM_FORCE_N = 9.80665e-3


@dataclass(frozen=True, slots=True)
class ForceErrors:
    """Mean, 95th percentile and maximum of the direction and magnitude errors over a set of cases.

    Attributes:
        direction_deg: Mean angle between true and estimated force [deg].
        direction_p95_deg: 95th percentile of that angle [deg].
        direction_max_deg: Largest angle [deg].
        magnitude_gf: Mean of the absolute magnitude errors [gf].
        magnitude_p95_gf: 95th percentile of the magnitude errors [gf].
        magnitude_max_gf: Largest magnitude error [gf].
        n: Number of cases.
    """

    direction_deg: float
    direction_p95_deg: float
    direction_max_deg: float
    magnitude_gf: float
    magnitude_p95_gf: float
    magnitude_max_gf: float
    n: int


def magnitude_errors_gf(truth_n: Vector, estimate_n: Vector) -> Vector:
    """Return the absolute magnitude error of each estimated force [gf], shape (n,).

    Args:
        truth_n: True forces [N], shape (n, 3).
        estimate_n: Estimates [N], same shape.
    """
    size_n, guess_n = np.linalg.norm(truth_n, axis=1), np.linalg.norm(estimate_n, axis=1)
    error_gf: Vector = np.abs(size_n - guess_n) / GRAM_FORCE_N
    return error_gf


def evaluate_force_errors(truth_n: Vector, estimate_n: Vector) -> ForceErrors:
    """Return error statistics of estimated against true forces [N], shape (n, 3) each, n > 0, no true one zero."""
    angle_deg = angles_between_deg(truth_n, estimate_n)
    error_gf = magnitude_errors_gf(truth_n, estimate_n)
    return ForceErrors(
        direction_deg=float(angle_deg.mean()),
        direction_p95_deg=float(np.percentile(angle_deg, 95)),
        direction_max_deg=float(angle_deg.max()),
        magnitude_gf=float(error_gf.mean()),
        magnitude_p95_gf=float(np.percentile(error_gf, 95)),
        magnitude_max_gf=float(error_gf.max()),
        n=len(truth_n),
    )
