"""Calibrate feet by standing, without a reference sensor: the electrodes from the loads of some postures.

Nobody knows these forces. The foot's mount and the stiffness of its rubber stay as they were: no reading shows them.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from footsense.calibration.calibrate import MAX_MEDIAN_MAHALANOBIS_DISTANCE, MIN_LOADS
from footsense.calibration.evaluation import DesignModels
from footsense.calibration.parameter_fit import (
    MODEL_ERROR_REL,
    PRIOR_SIGMA,
    READING_NOISE_PF,
    PredictedUncertainty,
    predict_uncertainty,
)
from footsense.calibration.standing.fit import (
    N_ELECTRODE_PARAMETERS,
    ElectrodeFit,
    Electrodes,
    LoadReadings,
    fit_electrodes,
)
from footsense.calibration.standing.recording import StandingLoads
from footsense.calibration.twin import FootTwin
from footsense.errors import CalibrationError
from footsense.foot.contact_coordinates import contact_loads
from footsense.foot.directions import angles_between_deg
from footsense.foot.parameters import FootParameters
from footsense.frames import Vector

#: Covariance of a floor that adds nothing to the readings [pF2].
_NO_FLOOR: Vector = 1e-20 * np.eye(9)
#: Largest predicted direction error with which gains count as known [deg]: a tenth of a carelessly made foot's.
_MAX_PREDICTED_DEG = 1.5
#: Share of the loaded time that a foot has to stand still, below which motion is the reason for too few loads [1].
_MIN_STILL_SHARE = 0.2
#: Postures whose loads distinguish an element's gain from another's.
_MORE_POSTURES = "lean the body forward, back, to the left and to the right, and stand on fewer legs"
#: Median angle of a direction error over the standard deviation of each of its components [1].
_MEDIAN_OVER_SIGMA = 1.177


class StandingCalibration(NamedTuple):
    """Parameters of a foot by standing.

    Attributes:
        parameters: Parameters of the foot; stiffness and mount are those that were known.
        fit: Fit of its electrodes.
        predicted_uncertainty: Force errors expected from what remains unknown of the electrodes.
        turned_deg: Median angle between the forces of its loads with these parameters and as known before [deg].
    """

    parameters: FootParameters
    fit: ElectrodeFit
    predicted_uncertainty: PredictedUncertainty
    turned_deg: float


def calibrate_standing(
    models: DesignModels, loads: StandingLoads, known: FootParameters | None
) -> StandingCalibration:
    """Fit the electrodes of a foot to its loads at rest; raise an error if they do not identify them.

    Args:
        models: Models of its type.
        loads: Its loads.
        known: Parameters of an earlier calibration, of which stiffness and mount are kept, and from which the
            electrodes are expected to differ as from a design; None for a foot as designed.

    Raises:
        CalibrationError: The loads are too few or too alike, or of no foot of this type.
    """
    if len(loads) < MIN_LOADS:
        raise CalibrationError(_too_few_text(loads))
    design, baseline_pf, readings_pf = (
        models.response.design,
        loads.median_baseline_pf,
        loads.drift_corrected_pf,
    )
    if known is None:
        known = FootParameters(
            stray_pf=np.zeros(9), unloaded_pf=baseline_pf, gap_um=np.full(9, design.gap_um)
        )
    sigma_pf = np.hypot(READING_NOISE_PF, MODEL_ERROR_REL * (readings_pf - baseline_pf))
    before = Electrodes.of_foot(design, known, PRIOR_SIGMA[:N_ELECTRODE_PARAMETERS], _NO_FLOOR)
    fit = fit_electrodes(models, LoadReadings(readings_pf, baseline_pf, sigma_pf), before)
    distance = float(np.median(fit.mahalanobis_distance))
    if distance > MAX_MEDIAN_MAHALANOBIS_DISTANCE:
        raise CalibrationError(
            f"half of the loads are {distance:.0f} standard deviations or more from any foot of this type, about 2 are "
            "usual; check that the foot is of this type and undamaged, and that it hung free where it read unloaded"
        )
    # Errors of what stays unknown of the electrodes alone.
    found, covariance = fit.electrodes.parameters, np.diag((1e-9 * PRIOR_SIGMA) ** 2)
    covariance[:N_ELECTRODE_PARAMETERS, :N_ELECTRODE_PARAMETERS] = fit.electrodes.own_covariance
    predicted = predict_uncertainty(FootTwin(models.response, baseline_pf), found, covariance)
    if predicted.median_direction_error_deg > _MAX_PREDICTED_DEG:
        raise CalibrationError(
            f"{len(loads)} different loads at rest leave half of all directions uncertain by "
            f"{predicted.median_direction_error_deg:.1f} deg or more, at most {_MAX_PREDICTED_DEG:g} make a "
            f"calibration: they are too alike; {_MORE_POSTURES}"
        )
    electrodes = fit.electrodes.of(known, baseline_pf, design)
    before_n, force_n = (
        models.estimate_in_foot_frame(readings_pf, baseline_pf, one.stray_pf, one.gain_rel).force_n
        for one in (known, electrodes)
    )
    fitted_n = contact_loads(fit.coordinates).force_n
    residual_rel = np.median(
        np.linalg.norm(force_n - fitted_n, axis=1) / np.linalg.norm(fitted_n, axis=1)
    ) / np.sqrt(3.0)
    unknown_rel = np.radians(predicted.median_direction_error_deg) / _MEDIAN_OVER_SIGMA
    parameters = replace(
        electrodes, error_rel=max(known.error_rel, float(np.hypot(residual_rel, unknown_rel)))
    )
    turned_deg = float(np.median(angles_between_deg(before_n, force_n)))
    return StandingCalibration(parameters, fit, predicted, turned_deg)


def _too_few_text(loads: StandingLoads) -> str:
    """Return why there are too few loads, and what would be right."""
    alike = f", and {loads.n_alike} like one of them" if loads.n_alike else ""
    found = f"{len(loads)} different loads at rest{alike}; at least {MIN_LOADS} make a calibration"
    if loads.loaded_s == 0.0:
        return f"{found}: it never carried a load; stand on it in several postures"
    if loads.standing_s < _MIN_STILL_SHARE * loads.loaded_s:
        return (
            f"{found}: it stood still for {loads.standing_s:.1f} of {loads.loaded_s:.1f} s under load; hold each "
            "posture for a second"
        )
    return f"{found}: {_MORE_POSTURES}"
