"""Recursive fit of a foot's electrodes to the instants of its stances.

What is known of the electrodes is a Gaussian: parameters and their covariance. Between the instants it widens, as
electrodes wander; with every few instants, whose loads nobody knows, it is the prior of a fit (`standing.fit`), whose
result it then is. The information of the instants counts for less than they say: their errors, of the model above
all, are not independent.
"""

from typing import NamedTuple, Self

import numpy as np

from footsense.calibration.evaluation import DesignModels
from footsense.calibration.parameter_fit import PRIOR_SIGMA
from footsense.calibration.selfcal.instants import Instants
from footsense.calibration.standing.fit import (
    N_ELECTRODE_PARAMETERS,
    WALKING_COORDINATE_SIGMA,
    ElectrodeFit,
    ElectrodePrior,
    LoadReadings,
    fit_electrodes,
)
from footsense.calibration.twin import GAIN, GAP, N_PARAMETERS, STRAY, FootTwin
from footsense.foot.capacitor import Capacitor
from footsense.foot.contact_coordinates import contact_coordinates
from footsense.foot.parameters import FootParameters
from footsense.frames import ELEMENTS, Vector

#: Standard deviation of the electrodes of a calibrated foot when nobody knows how old it is: stray [pF], gain [1], gap
#: [um]. Of gains, that of a measured insole between sessions, 4 %, and a little more.
_CALIBRATED_SIGMA: Vector = np.repeat((0.02, 0.05, 0.3), ELEMENTS)
#: Wander of strays [pF], gains [1] and gaps [um] in a minute; it grows with the root of the time.
_WANDER_PER_ROOT_MINUTE: Vector = np.repeat((0.002, 0.003, 0.02), ELEMENTS)
#: Share of a reading's change that no model explains, and share of the largest closure by which any element may be off,
#: as elements that creep differently are [1].
_MODEL_ERROR_REL, _CLOSURE_ERROR_REL = 0.005, 0.01
#: Standard deviation of what a floor, wet or of metal, adds to all elements of a foot in contact, and beside it to each
#: [pF]; wander of the former in a minute, as the ground is another.
_FLOOR_SIGMA_PF, _UNEVEN_FLOOR_SIGMA_PF, _FLOOR_WANDER_PF = 0.05, 0.01, 0.02
#: Instants of the first fit of a foot that was never calibrated, and of each later fit.
FIRST_INSTANTS, INSTANTS_PER_FIT = 18, 6
#: Steps of a later fit, of the first stage of a first one, and of one that judges.
_ROUNDS, _FIRST_STAGE_ROUNDS, _JUDGING_ROUNDS = 3, 15, 8
#: Share of the information that counts [1], and usual distance of an instant's readings from the model [1]: median of
#: chi with four degrees of freedom.
_INFORMATION_SHARE, _USUAL_DISTANCE = 0.5, 1.83
#: Variance of electrodes that are given, over that of manufacture [1].
_CERTAIN = 1e-8


class Electrodes(NamedTuple):
    """What is known of a foot's electrodes.

    Attributes:
        parameters: Parameters as in `twin`, shape (parameters,).
        floor_pf: What the floor adds to each element of the foot in contact [pF], shape (9,).
        covariance: Covariance of those of the electrodes, the first 27, and of the floor, shape (36, 36).
    """

    parameters: Vector
    floor_pf: Vector
    covariance: Vector

    @classmethod
    def before_walking(cls, design: Capacitor, known: FootParameters, *, calibrated: bool) -> Self:
        """Return what is known of a foot that has not walked.

        Args:
            design: The capacitors as designed.
            known: Its calibration, or the design.
            calibrated: Whether it is a calibration.
        """
        parameters = np.zeros(N_PARAMETERS)
        parameters[STRAY], parameters[GAIN] = known.stray_pf, known.gain_rel - 1.0
        parameters[GAP] = known.gap_um - design.gap_um
        sigma = _CALIBRATED_SIGMA if calibrated else PRIOR_SIGMA[:N_ELECTRODE_PARAMETERS]
        return cls(parameters, np.zeros(ELEMENTS), _with_floor(np.diag(sigma**2)))

    def wandered(self, minutes: float) -> Self:
        """Return what is known of them some time later."""
        covariance = self.covariance.copy()
        covariance[:N_ELECTRODE_PARAMETERS, :N_ELECTRODE_PARAMETERS] += minutes * np.diag(
            _WANDER_PER_ROOT_MINUTE**2
        )
        covariance[N_ELECTRODE_PARAMETERS:, N_ELECTRODE_PARAMETERS:] += minutes * _FLOOR_WANDER_PF**2
        return self._replace(covariance=covariance)

    def prior(self) -> ElectrodePrior:
        """Return this as the prior of a fit."""
        information = np.asarray(np.linalg.inv(self.covariance), np.float64)
        return ElectrodePrior(self.parameters, information, self.floor_pf)

    @property
    def own_covariance(self) -> Vector:
        """Covariance of the electrodes' parameters alone, shape (27, 27)."""
        return self.covariance[:N_ELECTRODE_PARAMETERS, :N_ELECTRODE_PARAMETERS]


