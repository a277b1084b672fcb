"""Fit of a foot's electrodes to loads at rest whose forces nobody measured: strays, gains and gaps by standing.

A load has five unknowns, its contact coordinates q, and nine readings y. The four readings left over tell of the
electrodes theta, with the forward model h of `twin`:

    sum over the loads of huber(|y - h(theta, q)| / sigma_y) + sum ((theta - theta0) / sigma_theta)^2

is minimised over theta and all q at once by Levenberg-Marquardt; the loads are eliminated from each step, as each has
its own readings alone (Schur complement). The result is a maximum a posteriori estimate.

Two things no reading tells: a common factor of all gains is that of the force, as is the foot's stiffness, and a turn
of the mount turns every force. Both stay as they were.
"""

from typing import NamedTuple, Self

import numpy as np

from footsense.calibration.parameter_fit import (
    PRIOR_SIGMA,
    ParameterFit,
    PredictedUncertainty,
    predict_uncertainty,
)
from footsense.calibration.twin import GAIN, GAP, N_PARAMETERS, STRAY, FootTwin
from footsense.foot.contact_coordinates import COORDINATES, contact_loads, within_bounds
from footsense.frames import ELEMENTS, Vector

#: Parameters that are fitted, the first of the vector: strays, gains and gaps.
_N_FITTED = GAP.stop
#: Noise of a mean reading [pF], and share of a change of capacitance that no model explains [1].
_READING_NOISE_PF, _MODEL_ERROR_REL = 0.3e-3, 0.005
#: Distance of the nine readings from the model above which a load counts less: 99.7th percentile of chi with four
#: degrees of freedom.
_HUBER_DISTANCE = 4.0
#: Weak prior of friction ratio and contact point [1], for loads that tell little of them.
_COORDINATE_SIGMA: Vector = np.array([np.inf, 6.0, 6.0, 5.0, 5.0])
#: Differences: of the normal force over itself, of friction ratio and contact point, of a parameter over its prior [1].
_COORDINATE_STEPS: Vector = np.array([0.01, 0.01, 0.01, 0.005, 0.005])
_PARAMETER_STEP_REL = 0.01
#: Longest change in a step: of the normal force over itself, of friction ratio and contact point [1].
_MAX_STEP_REL, _MAX_STEP = 0.4, 0.2
_MAX_ITERATIONS, _MAX_DAMPING, _TOLERANCE_REL = 30, 1e6, 1e-4


class StandingFit(NamedTuple):
    """Electrodes of a foot as loads at rest tell them.

    Attributes:
        parameters: Parameters as in `twin`, shape (parameters,).
        covariance: Posterior covariance of the electrodes' parameters, the first 27, shape (27, 27).
        coordinates: Contact coordinates of each load, in the foot's frame, shape (n, 5).
        mahalanobis_distance: Distance of each load's readings from the model [1], shape (n,); 2 if its errors hold.
    """

    parameters: Vector
    covariance: Vector
    coordinates: Vector
    mahalanobis_distance: Vector

    def predicted_uncertainty(self, twin: FootTwin) -> PredictedUncertainty:
        """Return the force errors to expect of what stays unknown of the electrodes, mount and stiffness apart."""
        covariance = np.diag((1e-9 * PRIOR_SIGMA) ** 2)
        covariance[:_N_FITTED, :_N_FITTED] = self.covariance
        return predict_uncertainty(twin, ParameterFit(self.parameters, covariance, self.mahalanobis_distance))


def fit_electrodes(
    twin: FootTwin,
    capacitance_pf: Vector,
    baseline_pf: Vector,
    coordinates: Vector,
    expected: Vector | None = None,
) -> StandingFit:
    """Fit the electrodes of a foot to loads at rest.

    Args:
        twin: Model of the foot, at its unloaded readings.
        capacitance_pf: Mean readings of each load, corrected for drift [pF], shape (n, 9).
        baseline_pf: Unloaded readings of the model [pF], shape (9,).
        coordinates: Contact coordinates of the loads to start from, foot's frame, shape (n, 5).
        expected: Parameters to expect, as in `twin`; None for a foot as designed.
    """
    expected = np.zeros(N_PARAMETERS) if expected is None else expected
    sigma_pf = np.hypot(_READING_NOISE_PF, _MODEL_ERROR_REL * (capacitance_pf - baseline_pf))
    state = _State(twin, capacitance_pf, sigma_pf, expected, expected, within_bounds(coordinates))
    damping = 1e-3
    for _ in range(_MAX_ITERATIONS):
        equations = _Equations(state)
        while damping < _MAX_DAMPING:
            tried = state.moved(*equations.step(damping))
            if tried.cost < state.cost:
                break
            damping *= 8.0
        if damping >= _MAX_DAMPING:
            break
        gain_rel = 1.0 - tried.cost / state.cost
        state, damping = tried, max(damping / 10.0, 1e-6)
        if gain_rel < _TOLERANCE_REL:
            break
    covariance = np.asarray(np.linalg.inv(_Equations(state).reduced_information(0.0)), np.float64)
    return StandingFit(state.parameters, covariance, state.coordinates, state.distance)


