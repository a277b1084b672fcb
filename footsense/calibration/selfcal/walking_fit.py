"""Recursive fit of a foot's electrodes to the instants of its stances.

What is known of the electrodes is a Gaussian: parameters and their covariance. Between the instants it widens, as
electrodes wander; with every few instants, whose loads nobody knows, it is the prior of a fit (`standing.fit`), whose
result it then is. The information of the instants counts for less than they say: their errors, of the model above
all, are not independent.
"""

from functools import partial

import numpy as np

from footsense.calibration.evaluation import DesignModels
from footsense.calibration.parameter_fit import MODEL_ERROR_REL, PRIOR_SIGMA
from footsense.calibration.selfcal.instants import Instants
from footsense.calibration.standing.fit import (
    N_ELECTRODE_PARAMETERS,
    ElectrodeFit,
    Electrodes,
    LoadReadings,
    fit_electrodes,
    network_coordinates,
)
from footsense.calibration.twin import STRAY
from footsense.foot.capacitor import Capacitor
from footsense.foot.parameters import FootParameters
from footsense.frames import ELEMENTS, Vector

#: Standard deviation of the electrodes of a calibrated foot when nobody knows how old it is: stray [pF], gain [1], gap
#: [um]. Of gains, that of a measured insole between sessions, 4 %, and a little more.
_CALIBRATED_SIGMA: Vector = np.repeat((0.02, 0.05, 0.3), ELEMENTS)
#: Wander of strays [pF], gains [1] and gaps [um] in a minute; it grows with the root of the time.
_WANDER_PER_ROOT_MINUTE: Vector = np.repeat((0.002, 0.003, 0.02), ELEMENTS)
#: Share of the largest closure by which any element may be off, as elements that creep differently are [1].
_CLOSURE_ERROR_REL = 0.01
#: Covariance of what a floor, wet or of metal, adds to the elements of a foot in contact [pF2]: 0.05 pF to all, and
#: beside it 0.01 pF to each.
_FLOOR_COVARIANCE: Vector = 0.05**2 + 0.01**2 * np.eye(ELEMENTS)
#: Wander of the former in a minute [pF], as the ground is another.
_FLOOR_WANDER_PF = 0.02
#: Prior of the contact coordinates in the first stage of a first fit: feet press nearly upright, and do not slide.
_FIRST_STAGE_SIGMA: Vector = np.array([np.inf, 0.4, 0.4, 0.15, 0.15])
#: Instants of a fit.
INSTANTS_PER_FIT = 18
#: Most steps of a later fit, of the first stage of a first one, and of one that judges.
_ROUNDS, _FIRST_STAGE_ROUNDS, _JUDGING_ROUNDS = 3, 8, 4
#: Gain of a step that no longer counts [1]: it is of a parameter by less than a third of its standard deviation.
_TOLERANCE = 0.1
#: Share of the information that counts [1], and usual distance of an instant's readings from the model [1]: median of
#: chi with four degrees of freedom.
_INFORMATION_SHARE, _USUAL_DISTANCE = 0.5, 1.83
#: Variance of electrodes that are given, over that of manufacture [1].
_CERTAIN = 1e-8


def electrodes_before_walking(design: Capacitor, known: FootParameters, *, calibrated: bool) -> Electrodes:
    """Return what is known of the electrodes of a foot that has not walked.

    Args:
        design: The capacitors as designed.
        known: Its calibration, or the design.
        calibrated: Whether it is a calibration.
    """
    sigma = _CALIBRATED_SIGMA if calibrated else PRIOR_SIGMA[:N_ELECTRODE_PARAMETERS]
    return Electrodes.of_foot(design, known, sigma, _FLOOR_COVARIANCE)


def wandered(electrodes: Electrodes, minutes: float) -> Electrodes:
    """Return what is known of electrodes some time later."""
    wander = minutes * np.diag(np.append(_WANDER_PER_ROOT_MINUTE, np.zeros(ELEMENTS)) ** 2)
    wander[N_ELECTRODE_PARAMETERS:, N_ELECTRODE_PARAMETERS:] = minutes * _FLOOR_WANDER_PF**2
    return electrodes._replace(covariance=electrodes.covariance + wander)


