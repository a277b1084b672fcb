"""Kalman filter for force and contact of several feet, updated by every conversion, restarted by the network.

The state holds the contact coordinates of `contact_model.py`, their rates and the acceleration of the normal force.
Several models of the motion, from slow to sudden, run side by side and are mixed by their likelihood (interacting
multiple models). A conversion is one scalar measurement at its own time; it is linearised twice, its variance holds the
second-order term of the measurement, and covariances are updated in Joseph's form.

Source:
    Bar-Shalom, Li and Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001, sections 10.3
    (iteration, second-order term) and 11.6 (interacting multiple models).
"""

from typing import NamedTuple

import numpy as np
from scipy.linalg import expm

from footsense.frames import Mask, Vector
from footsense.lab.evaluation.contact_model import (
    COORDINATES,
    POINT,
    RATIO,
    ContactMeasurementModel,
    clip_to_coordinate_bounds,
    contact_coordinates_of,
    force_and_slopes,
)
from footsense.ports import LoadEstimate

#: Places of the rates, and of the acceleration of the normal force; size of the state.
_RATE, _ACCELERATION, _STATES = slice(COORDINATES, 2 * COORDINATES), 2 * COORDINATES, 2 * COORDINATES + 1
#: Sigma in the air and at touchdown: coordinates, rates, acceleration.
_PRIOR_SIGMA = np.array([0.01, 0.22, 0.22, 0.085, 0.085, 1.0, 3.0, 3.0, 0.5, 0.5, 10.0])
#: One for the normal force and its derivatives, zero for the contact.
_NORMAL_FORCE_STATE_MASK = np.array([1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0])
#: Linearisations of a measurement, and longest change of friction ratio and contact point by one [1].
_ITERATIONS, _LONGEST = 2, np.array([0.25, 0.25, 0.12, 0.12])
#: Contact point over which the closures turn by as much as they are [1].
_CONTACT_POINT_CURVATURE_SCALE = 0.25
#: Probability of a model to stay, and least probability of one.
_STAY_PROBABILITY, _MIN_WEIGHT = 0.97, 1e-4
#: Bounds of the normal force [N], and normal force below which the contact is forgotten [N].
_FORCE_N, _AIR_N = (-0.05, 3.0), 0.01
#: Innovations beyond this square weigh no more in the likelihood [1].
_MAX_NORMALIZED_SQUARED_INNOVATION = 60.0
#: The network re-seeds after so many conversions of force apart by so many of its sigma and newtons.
_PATIENCE, _SIGMAS, _APART_N, _SEEDING_N = 4, 5.0, 0.01, 0.05

#: Memory of the rates of friction ratio and contact point [s].
_RATIO_S, _POINT_S = 0.03, 0.1


class MotionModel(NamedTuple):
    """Motion model of the Kalman filter: spectral densities of its process noise, and correlation time.

    Attributes:
        normal_force_noise_density: Of the normal force's third derivative [N2/s5].
        force_acceleration_correlation_s: Memory of the normal force's acceleration [s].
        friction_ratio_noise_density: Of the friction ratio's second derivative [1/s3].
        contact_point_noise_density: Of the contact point's second derivative [1/s3].
    """

    normal_force_noise_density: float
    force_acceleration_correlation_s: float
    friction_ratio_noise_density: float
    contact_point_noise_density: float

    def transition(self, step_s: float) -> tuple[Vector, Vector]:
        """Return state transition and process noise covariance of a time step, (11, 11) each (Van Loan)."""
        rate, noise = np.zeros((2, _STATES, _STATES))
        rate[range(COORDINATES), range(COORDINATES, 2 * COORDINATES)] = 1.0
        rate[COORDINATES, _ACCELERATION] = 1.0
        memory_s = np.array(
            [np.inf, _RATIO_S, _RATIO_S, _POINT_S, _POINT_S, self.force_acceleration_correlation_s]
        )
        moving = np.arange(COORDINATES, _STATES)
        rate[moving, moving] = -1.0 / memory_s
        noise[moving, moving] = [
            0.0,
            self.friction_ratio_noise_density,
            self.friction_ratio_noise_density,
            self.contact_point_noise_density,
            self.contact_point_noise_density,
            self.normal_force_noise_density,
        ]
        both = expm(np.block([[-rate, noise], [np.zeros_like(rate), rate.T]]) * step_s)
        step = both[_STATES:, _STATES:].T
        return step, step @ both[:_STATES, _STATES:]


