"""How wrong a read-out is, in the paper's units, and the linear read-outs to judge the network by.

Direction error: angle between true and estimated force [deg]. Magnitude error: | |f| - |f_est| | [gf].
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from footsense.core.design import CapacitorDesign
from footsense.lab.dataset import GRAM_FORCE_N, Cases

#: The paper's errors on its verification cases: section III F (simulation) [deg, gf].
PAPER_DIRECTION_DEG, PAPER_MAGNITUDE_GF = 2.4, 5.3

#: Makes forces [N], shape (n, 3), of closures [um], shape (n, 9).
Readout = Callable[[NDArray[np.float64]], NDArray[np.float64]]


@dataclass(frozen=True, slots=True)
class Errors:
    """Errors over a set of cases.

    Attributes:
        direction_deg: Mean angle [deg].
        direction_p95_deg: 95th percentile of the angle [deg].
        direction_max_deg: Largest angle [deg].
        magnitude_gf: Mean magnitude error [gf].
        magnitude_p95_gf: 95th percentile of it [gf].
        magnitude_max_gf: Largest one [gf].
        n: Cases.
    """

    direction_deg: float
    direction_p95_deg: float
    direction_max_deg: float
    magnitude_gf: float
    magnitude_p95_gf: float
    magnitude_max_gf: float
    n: int


def errors(truth_n: NDArray[np.float64], estimate_n: NDArray[np.float64]) -> Errors:
    """Return the errors of estimated forces [N], both of shape (n, 3), no true force zero."""
    size, guess = np.linalg.norm(truth_n, axis=1), np.linalg.norm(estimate_n, axis=1)
    # atan2 keeps small angles that arccos of a number near one would lose.
    sine = np.linalg.norm(np.cross(truth_n, estimate_n), axis=1)
    angle_deg = np.degrees(np.arctan2(sine, (truth_n * estimate_n).sum(axis=1)))
    magnitude_gf = np.abs(size - guess) / GRAM_FORCE_N
    return Errors(
        direction_deg=float(angle_deg.mean()),
        direction_p95_deg=float(np.percentile(angle_deg, 95)),
        direction_max_deg=float(angle_deg.max()),
        magnitude_gf=float(magnitude_gf.mean()),
        magnitude_p95_gf=float(np.percentile(magnitude_gf, 95)),
        magnitude_max_gf=float(magnitude_gf.max()),
        n=len(truth_n),
    )


def _least_squares(features: NDArray[np.float64], force_n: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the matrix that reads forces from features, without offset: no load reads zero."""
    matrix, *_ = np.linalg.lstsq(features, force_n, rcond=None)
    return np.asarray(matrix, dtype=np.float64)


def capacitance_readout(design: CapacitorDesign, training: Cases) -> Readout:
    """Return the linear read-out of the capacitance change: what the paper's network is fed with."""

    def change_pf(closure_um: NDArray[np.float64]) -> NDArray[np.float64]:
        return design.capacitance_pf(closure_um) - design.rest_pf

    matrix = _least_squares(change_pf(training.closure_um), training.force_n)
    return lambda closure_um: change_pf(closure_um) @ matrix


def elastance_readout(training: Cases) -> Readout:
    """Return the linear read-out of the gap closure, which is what elastance measures."""
    matrix = _least_squares(training.closure_um, training.force_n)
    return lambda closure_um: closure_um @ matrix


def coverage(
    truth_n: NDArray[np.float64], estimate_n: NDArray[np.float64], sigma_n: NDArray[np.float64]
) -> dict[str, list[float]]:
    """Return the share of cases whose error is within one and within two sigma, per axis; 0.683 and 0.954 if Gaussian.

    Args:
        truth_n: True forces [N], shape (n, 3).
        estimate_n: Estimates [N], shape (n, 3).
        sigma_n: Their stated standard deviations [N], shape (n, 3).
    """
    off = np.abs(estimate_n - truth_n) / sigma_n
    return {f"within_{k}_sigma": np.mean(off < k, axis=0).round(4).tolist() for k in (1, 2)}
