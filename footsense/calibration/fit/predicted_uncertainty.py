"""Force errors to expect of a calibrated foot, predicted from the posterior covariance of its parameters."""

from typing import NamedTuple

import numpy as np

from footsense.calibration.fit.parameter_fit import PRIOR_SIGMA, ParameterFit
from footsense.calibration.fit.twin import REFERENCE, FootTwin
from footsense.foot.directions import angles_between_deg, direction_grid
from footsense.foot.force_errors import GRAM_FORCE_N
from footsense.foot.gap_contact import element_means
from footsense.foot.specimen import ContactLoads

#: Closure over the smallest gap up to which a load is evaluated: a foot is not read where a gap closes.
_MAX_CLOSURE_REL = 0.7
_DRAWS, _SEED = 24, 1


class PredictedUncertainty(NamedTuple):
    """Force errors to expect over all load directions, predicted from the parameters' posterior covariance.

    Attributes:
        median_direction_error_deg: Median angle [deg].
        median_magnitude_error_rel: Median relative error of the magnitude [1].
    """

    median_direction_error_deg: float
    median_magnitude_error_rel: float


def predict_uncertainty(twin: FootTwin, fit: ParameterFit) -> PredictedUncertainty:
    """Return the expected force errors, by linear propagation of draws from the posterior.

    A foot whose parameters differ from the fitted ones changes the readings of a load; the least-squares change of
    force that explains them is the error. Loads that close a gap are left out.

    Args:
        twin: Model of the foot.
        fit: Its fitted parameters.
    """
    # From all sides down to 50 deg of elevation, of 50 and 120 gf.
    directions = np.vstack([direction_grid(30.0 * np.arange(12), [50.0, 70.0]), [0.0, 0.0, 1.0]])
    force_n = np.concatenate([size * GRAM_FORCE_N * directions for size in (50.0, 120.0)])
    fitted = fit.parameters.copy()
    fitted[REFERENCE] = 0.0  # these forces are true ones
    closure_um = element_means(twin.cell_closures_um(fitted, ContactLoads.centred(force_n)))
    force_n = force_n[closure_um.max(axis=1) < _MAX_CLOSURE_REL * twin.gap_um(fitted).min()]
    if not len(force_n):
        return PredictedUncertainty(np.inf, np.inf)
    loads, magnitude_n = ContactLoads.centred(force_n), np.linalg.norm(force_n, axis=1)
    at_pf = twin.capacitance_pf(fitted, loads)
    step_n = 1e-3 * magnitude_n[:, None]
    by_force = [
        (twin.capacitance_pf(fitted, ContactLoads.centred(force_n + step_n * axis)) - at_pf) / step_n
        for axis in np.eye(3)
    ]
    force_per_pf = np.linalg.pinv(np.stack(by_force, axis=2))
    rng = np.random.default_rng(_SEED)

    root = np.linalg.cholesky(fit.covariance)
    angles_deg, magnitudes_rel = [], []
    for _ in range(_DRAWS):
        deviation = root @ rng.normal(size=len(root))
        drawn = fitted + np.clip(deviation, -2.0 * PRIOR_SIGMA, 2.0 * PRIOR_SIGMA)
        drawn[REFERENCE] = 0.0
        change_pf = twin.capacitance_pf(np.clip(drawn, *twin.parameter_bounds()), loads) - at_pf
        estimate_n = force_n + np.einsum("nij,nj->ni", force_per_pf, change_pf)
        angles_deg.append(angles_between_deg(force_n, estimate_n))
        magnitudes_rel.append(np.abs(np.linalg.norm(estimate_n, axis=1) / magnitude_n - 1.0))
    return PredictedUncertainty(float(np.median(angles_deg)), float(np.median(magnitudes_rel)))