def fit_instants(
    models: DesignModels, before: Electrodes, instants: Instants, *, first: bool = False
) -> tuple[Electrodes, float]:
    """Return what is known after some instants, and the median distance of their readings over the usual one [1].

    Args:
        models: Models of the foot's type.
        before: What is known before.
        instants: The instants, at least one.
        first: Whether little is known: then in two stages, first from upright loads and near them, since narrow loads
            explain their readings in several ways.
    """
    readings = readings_of(models, before.parameters, instants)
    fit = partial(fit_electrodes, models, readings, before, tolerance=_TOLERANCE)
    if first:
        coordinates = network_coordinates(models, before, readings)
        coordinates[:, 1:] = 0.0
        rough = fit(
            coordinates=coordinates, coordinate_sigma=_FIRST_STAGE_SIGMA, max_rounds=_FIRST_STAGE_ROUNDS
        )
        found = fit(start=rough.electrodes.parameters, coordinates=rough.coordinates)
    else:
        found = fit(max_rounds=_ROUNDS)
    share = _INFORMATION_SHARE / max(1.0, misfit(found)) ** 2
    covariance = np.linalg.inv(np.linalg.inv(before.covariance) + share * found.information)
    return found.electrodes._replace(covariance=np.asarray(covariance, np.float64)), misfit(found)


def misfit(fit: ElectrodeFit) -> float:
    """Return the median distance of a fit's readings from the model, over the usual one [1]."""
    return float(np.median(fit.mahalanobis_distance)) / _USUAL_DISTANCE


def fit_again(models: DesignModels, before: Electrodes, instants: Instants, start: Vector) -> ElectrodeFit:
    """Return the fit of electrodes to instants alone, from near parameters on.

    Args:
        models: Models of the foot's type.
        before: What was known before walking.
        instants: The instants.
        start: Parameters to start from.
    """
    readings = readings_of(models, start, instants)
    return fit_electrodes(
        models, readings, before, start=start, max_rounds=_JUDGING_ROUNDS, tolerance=_TOLERANCE
    )


def misfit_of(models: DesignModels, parameters: Vector, instants: Instants) -> float:
    """Return the median distance of instants from the model with given parameters, over the usual one [1]."""
    sigma = np.sqrt(_CERTAIN) * PRIOR_SIGMA[:N_ELECTRODE_PARAMETERS]
    covariance = np.diag(np.append(sigma, np.zeros(ELEMENTS)) ** 2)
    covariance[N_ELECTRODE_PARAMETERS:, N_ELECTRODE_PARAMETERS:] = _FLOOR_COVARIANCE
    certain = Electrodes(parameters, np.zeros(ELEMENTS), covariance)
    return misfit(fit_again(models, certain, instants, parameters))


def readings_of(models: DesignModels, parameters: Vector, instants: Instants) -> LoadReadings:
    """Return the readings of instants, corrected for drift, with their errors."""
    design, stray_pf = models.response.design, parameters[STRAY]
    unloaded_pf = np.median(instants.baseline_pf, axis=0)
    capacitance_pf = instants.capacitance_pf - instants.baseline_pf + unloaded_pf
    closure_um = design.closure_um(capacitance_pf - stray_pf, unloaded_pf - stray_pf)
    pf_per_um = (capacitance_pf - stray_pf) ** 2 / design.plate_distance_um(np.ones(1))
    off_pf = _CLOSURE_ERROR_REL * np.abs(closure_um).max(axis=1, keepdims=True) * pf_per_um
    model_pf = MODEL_ERROR_REL * (capacitance_pf - unloaded_pf)
    return LoadReadings(capacitance_pf, unloaded_pf, np.sqrt(instants.sigma_pf**2 + model_pf**2 + off_pf**2))
