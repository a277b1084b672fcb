"""Maximum a posteriori fit of a foot's parameters to calibration loads (Levenberg-Marquardt).

The readings of one load share errors: of the reference, of the stick's lean, of the rubber's creep. Each is a
known direction in the space of readings, so the covariance of one load's readings is

    S = diag(sigma^2) + L L^T lean^2 + F (diag(sigma_f^2) + rubber^2 f f^T) F^T

with L and F the model's slopes by the contact's normal and by the force. Loads that do not fit, such as an unnoticed
slip, count less: Huber loss of the Mahalanobis distance of all readings together, minimised by Levenberg-Marquardt
with reweighting.

Source:
    Huber, Annals of Mathematical Statistics 35, 1964, for the loss; docs/adr/0016-parameter-fit-in-numpy.md,
    for why this is not scipy.
"""

from functools import partial
from typing import NamedTuple

import numpy as np

from footsense.calibration.loads import LoadSet
from footsense.calibration.twin import (
    GAP,
    N_PARAMETERS,
    PARAMETER_COUNTS,
    REFERENCE,
    FootTwin,
    shifted,
)
from footsense.foot.directions import angles_between_deg, direction_grid, normalized
from footsense.foot.force_errors import GRAM_FORCE_N
from footsense.foot.gap_contact import element_means
from footsense.foot.specimen import ContactLoads
from footsense.frames import ELEMENTS, Vector

#: Prior standard deviation of each parameter, shape (36,): stray of wiring [pF], electrodes by shadow mask [1], spun
#: spacers [um], rubber of uncertain cure [1], a foot mounted by hand [rad], a sheet laid by hand, half a millimetre of
#: 10 [1], and a reference with the paper's linearity, 1.5 % of a range that is hardly used [1].
PRIOR_SIGMA: Vector = np.repeat((0.5, 0.02, 3.0, 0.4, np.radians(5.0), 0.05, 0.02), PARAMETER_COUNTS)

#: Errors of a test stand: lean of the stick [deg], share of a force that creep makes uncertain [1].
_STICK_LEAN_DEG, _CREEP_UNCERTAINTY_REL = 1.5, 0.015
#: Share of a change of capacitance that no model explains [1], noise of a mean reading [pF].
MODEL_ERROR_REL, READING_NOISE_PF = 0.005, 0.3e-3
#: Smallest standard deviation of a mean reference force: its resolution [N].
_MIN_SIGMA_N = 0.003

#: Steps of the finite differences, by parameter, by normal [rad] and by force [1].
_DIFFERENCE_STEPS: Vector = np.repeat((0.01, 1e-3, 0.02, 0.005, 2e-3, 2e-3, 1e-3), PARAMETER_COUNTS)
_NORMAL_STEP, _FORCE_STEP_REL = 2e-3, 1e-3
#: Mahalanobis distance of the nine readings above which a load counts less: 99th percentile of chi with nine degrees of
#: freedom.
_HUBER_DISTANCE = 4.65
_MAX_ITERATIONS, _MAX_DAMPING = 25, 1e8
#: Gain of the cost below which a fit ends, and one that is only the start of another.
_TOLERANCE_REL, _ROUGH_TOLERANCE_REL = 1e-5, 1e-3
#: Iteration before which the covariance is evaluated again, at parameters that are nearly right.
_REWHITEN_AT_ITERATION = 3
#: Light loads needed for a first fit, and how many of them are used.
_MIN_LIGHT_LOADS, _MAX_LIGHT_LOADS = 15, 40


class ParameterFit(NamedTuple):
    """Result of a parameter fit: parameters, posterior covariance, and Mahalanobis distance of each load.

    Attributes:
        parameters: Parameters as in `twin`, shape (parameters,).
        covariance: Their posterior covariance, shape (parameters, parameters).
        mahalanobis_distance: Mahalanobis distance of each load [1], shape (n,); about 3 if the error model holds.
    """

    parameters: Vector
    covariance: Vector
    mahalanobis_distance: Vector

    @property
    def contraction(self) -> Vector:
        """1 minus posterior over prior standard deviation, per parameter: 0 unidentified, 1 known exactly."""
        contraction: Vector = 1.0 - np.sqrt(np.diag(self.covariance)) / PRIOR_SIGMA
        return contraction


