"""Least-squares fit of force and contact to the readings of a window, with the network's estimate as start and prior.

Over the window's 70 ms the normal force is a parabola of time, friction ratio and contact point are straight lines:
eleven unknowns x. A round of Gauss-Newton minimises

    sum ((y - h(x)) / sigma_y)^2 + ((x - x0) / sigma_0)^2 + ((f(x) - f0) / sigma_f)^2

with the readings y and the network's force f0 and contact x0. sigma_y holds the noise and, from the second differences
of the readings, what the parabola leaves out. Closures per newton are expanded about the network's answer, so h is
exact in products of load and contact.
"""

from typing import NamedTuple

import numpy as np

from footsense.frames import Mask, Vector
from footsense.lab.evaluation.contact_model import (
    COORDINATES,
    MIN_NORMAL_FORCE_N,
    POINT,
    RATIO,
    ContactMeasurementModel,
    clip_to_coordinate_bounds,
    contact_coordinates_of,
    force_and_slopes,
)
from footsense.lab.training.windowed_network import READINGS_PER_ELEMENT
from footsense.ports import LoadEstimate, Window

#: Places of the unknowns: coordinates, first rates of each, second rate of the normal force.
_RATE_SLICE = slice(COORDINATES, 2 * COORDINATES)
_N_UNKNOWNS = 2 * COORDINATES + 1
#: Prior of the rates: of the normal force over itself [1/s], [1/s2], of friction ratio and contact point [1/s].
_LOAD_RATE, _LOAD_RATE_2, _RATIO_RATE, _POINT_RATE = 15.0, 400.0, 2.5, 0.6
#: Least normal force of those priors [N].
_MIN_RATE_PRIOR_FORCE_N = 0.05
#: Sigma of the prior over that of the network: the network has seen the same readings.
_PRIOR_OVER_NETWORK_SIGMA = 1.5
#: Error of the parabola one scan ago over the second difference of the readings [1].
_CURVATURE_ERROR_FACTOR = 1.0
#: The fit's sigma is at least that of the network times this: steps after the last reading are in no window.
_MIN_FIT_OVER_NETWORK_SIGMA = 0.5
#: Longest change of friction ratio and contact point in a round, and within a window [1].
_LONGEST, _WITHIN = 0.2, 0.3


class _WeightedReadings(NamedTuple):
    """Readings of n windows, 27 each: closures over the gap [1], times from the estimated one (<= 0) [s], weights."""

    closure_rel: Vector
    time_s: Vector
    weight: Vector


def is_steady(model: ContactMeasurementModel, window: Window, sigmas: float = 20.0) -> Mask:
    """Return in which windows the readings of every element are constant within the noise, shape (n,)."""
    apart = np.ptp(window.closure_rel, axis=1) / model.closure_sigma_rel(window.closure_rel[:, 0])
    rest: Mask = (apart < sigmas).all(axis=1)
    return rest