def _with_floor(covariance: Vector) -> Vector:
    """Return the covariance of electrodes, shape (27, 27), with that of a floor that nobody knows, shape (36, 36)."""
    n = N_ELECTRODE_PARAMETERS + ELEMENTS
    whole = np.zeros((n, n))
    whole[:N_ELECTRODE_PARAMETERS, :N_ELECTRODE_PARAMETERS] = covariance
    whole[N_ELECTRODE_PARAMETERS:, N_ELECTRODE_PARAMETERS:] = (
        _FLOOR_SIGMA_PF** 2 + _UNEVEN_FLOOR_SIGMA_PF** 2 * np.eye(ELEMENTS)
    )
    return whole


def fit_instants(
    models: DesignModels, electrodes: Electrodes, instants: Instants, *, first: bool = False
) -> tuple[Electrodes, float]:
    """Return what is known after some instants, and the median distance of their readings over the usual one [1].

    Args:
        models: Models of the foot's type.
        electrodes: What is known before.
        instants: The instants, at least one.
        first: Whether little is known: then from two starts, with loads as of a walk in a first stage, since narrow
            loads explain their readings in several ways.
    """
    readings, unloaded_pf = readings_of(models, electrodes.parameters, instants)
    twin, prior = FootTwin(models.response, unloaded_pf), electrodes.prior()
    coordinates = load_coordinates(
        models, electrodes.parameters, readings.capacitance_pf - electrodes.floor_pf, unloaded_pf
    )
    if first:
        upright = coordinates.copy()
        upright[:, 1:] = 0.0
        stages = [
            fit_electrodes(
                twin, readings, start, prior,
                coordinate_sigma=WALKING_COORDINATE_SIGMA, max_rounds=_FIRST_STAGE_ROUNDS,
            )
            for start in (coordinates, upright)
        ]  # fmt: skip
        best = min(stages, key=lambda fit: fit.cost)
        fit = fit_electrodes(twin, readings, best.coordinates, prior, start=best.parameters)
    else:
        fit = fit_electrodes(twin, readings, coordinates, prior, max_rounds=_ROUNDS)
    misfit = _misfit(fit)
    share = _INFORMATION_SHARE / max(1.0, misfit) ** 2
    covariance = np.linalg.inv(prior.information + share * fit.information)
    return Electrodes(fit.parameters, fit.floor_pf, np.asarray(covariance, np.float64)), misfit


def _misfit(fit: ElectrodeFit) -> float:
    return float(np.median(fit.mahalanobis_distance)) / _USUAL_DISTANCE


def fit_again(models: DesignModels, before: Electrodes, instants: Instants, start: Vector) -> ElectrodeFit:
    """Return the fit of electrodes to instants alone, from near parameters on.

    Args:
        models: Models of the foot's type.
        before: What was known before walking.
        instants: The instants.
        start: Parameters to start from.
    """
    readings, unloaded_pf = readings_of(models, start, instants)
    coordinates = load_coordinates(models, start, readings.capacitance_pf, unloaded_pf)
    twin = FootTwin(models.response, unloaded_pf)
    return fit_electrodes(
        twin, readings, coordinates, before.prior(), start=start, max_rounds=_JUDGING_ROUNDS
    )


def misfit_of(models: DesignModels, parameters: Vector, instants: Instants) -> float:
    """Return the median distance of instants from the model with given parameters, over the usual one [1]."""
    covariance = _with_floor(_CERTAIN * np.diag(PRIOR_SIGMA[:N_ELECTRODE_PARAMETERS] ** 2))
    certain = Electrodes(parameters, np.zeros(ELEMENTS), covariance)
    return _misfit(fit_again(models, certain, instants, parameters))


def readings_of(models: DesignModels, parameters: Vector, instants: Instants) -> tuple[LoadReadings, Vector]:
    """Return the readings of instants, corrected for drift, with their errors, and the unloaded readings [pF]."""
    design, stray_pf = models.response.design, parameters[STRAY]
    unloaded_pf = np.median(instants.baseline_pf, axis=0)
    capacitance_pf = instants.capacitance_pf - instants.baseline_pf + unloaded_pf
    closure_um = design.closure_um(capacitance_pf - stray_pf, unloaded_pf - stray_pf)
    pf_per_um = (capacitance_pf - stray_pf) ** 2 / design.plate_distance_um(np.ones(1))
    off_pf = _CLOSURE_ERROR_REL * np.abs(closure_um).max(axis=1, keepdims=True) * pf_per_um
    model_pf = _MODEL_ERROR_REL * (capacitance_pf - unloaded_pf)
    sigma_pf = np.sqrt(instants.sigma_pf**2 + model_pf**2 + off_pf**2)
    return LoadReadings.with_errors(capacitance_pf, sigma_pf), unloaded_pf


def load_coordinates(
    models: DesignModels, parameters: Vector, capacitance_pf: Vector, unloaded_pf: Vector
) -> Vector:
    """Return the contact coordinates of loads, shape (n, 5), as the network says with a foot's electrodes."""
    load = models.estimate_in_foot_frame(
        capacitance_pf, unloaded_pf, parameters[STRAY], 1.0 + parameters[GAIN]
    )
    return contact_coordinates(load.force_n, load.contact_point_and_friction)