def fit_parameters(twin: FootTwin, loads: LoadSet) -> ParameterFit:
    """Fit a foot's parameters to calibration loads; return them with their posterior covariance.

    If there are enough, light loads from all sides come first: they close no gap, and the problem is nearly linear.

    Args:
        twin: Model of the foot, at its unloaded readings.
        loads: At least one.
    """
    start = np.zeros(N_PARAMETERS)
    magnitude_n = np.linalg.norm(loads.force_n, axis=1)
    light = loads.subset(magnitude_n <= np.median(magnitude_n))
    if len(light) >= _MIN_LIGHT_LOADS:
        light = light.subset(light.space_filling_order()[:_MAX_LIGHT_LOADS])
        start = _levenberg_marquardt(twin, light, start, shared_gap=True).parameters
    # A gap that closes in the foot and not yet in the model has no slope and would never close. So on the way each gap
    # has the slope of all gaps together; at the end it has its own, and a gap that never closes stays as designed.
    start = _levenberg_marquardt(twin, loads, start, shared_gap=True).parameters
    return _levenberg_marquardt(twin, loads, start, shared_gap=False)


def _levenberg_marquardt(twin: FootTwin, loads: LoadSet, start: Vector, *, shared_gap: bool) -> ParameterFit:
    """Return the fit at the optimum found from `start`; `shared_gap` as of `_FitState.residual_jacobian`."""
    evaluated = partial(_FitState, twin, loads)
    whitening = _whitening_matrices(twin, start, loads)
    state = evaluated(whitening, start)
    damping, tolerance_rel = 1e-3, _ROUGH_TOLERANCE_REL if shared_gap else _TOLERANCE_REL
    for iteration in range(_MAX_ITERATIONS):
        if iteration == _REWHITEN_AT_ITERATION:
            whitening = _whitening_matrices(twin, state.parameters, loads)
            state = evaluated(whitening, state.parameters)
        residual_jacobian = state.residual_jacobian(shared_gap=shared_gap)
        curvature, gradient = residual_jacobian.T @ residual_jacobian, residual_jacobian.T @ state.residual
        while damping < _MAX_DAMPING:
            step = np.linalg.solve(curvature + damping * np.diag(np.diag(curvature)), -gradient)
            if -(2.0 * gradient + curvature @ step) @ step < tolerance_rel * state.cost:
                damping = _MAX_DAMPING  # a step as short as this gains nothing
                break
            tried = evaluated(whitening, np.clip(state.parameters + step, *twin.parameter_bounds()))
            if tried.cost < state.cost:
                break
            damping *= 10.0
        if damping >= _MAX_DAMPING:
            break
        gain_rel = 1.0 - tried.cost / state.cost
        state, damping = tried, max(damping / 10.0, 1e-9)
        if gain_rel < tolerance_rel and iteration > _REWHITEN_AT_ITERATION:
            break
    residual_jacobian = state.residual_jacobian(shared_gap=shared_gap)
    covariance = np.asarray(np.linalg.inv(residual_jacobian.T @ residual_jacobian), np.float64)
    return ParameterFit(state.parameters, covariance, state.mahalanobis_distance)


class _FitState:
    """Model readings and whitened residual at given parameter values.

    Args:
        twin: Model of the foot.
        loads: The loads.
        whitening: Matrices that whiten one load's misfit [1/pF], shape (n, elements, elements).
        parameters: The parameters.

    Attributes:
        mahalanobis_distance: Mahalanobis distance of each load [1], shape (n,).
        residual: Whitened misfit, weighted down beyond Huber's distance, and parameters over their prior [1].
        cost: Sum of Huber's losses of the distances and of the squared parameters over their prior [1].
    """

    def __init__(self, twin: FootTwin, loads: LoadSet, whitening: Vector, parameters: Vector) -> None:
        self._twin, self._loads, self._whitening_matrices = twin, loads, whitening
        self._contact = ContactLoads.centred(loads.force_n)
        self.parameters = parameters
        self._cells_um = twin.cell_closures_um(parameters, self._contact)
        self._model_pf = twin.reading_pf(parameters, self._cells_um)
        white = np.einsum("nij,nj->ni", whitening, self._model_pf - loads.drift_corrected_pf)
        self.mahalanobis_distance = np.linalg.norm(white, axis=1)
        within = np.minimum(self.mahalanobis_distance, _HUBER_DISTANCE)
        self._weight = np.sqrt(_HUBER_DISTANCE / np.maximum(self.mahalanobis_distance, _HUBER_DISTANCE))
        prior = parameters / PRIOR_SIGMA
        self.residual = np.concatenate([(self._weight[:, None] * white).ravel(), prior])
        self.cost = float((within * (2.0 * self.mahalanobis_distance - within)).sum() + (prior**2).sum())

    def residual_jacobian(self, *, shared_gap: bool) -> Vector:
        """Return the Jacobian of the residual, shape (elements n + parameters, parameters).

        Args:
            shared_gap: Whether the slope of each gap is that of all gaps together, as of `electrode_slopes_pf`.
        """
        moved = [slice(number, number + 1) for number in range(GAP.stop, N_PARAMETERS)]
        moved += [GAP] if shared_gap else [slice(number, number + 1) for number in range(GAP.start, GAP.stop)]
        closed = self._twin.closed_cells(self.parameters, self._cells_um)
        nearby_um = self._twin.cell_closures_for_closed_cells_um(
            [(shifted(self.parameters, one, _DIFFERENCE_STEPS), self._contact) for one in moved], closed
        )
        n_whole = N_PARAMETERS - GAP.stop
        of_elements = self._twin.electrode_slopes_pf(
            self.parameters, self._cells_um, nearby_um[n_whole:], _DIFFERENCE_STEPS
        )
        change_pf = self._twin.reading_pf(self.parameters, nearby_um[:n_whole]) - self._model_pf
        of_whole = change_pf.transpose(1, 2, 0) / _DIFFERENCE_STEPS[GAP.stop :]
        slopes_pf = np.concatenate([of_elements, of_whole], axis=2)
        white = self._weight[:, None, None] * (self._whitening_matrices @ slopes_pf)
        return np.concatenate([white.reshape(-1, N_PARAMETERS), np.diag(1.0 / PRIOR_SIGMA)])