def fit_force_and_sigma(
    model: ContactMeasurementModel, window: Window, network: LoadEstimate, rounds: int
) -> tuple[Vector, Vector]:
    """Return fitted forces and their sigma [N], shapes (n, 3), of windows without missing elements.

    Args:
        model: Model of the readings.
        window: The readings.
        network: The network's answer.
        rounds: Rounds of Gauss-Newton.
    """
    rows = _weighted_readings(model, window)
    start = contact_coordinates_of(network.force_n, network.contact_point_and_friction)
    unknown, prior_sigma = np.zeros((2, len(start), _N_UNKNOWNS))
    unknown[:, :COORDINATES] = start
    prior = unknown.copy()
    scale_n = np.maximum(start[:, :1], _MIN_RATE_PRIOR_FORCE_N)
    prior_sigma[:, :1] = 10.0
    prior_sigma[:, RATIO] = _PRIOR_OVER_NETWORK_SIGMA * network.contact_sigma[:, 2:] + 0.005
    prior_sigma[:, POINT] = _PRIOR_OVER_NETWORK_SIGMA * network.contact_sigma[:, :2] + 0.003
    prior_sigma[:, _RATE_SLICE] = np.array([0.0, _RATIO_RATE, _RATIO_RATE, _POINT_RATE, _POINT_RATE])
    prior_sigma[:, [COORDINATES, _N_UNKNOWNS - 1]] = scale_n * np.array([_LOAD_RATE, _LOAD_RATE_2])
    force_weight = 1.0 / (_PRIOR_OVER_NETWORK_SIGMA * network.sigma_n + 1e-3) ** 2
    for _ in range(rounds):
        expansion_point = clip_to_coordinate_bounds(unknown[:, :COORDINATES])
        residual, slopes = _residual(model, rows, expansion_point, unknown)
        force_n, force_slopes = force_and_slopes(expansion_point)
        weighted = slopes * rows.weight[..., None]
        weighted_force = force_slopes * force_weight[..., None]
        information = weighted.transpose(0, 2, 1) @ slopes
        information[:, :COORDINATES, :COORDINATES] += weighted_force.transpose(0, 2, 1) @ force_slopes
        information[:, range(_N_UNKNOWNS), range(_N_UNKNOWNS)] += prior_sigma**-2.0
        gradient = (weighted * residual[..., None]).sum(axis=1) + (prior - unknown) / prior_sigma**2
        gradient[:, :COORDINATES] += (weighted_force * (network.force_n - force_n)[..., None]).sum(axis=1)
        step = np.linalg.solve(information, gradient[..., None])[..., 0]
        step[:, 1:COORDINATES] = np.clip(step[:, 1:COORDINATES], -_LONGEST, _LONGEST)
        unknown = unknown + step
        unknown[:, :COORDINATES] = clip_to_coordinate_bounds(unknown[:, :COORDINATES])
    force_n, force_slopes = force_and_slopes(unknown[:, :COORDINATES])
    covariance = np.linalg.inv(information)[:, :COORDINATES, :COORDINATES]
    variance = ((force_slopes @ covariance) * force_slopes).sum(axis=2)
    return force_n, np.maximum(np.sqrt(variance), _MIN_FIT_OVER_NETWORK_SIGMA * network.sigma_n)


def _weighted_readings(model: ContactMeasurementModel, window: Window) -> _WeightedReadings:
    """Return the readings of windows with their least-squares weights."""
    n = len(window.missing)
    closure_rel, age_s = window.closure_rel.reshape(n, -1), window.age_s.reshape(n, -1)
    newest, before, oldest = window.closure_rel.transpose(1, 0, 2)
    curved = np.sqrt(((newest - 2.0 * before + oldest) ** 2).mean(axis=1, keepdims=True))
    scan_s = (window.age_s[:, 1] - window.age_s[:, 0]).mean(axis=1, keepdims=True)
    variance = (
        model.closure_sigma_rel(closure_rel) ** 2
        + (_CURVATURE_ERROR_FACTOR * curved * (age_s / scan_s) ** 2) ** 2
    )
    return _WeightedReadings(closure_rel, -age_s, model.is_in_converter_range(closure_rel) / variance)


def _residual(
    model: ContactMeasurementModel, rows: _WeightedReadings, expansion_point: Vector, unknown: Vector
) -> tuple[Vector, Vector]:
    """Return measured minus modelled closures, (n, 27), and their Jacobian, (n, 27, unknowns)."""
    closure_rel, slopes = model.closure_and_slopes(expansion_point)
    per_newton = closure_rel / expansion_point[:, :1]
    by_ln_load = slopes[..., 0] - per_newton
    by_contact = slopes[..., 1:] / expansion_point[:, :1, None]
    per_newton, by_ln_load, by_contact = (
        np.concatenate([part] * READINGS_PER_ELEMENT, axis=1) for part in (per_newton, by_ln_load, by_contact)
    )
    time_s = rows.time_s[..., None]
    then = unknown[:, None, :COORDINATES] + time_s * unknown[:, None, _RATE_SLICE]
    load_n = then[..., 0] + 0.5 * rows.time_s**2 * unknown[:, -1:]
    in_contact = load_n > MIN_NORMAL_FORCE_N
    load_n = np.where(in_contact, load_n, MIN_NORMAL_FORCE_N)
    ln_load = np.clip(np.log(load_n / expansion_point[:, :1]), -2.0, 1.0)
    moved = np.clip(then[..., 1:] - expansion_point[:, None, 1:], -_WITHIN, _WITHIN)
    per_newton = per_newton + by_ln_load * ln_load + (by_contact * moved).sum(axis=2)
    by_coordinate = np.concatenate(
        [(per_newton + by_ln_load)[..., None], load_n[..., None] * by_contact], axis=2
    )
    by_coordinate *= in_contact[..., None]
    curved = 0.5 * time_s**2 * by_coordinate[..., :1]
    explained = load_n * per_newton * in_contact
    return rows.closure_rel - explained, np.concatenate(
        [by_coordinate, time_s * by_coordinate, curved], axis=2
    )
