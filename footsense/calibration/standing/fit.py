"""Fit of a foot's electrodes to loads whose forces nobody measured: strays, gains and gaps, by standing and by walking.

A load has five unknowns, its contact coordinates q, and nine readings y. The four readings left over identify the
electrodes theta, with the forward model h of `twin`:

    sum over the loads of huber(|W (y - h(theta, q))|) + (theta - theta0)^T Lambda (theta - theta0)

is minimised over theta and all q at once by Levenberg-Marquardt; the loads are eliminated from each step, as each has
its own readings alone (Schur complement). The result is a maximum a posteriori estimate, and may be the prior of the
next loads.

Two things no reading shows: a common factor of all gains is that of the force, as is the foot's stiffness, and a turn
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
from footsense.calibration.twin import GAIN, GAP, STRAY, FootTwin
from footsense.foot.contact_coordinates import COORDINATES, contact_loads, within_bounds
from footsense.frames import ELEMENTS, Vector

#: Parameters that are fitted, the first of the vector: strays, gains and gaps.
N_ELECTRODE_PARAMETERS = GAP.stop
#: Noise of a mean reading [pF], and share of a change of capacitance that no model explains [1].
_READING_NOISE_PF, _MODEL_ERROR_REL = 0.3e-3, 0.005
#: Distance of the nine readings from the model above which a load counts less: 99.7th percentile of chi with four
#: degrees of freedom.
_HUBER_DISTANCE = 4.0
#: Weak prior of friction ratio and contact point [1], for loads that determine them poorly.
_COORDINATE_SIGMA: Vector = np.array([np.inf, 6.0, 6.0, 5.0, 5.0])
#: Of the first stage of loads that a walk made: feet press nearly upright, and do not slide.
WALKING_COORDINATE_SIGMA: Vector = np.array([np.inf, 0.4, 0.4, 0.15, 0.15])
#: Differences: of the normal force over itself, of friction ratio and contact point, of a parameter over its prior [1].
_COORDINATE_STEPS: Vector = np.array([0.01, 0.01, 0.01, 0.005, 0.005])
_PARAMETER_STEP_REL = 0.01
#: Longest change in a step: of the normal force over itself, of friction ratio and contact point [1].
_MAX_STEP_REL, _MAX_STEP = 0.4, 0.2
_MAX_ITERATIONS, _MAX_DAMPING, _TOLERANCE_REL = 30, 1e6, 1e-4


class LoadReadings(NamedTuple):
    """Readings of n loads.

    Attributes:
        capacitance_pf: Nine readings of each, corrected for drift [pF], shape (n, 9).
        whitening: Matrix that makes the errors of each, what no model explains included, independent and of unit
            variance [1/pF], shape (n, 9, 9).
    """

    capacitance_pf: Vector
    whitening: Vector

    @classmethod
    def with_errors(cls, capacitance_pf: Vector, sigma_pf: Vector, common_sigma_pf: float = 0.0) -> Self:
        """Return readings with independent errors and one that all nine of a load have in common.

        Args:
            capacitance_pf: The readings [pF], shape (n, 9).
            sigma_pf: Standard deviation of the independent errors [pF], same shape.
            common_sigma_pf: Standard deviation of the common one [pF].
        """
        covariance = sigma_pf[:, :, None] ** 2 * np.eye(ELEMENTS) + common_sigma_pf**2
        return cls(capacitance_pf, np.linalg.inv(np.linalg.cholesky(covariance)))


class ElectrodePrior(NamedTuple):
    """What is known of a foot's electrodes before a fit.

    Attributes:
        parameters: Parameters to expect, as in `twin`, shape (parameters,).
        information: Inverse covariance of those of the electrodes, the first 27, and of the floor if there is one,
            shape (m, m), m 27 or 36.
        floor_pf: Expected capacitance that the floor adds to each element of a foot in contact [pF], shape (9,); None
            where it adds none.
    """

    parameters: Vector
    information: Vector
    floor_pf: Vector | None = None

    @classmethod
    def of_tolerances(cls, parameters: Vector) -> Self:
        """Return the prior of a foot that differs from some parameters as a made one from its design."""
        return cls(parameters, np.diag(PRIOR_SIGMA[:N_ELECTRODE_PARAMETERS] ** -2.0))


class ElectrodeFit(NamedTuple):
    """Electrodes of a foot from loads without a reference.

    Attributes:
        parameters: Parameters as in `twin`, shape (parameters,).
        floor_pf: What the floor adds to each element [pF], shape (9,); zero where the prior has none.
        information: Information of the loads on the electrodes' parameters, the first 27, and the floor, without that
            of the prior, shape (m, m).
        covariance: Their posterior covariance, shape (m, m).
        coordinates: Contact coordinates of each load, in the foot's frame, shape (n, 5).
        mahalanobis_distance: Distance of each load's readings from the model [1], shape (n,); 2 if its errors hold.
        cost: What was minimised [1].
    """

    parameters: Vector
    floor_pf: Vector
    information: Vector
    covariance: Vector
    coordinates: Vector
    mahalanobis_distance: Vector
    cost: float

    def predicted_uncertainty(self, twin: FootTwin) -> PredictedUncertainty:
        """Return the force errors to expect of what stays unknown of the electrodes, mount and stiffness apart."""
        covariance = np.diag((1e-9 * PRIOR_SIGMA) ** 2)
        own = slice(N_ELECTRODE_PARAMETERS)
        covariance[own, own] = self.covariance[own, own]
        return predict_uncertainty(twin, ParameterFit(self.parameters, covariance, self.mahalanobis_distance))


def mean_reading_sigma_pf(change_pf: Vector) -> Vector:
    """Return the standard deviation of mean readings of loads at rest [pF], same shape as their change by the load."""
    sigma_pf: Vector = np.hypot(_READING_NOISE_PF, _MODEL_ERROR_REL * change_pf)
    return sigma_pf


def fit_electrodes(
    twin: FootTwin,
    readings: LoadReadings,
    coordinates: Vector,
    prior: ElectrodePrior,
    *,
    start: Vector | None = None,
    coordinate_sigma: Vector = _COORDINATE_SIGMA,
    max_rounds: int = _MAX_ITERATIONS,
) -> ElectrodeFit:
    """Fit the electrodes of a foot to loads.

    Args:
        twin: Model of the foot, at its unloaded readings.
        readings: Readings of the loads.
        coordinates: Contact coordinates of the loads to start from, foot's frame, shape (n, 5).
        prior: What is known of the electrodes.
        start: Parameters to start from; None for those of the prior.
        coordinate_sigma: Prior standard deviation of the coordinates, shape (5,).
        max_rounds: Largest number of steps.
    """
    start = prior.parameters if start is None else start
    floor_pf = np.zeros(ELEMENTS) if prior.floor_pf is None else prior.floor_pf
    state = _State(twin, readings, prior, coordinate_sigma, start, floor_pf, within_bounds(coordinates))
    damping = 1e-3
    for _ in range(max_rounds):
        equations = _Equations(state, state.slopes())
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
    information = _Equations(state, state.slopes(own_gaps=True)).reduced_information(0.0)
    covariance = np.asarray(np.linalg.inv(information), np.float64)
    return ElectrodeFit(
        state.parameters,
        state.floor_pf,
        information - prior.information,
        covariance,
        state.coordinates,
        state.distance,
        state.cost,
    )


class _State:
    """Parameters and coordinates with the residuals that they leave."""

    def __init__(
        self,
        twin: FootTwin,
        readings: LoadReadings,
        prior: ElectrodePrior,
        coordinate_sigma: Vector,
        parameters: Vector,
        floor_pf: Vector,
        coordinates: Vector,
    ) -> None:
        self._twin, self._readings, self.prior, self.coordinate_sigma = (
            twin,
            readings,
            prior,
            coordinate_sigma,
        )
        self.parameters, self.floor_pf, self.coordinates = parameters, floor_pf, coordinates
        self._cells_um = twin.cell_closures_um(parameters, contact_loads(coordinates))
        self._model_pf = twin.reading_pf(parameters, self._cells_um)
        off_pf = readings.capacitance_pf - self._model_pf - floor_pf
        self.residual: Vector = np.einsum("nij,nj->ni", readings.whitening, off_pf)
        self.distance: Vector = np.sqrt((self.residual**2).sum(axis=1))
        self.weight = np.minimum(1.0, _HUBER_DISTANCE / np.maximum(self.distance, _HUBER_DISTANCE))
        deviation = (parameters - prior.parameters)[:N_ELECTRODE_PARAMETERS]
        if prior.floor_pf is not None:
            deviation = np.concatenate([deviation, floor_pf - prior.floor_pf])
        self.pull: Vector = prior.information @ deviation
        within = np.minimum(self.distance, _HUBER_DISTANCE)
        losses = (within * (2.0 * self.distance - within)).sum()
        priors = deviation @ self.pull + ((coordinates / coordinate_sigma) ** 2).sum()
        self.cost = float(losses + priors)

    def moved(self, change: Vector, coordinate_change: Vector) -> Self:
        """Return the state after a step of the fitted parameters and of the coordinates, both limited."""
        parameters, floor_pf = self.parameters.copy(), self.floor_pf
        parameters[:N_ELECTRODE_PARAMETERS] += change[:N_ELECTRODE_PARAMETERS]
        if self.prior.floor_pf is not None:
            floor_pf = np.maximum(floor_pf + change[N_ELECTRODE_PARAMETERS:], 0.0)
        parameters = np.clip(parameters, *self._twin.parameter_bounds())
        most_n = _MAX_STEP_REL * self.coordinates[:, :1]
        limited = np.clip(coordinate_change, -_MAX_STEP, _MAX_STEP)
        limited[:, :1] = np.clip(coordinate_change[:, :1], -most_n, most_n)
        coordinates = within_bounds(self.coordinates + limited)
        return type(self)(
            self._twin, self._readings, self.prior, self.coordinate_sigma, parameters, floor_pf, coordinates
        )

    def slopes(self, *, own_gaps: bool = False) -> tuple[Vector, Vector]:
        """Return the slopes of whitened readings by parameters and floor, (n, 9, m), and coordinates, (n, 9, 5).

        Args:
            own_gaps: Whether the slope of a gap is its own on all elements, as of what the loads tell of it; else that
                of all gaps together on its own element: one that closes in the foot and not yet in the model would have
                none, and never close.
        """
        n, diagonal = len(self.coordinates), np.arange(ELEMENTS)
        gaps = [slice(GAP.start + one, GAP.start + one + 1) for one in range(ELEMENTS)] if own_gaps else [GAP]
        steps = _COORDINATE_STEPS * np.ones_like(self.coordinates)
        steps[:, 0] *= self.coordinates[:, 0]
        # Smaller coordinates stay within the table.
        less = [contact_loads(self.coordinates - steps * one) for one in np.eye(COORDINATES)]
        here = contact_loads(self.coordinates)
        nearby_um = self._twin.cell_closures_for_closed_cells_um(
            [*((self._with_step(gap), here) for gap in gaps), *((self.parameters, one) for one in less)],
            self._twin.closed_cells(self.parameters, self._cells_um),
        )
        by_parameter = np.zeros((n, ELEMENTS, len(self.prior.information)))
        if self.prior.floor_pf is not None:
            by_parameter[:, diagonal, N_ELECTRODE_PARAMETERS + diagonal] = 1.0
        for kind in (STRAY, GAIN):
            by_parameter[:, diagonal, kind.start + diagonal] = self._slope_pf(kind, self._cells_um)
        for gap, cells_um in zip(gaps, nearby_um, strict=False):
            if own_gaps:
                by_parameter[:, :, gap.start] = self._slope_pf(gap, cells_um)
            else:
                by_parameter[:, diagonal, GAP.start + diagonal] = self._slope_pf(gap, cells_um)
        moved_pf = [self._twin.reading_pf(self.parameters, cells_um) for cells_um in nearby_um[len(gaps) :]]
        by_coordinate = (self._model_pf[..., None] - np.stack(moved_pf, axis=2)) / steps[:, None]
        return self._readings.whitening @ by_parameter, self._readings.whitening @ by_coordinate

    def _slope_pf(self, kind: slice, cells_um: Vector) -> Vector:
        """Return the slope of the readings by parameters of a kind [pF per unit], shape (n, 9)."""
        change_pf = self._twin.reading_pf(self._with_step(kind), cells_um) - self._model_pf
        slope_pf: Vector = change_pf / (_PARAMETER_STEP_REL * PRIOR_SIGMA[kind][0])
        return slope_pf

    def _with_step(self, kind: slice) -> Vector:
        moved = self.parameters.copy()
        moved[kind] += _PARAMETER_STEP_REL * PRIOR_SIGMA[kind]
        return moved


class _Equations:
    """Normal equations of a state at its slopes; the loads' part is block diagonal."""

    def __init__(self, state: _State, slopes: tuple[Vector, Vector]) -> None:
        by_parameter, by_coordinate = slopes
        of_prior = state.coordinate_sigma**-2.0
        weighted = state.weight[:, None, None] * by_coordinate
        self._own = weighted.transpose(0, 2, 1) @ by_coordinate + np.diag(of_prior)
        self._mixed = weighted.transpose(0, 2, 1) @ by_parameter
        self._own_gradient = np.einsum("nrc,nr->nc", weighted, state.residual) - state.coordinates * of_prior
        weighted = state.weight[:, None, None] * by_parameter
        self._shared = np.einsum("nrp,nrq->pq", weighted, by_parameter) + state.prior.information
        self._gradient = np.einsum("nrp,nr->p", weighted, state.residual) - state.pull

    def reduced_information(self, damping: float) -> Vector:
        """Return the information of the parameters alone, after that of the loads is taken away, shape (m, m)."""
        taken = np.einsum("ncp,ncq->pq", self._mixed, np.linalg.solve(self._damped(damping), self._mixed))
        information: Vector = self._shared + damping * np.diag(np.diag(self._shared)) - taken
        return information

    def step(self, damping: float) -> tuple[Vector, Vector]:
        """Return the changes of parameters and floor, (m,), and of coordinates, (n, 5)."""
        own = self._damped(damping)
        alone = np.linalg.solve(own, self._own_gradient[..., None])[..., 0]
        gradient = self._gradient - np.einsum("ncp,nc->p", self._mixed, alone)
        change = np.linalg.solve(self.reduced_information(damping), gradient)
        return change, alone - np.linalg.solve(own, (self._mixed @ change)[..., None])[..., 0]

    def _damped(self, damping: float) -> Vector:
        diagonal = np.einsum("ncc->nc", self._own)
        damped: Vector = self._own + damping * diagonal[:, :, None] * np.eye(COORDINATES)
        return damped