class _State:
    """Parameters and coordinates with the residuals that they leave."""

    def __init__(
        self,
        twin: FootTwin,
        measured_pf: Vector,
        sigma_pf: Vector,
        expected: Vector,
        parameters: Vector,
        coordinates: Vector,
    ) -> None:
        self._twin, self._measured_pf, self._sigma_pf, self._expected = twin, measured_pf, sigma_pf, expected
        self.parameters, self.coordinates = parameters, coordinates
        self._cells_um = twin.cell_closures_um(parameters, contact_loads(coordinates))
        self._model_pf = twin.reading_pf(parameters, self._cells_um)
        self.residual: Vector = (measured_pf - self._model_pf) / sigma_pf
        self.distance: Vector = np.sqrt((self.residual**2).sum(axis=1))
        self.weight = np.minimum(1.0, _HUBER_DISTANCE / np.maximum(self.distance, _HUBER_DISTANCE))
        self.deviation: Vector = (parameters - expected)[:_N_FITTED] / PRIOR_SIGMA[:_N_FITTED]
        within = np.minimum(self.distance, _HUBER_DISTANCE)
        losses = (within * (2.0 * self.distance - within)).sum()
        priors = (self.deviation**2).sum() + ((coordinates / _COORDINATE_SIGMA) ** 2).sum()
        self.cost = float(losses + priors)

    def moved(self, change: Vector, coordinate_change: Vector) -> Self:
        """Return the state after a step of the fitted parameters and of the coordinates, both limited."""
        parameters = self.parameters.copy()
        parameters[:_N_FITTED] += change
        parameters = np.clip(parameters, *self._twin.parameter_bounds())
        most_n = _MAX_STEP_REL * self.coordinates[:, :1]
        limited = np.clip(coordinate_change, -_MAX_STEP, _MAX_STEP)
        limited[:, :1] = np.clip(coordinate_change[:, :1], -most_n, most_n)
        coordinates = within_bounds(self.coordinates + limited)
        return type(self)(
            self._twin, self._measured_pf, self._sigma_pf, self._expected, parameters, coordinates
        )

    def slopes(self) -> tuple[Vector, Vector]:
        """Return the slopes of readings over their sigma by parameters, (n, 9, 27), and coordinates, (n, 9, 5)."""
        n, diagonal = len(self.coordinates), np.arange(ELEMENTS)
        wider = self._with_step(GAP)
        steps = _COORDINATE_STEPS * np.ones_like(self.coordinates)
        steps[:, 0] *= self.coordinates[:, 0]
        # Smaller coordinates stay within the table.
        less = [contact_loads(self.coordinates - steps * one) for one in np.eye(COORDINATES)]
        gap_um, *coordinates_um = self._twin.cell_closures_for_closed_cells_um(
            [(wider, contact_loads(self.coordinates)), *((self.parameters, one) for one in less)],
            self._twin.closed_cells(self.parameters, self._cells_um),
        )
        by_parameter = np.zeros((n, ELEMENTS, _N_FITTED))
        # The slope of a gap is that of all gaps together: one that closes in the foot and not yet in the model would
        # have none of its own.
        for kind, cells_um in ((STRAY, self._cells_um), (GAIN, self._cells_um), (GAP, gap_um)):
            change_pf = self._twin.reading_pf(self._with_step(kind), cells_um) - self._model_pf
            slope_pf = change_pf / (_PARAMETER_STEP_REL * PRIOR_SIGMA[kind])
            by_parameter[:, diagonal, kind.start + diagonal] = slope_pf
        moved_pf = [self._twin.reading_pf(self.parameters, cells_um) for cells_um in coordinates_um]
        by_coordinate = (self._model_pf[..., None] - np.stack(moved_pf, axis=2)) / steps[:, None]
        return by_parameter / self._sigma_pf[..., None], by_coordinate / self._sigma_pf[..., None]

    def _with_step(self, kind: slice) -> Vector:
        moved = self.parameters.copy()
        moved[kind] += _PARAMETER_STEP_REL * PRIOR_SIGMA[kind]
        return moved


class _Equations:
    """Normal equations of a state; the loads' part is block diagonal."""

    def __init__(self, state: _State) -> None:
        by_parameter, by_coordinate = state.slopes()
        weighted = state.weight[:, None, None] * by_coordinate
        self._own = weighted.transpose(0, 2, 1) @ by_coordinate + np.diag(_COORDINATE_SIGMA**-2.0)
        self._mixed = weighted.transpose(0, 2, 1) @ by_parameter
        self._own_gradient = (
            np.einsum("nrc,nr->nc", weighted, state.residual) - state.coordinates * _COORDINATE_SIGMA**-2.0
        )
        weighted = state.weight[:, None, None] * by_parameter
        self._shared = np.einsum("nrp,nrq->pq", weighted, by_parameter) + np.diag(
            PRIOR_SIGMA[:_N_FITTED] ** -2.0
        )
        self._gradient = np.einsum("nrp,nr->p", weighted, state.residual)
        self._gradient -= state.deviation / PRIOR_SIGMA[:_N_FITTED]

    def reduced_information(self, damping: float) -> Vector:
        """Return the information of the parameters alone, after that of the loads is taken away, shape (27, 27)."""
        taken = np.einsum("ncp,ncq->pq", self._mixed, np.linalg.solve(self._damped(damping), self._mixed))
        information: Vector = self._shared + damping * np.diag(np.diag(self._shared)) - taken
        return information

    def step(self, damping: float) -> tuple[Vector, Vector]:
        """Return the changes of parameters, (27,), and of coordinates, (n, 5)."""
        own = self._damped(damping)
        alone = np.linalg.solve(own, self._own_gradient[..., None])[..., 0]
        gradient = self._gradient - np.einsum("ncp,nc->p", self._mixed, alone)
        change = np.linalg.solve(self.reduced_information(damping), gradient)
        return change, alone - np.linalg.solve(own, (self._mixed @ change)[..., None])[..., 0]

    def _damped(self, damping: float) -> Vector:
        diagonal = np.einsum("ncc->nc", self._own)
        damped: Vector = self._own + damping * diagonal[:, :, None] * np.eye(COORDINATES)
        return damped