#: The models: slow, usual, sudden.
IMM_MOTION_MODELS = (
    MotionModel(3e4, 0.03, 10.0, 0.075),
    MotionModel(1e6, 0.03, 300.0, 2.0),
    MotionModel(3e9, 0.02, 3e3, 22.0),
)


class ContactFilter:
    """Interacting-multiple-model Kalman filters for n feet whose elements are converted at the same times.

    Args:
        model: Model of the readings.
        n: Number of feet.
        step_s: Time from a conversion to the next [s].
        send_delay_s: Time from a conversion to the asked time [s].
    """

    def __init__(self, model: ContactMeasurementModel, n: int, step_s: float, send_delay_s: float) -> None:
        self._model = model
        self._n = n
        self._step, self._lead = (
            [one.transition(time_s) for one in IMM_MOTION_MODELS] for time_s in (step_s, send_delay_s)
        )
        self._state = np.zeros((len(IMM_MOTION_MODELS), n, _STATES))
        self._covariance = np.tile(np.diag(_PRIOR_SIGMA**2), (len(IMM_MOTION_MODELS), n, 1, 1))
        self._weight = np.full((len(IMM_MOTION_MODELS), n), 1.0 / len(IMM_MOTION_MODELS))
        self._switch = np.full(
            (len(IMM_MOTION_MODELS),) * 2, (1.0 - _STAY_PROBABILITY) / (len(IMM_MOTION_MODELS) - 1)
        )
        np.fill_diagonal(self._switch, _STAY_PROBABILITY)
        self._apart = np.zeros(n, int)

    def update(self, element: int, closure_rel: Vector) -> None:
        """Update the filters by one element's conversion on all feet: closures over the gap [1], shape (n,)."""
        self._mix_models()
        self._predict()
        likelihood = self._correct(element, np.tile(closure_rel, len(IMM_MOTION_MODELS)))
        weight = self._weight * np.exp(likelihood - likelihood.max(axis=0))
        weight = np.maximum(weight / weight.sum(axis=0), _MIN_WEIGHT)
        self._weight = weight / weight.sum(axis=0)
        air = (self._weight * self._state[..., 0]).sum(axis=0) < _AIR_N
        self._state[:, air] *= _NORMAL_FORCE_STATE_MASK
        self._covariance[:, air] *= np.outer(_NORMAL_FORCE_STATE_MASK, _NORMAL_FORCE_STATE_MASK)
        self._covariance[:, air] += np.diag((1.0 - _NORMAL_FORCE_STATE_MASK) * _PRIOR_SIGMA**2)

    def _mix_models(self) -> None:
        """Mix the states of the motion models by their switching probabilities (IMM mixing)."""
        after = self._switch.T @ self._weight
        share = self._switch[:, :, None] * self._weight[:, None] / after
        mixed = np.einsum("ijn,ina->jna", share, self._state)
        off = self._state[:, None] - mixed
        self._covariance = np.einsum("ijn,inab->jnab", share, self._covariance) + np.einsum(
            "ijn,ijna,ijnb->jnab", share, off, off
        )
        self._state, self._weight = mixed, after

    def _predict(self) -> None:
        """Predict the state of every motion model to the time of the next conversion."""
        for k, (step, noise) in enumerate(self._step):
            self._state[k] = self._state[k] @ step.T
            self._covariance[k] = step @ self._covariance[k] @ step.T + noise

    def _correct(self, element: int, closure_rel: Vector) -> Vector:
        """Update all motion models by one reading per foot; return the log-likelihood, shape (models, n)."""
        state, covariance = self._state.reshape(-1, _STATES), self._covariance.reshape(-1, _STATES, _STATES)
        contact = np.arange(1, COORDINATES)
        contact_variance = covariance[:, contact, contact]
        noise = self._model.closure_sigma_rel(closure_rel) ** 2
        noise[~self._model.is_in_converter_range(closure_rel)] = 1e6
        found, unknown = state, np.zeros(len(state))
        slope = np.zeros_like(state)
        for _ in range(_ITERATIONS):
            about = clip_to_coordinate_bounds(found[:, :COORDINATES])
            closure, slopes = (part[:, element] for part in self._model.closure_and_slopes(about))
            slope[:, :COORDINATES] = slopes
            innovation = closure_rel - closure - (slopes * (state[:, :COORDINATES] - about)).sum(axis=1)
            carried = (covariance @ slope[..., None])[..., 0]
            explained = (slope * carried).sum(axis=1)
            # Second order: products of load and contact, as far as this reading leaves them open, and the ball's curve.
            product = ((slopes[:, 1:] / about[:, :1]) ** 2 * contact_variance).sum(axis=1) * covariance[
                :, 0, 0
            ]
            bend = 0.5 * (
                (slopes[:, 3:] / _CONTACT_POINT_CURVATURE_SCALE) ** 2 * contact_variance[:, 2:] ** 2
            ).sum(axis=1)
            error = noise + unknown * product + bend
            unknown = np.minimum(1.0, error / np.maximum(explained, 1e-30))
            gain = carried / (explained + error)[:, None]
            last, found = found[:, contact], state + gain * innovation[:, None]
            found[:, contact] = np.clip(found[:, contact], last - _LONGEST, last + _LONGEST)
        found[:, contact] = clip_to_coordinate_bounds(found[:, :COORDINATES])[:, contact]
        found[:, 0] = np.clip(found[:, 0], *_FORCE_N)
        left = np.eye(_STATES) - gain[:, :, None] * slope[:, None]
        added = (gain * error[:, None])[:, :, None] * gain[:, None]
        self._state = found.reshape(self._state.shape)
        self._covariance = (left @ covariance @ left.transpose(0, 2, 1) + added).reshape(
            self._covariance.shape
        )
        variance = explained + error
        likelihood: Vector = -0.5 * np.minimum(
            innovation**2 / variance, _MAX_NORMALIZED_SQUARED_INNOVATION
        ) - 0.5 * np.log(variance)
        return likelihood.reshape(self._weight.shape)

    def force_and_sigma_n(self) -> tuple[Vector, Vector]:
        """Return force and its standard deviation at the time of sending [N], shapes (n, 3)."""
        forces, variances = np.empty((2, len(IMM_MOTION_MODELS), self._n, 3))
        for k, (step, noise) in enumerate(self._lead):
            coordinates = (self._state[k] @ step.T)[:, :COORDINATES]
            about = clip_to_coordinate_bounds(coordinates)
            whole_n, slopes = force_and_slopes(about)
            forces[k] = whole_n * (np.clip(coordinates[:, :1], 0.0, about[:, :1]) / about[:, :1])
            spread = (step @ self._covariance[k] @ step.T + noise)[:, :COORDINATES, :COORDINATES]
            variances[k] = ((slopes @ spread) * slopes).sum(axis=2)
        weight = self._weight[..., None]
        force_n: Vector = (weight * forces).sum(axis=0)
        return force_n, np.sqrt((weight * (variances + (forces - force_n) ** 2)).sum(axis=0))

    def restart_where_inconsistent(self, network: LoadEstimate, valid: Mask) -> None:
        """Reset the filters to the network's estimate where both have disagreed for several conversions.

        Args:
            network: The network's answer at the asked time.
            valid: Feet that have one, shape (n,).
        """
        apart_n = np.abs(self.force_and_sigma_n()[0] - network.force_n) - _SIGMAS * network.sigma_n
        far = valid & (apart_n > _APART_N).any(axis=1)
        far &= np.linalg.norm(network.force_n, axis=1) > _SEEDING_N
        self._apart = np.where(far, self._apart + 1, 0)
        seeded = self._apart >= _PATIENCE
        start = contact_coordinates_of(network.force_n[seeded], network.contact_point_and_friction[seeded])
        sigma = np.tile(_PRIOR_SIGMA, (len(start), 1))
        sigma[:, 0] = 2.0 * network.sigma_n[seeded].max(axis=1) + 0.01
        sigma[:, RATIO] = 2.0 * network.contact_sigma[seeded, 2:] + 0.01
        sigma[:, POINT] = 2.0 * network.contact_sigma[seeded, :2] + 0.01
        sigma[:, COORDINATES] = 5.0
        self._state[:, seeded] = np.pad(start, ((0, 0), (0, _STATES - COORDINATES)))
        self._covariance[:, seeded] = sigma[:, :, None] ** 2 * np.eye(_STATES)
        self._weight[:, seeded] = 1.0 / len(IMM_MOTION_MODELS)
        self._apart[seeded] = -2 * _PATIENCE