def _whitening_matrices(twin: FootTwin, parameters: Vector, loads: LoadSet) -> Vector:
    """Return the inverse Cholesky factor of the covariance S of each load, shape (n, elements, elements)."""
    contact = ContactLoads.centred(loads.force_n)
    cells_um = twin.cell_closures_um(parameters, contact)
    model_pf = twin.reading_pf(parameters, cells_um)
    step_n = _FORCE_STEP_REL * np.linalg.norm(contact.force_n, axis=1, keepdims=True)
    # Of the contact's normal moved along an axis, and normalised, only the part across the normal remains.
    leaning = [
        ContactLoads(normalized(contact.normal + _NORMAL_STEP * axis), contact.force_n) for axis in np.eye(3)
    ]
    pushed = [ContactLoads(contact.normal, contact.force_n + step_n * axis) for axis in np.eye(3)]
    nearby = [(parameters, one) for one in (*leaning, *pushed)]
    nearby_um = twin.cell_closures_for_closed_cells_um(nearby, twin.closed_cells(parameters, cells_um))
    changes_pf = (twin.reading_pf(parameters, nearby_um) - model_pf).transpose(1, 2, 0)
    slope_pf = changes_pf[..., 3:] / step_n[..., None]
    lean = changes_pf[..., :3] / _NORMAL_STEP * np.radians(_STICK_LEAN_DEG) * np.sqrt(0.5)
    force = slope_pf * np.maximum(loads.sigma_n, _MIN_SIGMA_N)[:, None, :]
    creep = np.einsum("nij,nj->ni", slope_pf, contact.force_n)[:, :, None] * _CREEP_UNCERTAINTY_REL
    reading = READING_NOISE_PF**2 + (MODEL_ERROR_REL * (model_pf - loads.median_baseline_pf)) ** 2
    covariance = sum(part @ part.transpose(0, 2, 1) for part in (lean, force, creep))
    covariance = covariance + reading[:, :, None] * np.eye(ELEMENTS)
    whitening: Vector = np.linalg.inv(np.linalg.cholesky(covariance))
    return whitening


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


def predict_uncertainty(twin: FootTwin, parameters: Vector, covariance: Vector) -> PredictedUncertainty:
    """Return the expected force errors, by linear propagation of draws from the posterior.

    A foot whose parameters differ from the fitted ones changes the readings of a load; the least-squares change of
    force that explains them is the error. Loads that close a gap are left out.

    Args:
        twin: Model of the foot.
        parameters: Its fitted parameters.
        covariance: Their posterior covariance.
    """
    # From all sides down to 50 deg of elevation, of 50 and 120 gf.
    directions = np.vstack([direction_grid(30.0 * np.arange(12), [50.0, 70.0]), [0.0, 0.0, 1.0]])
    force_n = np.concatenate([size * GRAM_FORCE_N * directions for size in (50.0, 120.0)])
    fitted = parameters.copy()
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

    root = np.linalg.cholesky(covariance)
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
