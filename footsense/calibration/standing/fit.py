"""Fit of a foot's electrodes to loads whose forces nobody measured: strays, gains and gaps, by standing and by walking.

A load has five unknowns, its contact coordinates q, and nine readings y. The four readings left over identify the
electrodes theta, with the forward model h of `twin`:

    sum over the loads of huber(|(y - h(theta, q)) / sigma|) + (theta - theta0)^T Lambda (theta - theta0)

is minimised over theta and all q at once by Levenberg-Marquardt; the loads are eliminated from each step, as each has
its own readings alone (Schur complement). The result is a maximum a posteriori estimate, and may be the prior of the
next loads.

Two things no reading shows: a common factor of all gains is that of the force, as is the foot's stiffness, and a turn
of the mount turns every force. Both stay as they were.
"""

from dataclasses import replace
from typing import NamedTuple, Self

import numpy as np

from footsense.calibration.evaluation import DesignModels
from footsense.calibration.parameter_fit import PRIOR_SIGMA
from footsense.calibration.twin import GAIN, GAP, N_PARAMETERS, STRAY, FootTwin, shifted
from footsense.foot.capacitor import Capacitor
from footsense.foot.contact_coordinates import COORDINATES, contact_coordinates, contact_loads, within_bounds
from footsense.foot.parameters import FootParameters
from footsense.frames import ELEMENTS, Vector

#: Parameters that are fitted, the first of the vector: strays, gains and gaps.
N_ELECTRODE_PARAMETERS = GAP.stop
#: Distance of the nine readings from the model above which a load counts less: 99.7th percentile of chi with four
#: degrees of freedom.
_HUBER_DISTANCE = 4.0
#: Weak prior of friction ratio and contact point [1], for loads that determine them poorly.
_COORDINATE_SIGMA: Vector = np.array([np.inf, 6.0, 6.0, 5.0, 5.0])
#: Differences: of the normal force over itself, of friction ratio and contact point, of a parameter over its prior [1].
_COORDINATE_STEPS: Vector = np.array([0.01, 0.01, 0.01, 0.005, 0.005])
_PARAMETER_STEPS: Vector = 0.01 * PRIOR_SIGMA
#: Longest change in a step: of the normal force over itself, of friction ratio and contact point [1].
_MAX_STEP_REL, _MAX_STEP = 0.4, 0.2
_MAX_ITERATIONS, _MAX_DAMPING, _TOLERANCE_REL = 30, 1e6, 1e-4


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
    def of_foot(
        cls, design: Capacitor, foot: FootParameters, sigma: Vector, floor_covariance: Vector
    ) -> Self:
        """Return what is known of a foot before its loads.

        Args:
            design: The capacitors as designed.
            foot: Parameters to expect.
            sigma: Standard deviation of strays, gains and gaps, shape (27,).
            floor_covariance: Covariance of what the floor adds to each element [pF2], shape (9, 9).
        """
        parameters, covariance = np.zeros(N_PARAMETERS), np.diag(np.append(sigma**2, np.zeros(ELEMENTS)))
        parameters[STRAY], parameters[GAIN] = foot.stray_pf, foot.gain_rel - 1.0
        parameters[GAP] = foot.gap_um - design.gap_um
        covariance[N_ELECTRODE_PARAMETERS:, N_ELECTRODE_PARAMETERS:] = floor_covariance
        return cls(parameters, np.zeros(ELEMENTS), covariance)

    def of(self, foot: FootParameters, unloaded_pf: Vector, design: Capacitor) -> FootParameters:
        """Return the parameters of a foot with these electrodes and unloaded readings [pF], shape (9,)."""
        return replace(
            foot,
            stray_pf=self.parameters[STRAY],
            unloaded_pf=unloaded_pf,
            gain_rel=1.0 + self.parameters[GAIN],
            gap_um=design.gap_um + self.parameters[GAP],
        )

    @property
    def own_covariance(self) -> Vector:
        """Covariance of the electrodes' parameters alone, shape (27, 27)."""
        return self.covariance[:N_ELECTRODE_PARAMETERS, :N_ELECTRODE_PARAMETERS]


class LoadReadings(NamedTuple):
    """Readings of n loads.

    Attributes:
        capacitance_pf: Nine readings of each, corrected for drift [pF], shape (n, 9).
        unloaded_pf: Unloaded readings [pF], shape (9,).
        sigma_pf: Standard deviation of the readings' errors, what no model explains included [pF], shape (n, 9).
    """

    capacitance_pf: Vector
    unloaded_pf: Vector
    sigma_pf: Vector


class ElectrodeFit(NamedTuple):
    """Electrodes of a foot from loads without a reference.

    Attributes:
        electrodes: What is known of them now.
        information: Information of the loads on the electrodes' parameters and the floor, without that of before,
            shape (36, 36).
        coordinates: Contact coordinates of each load, in the foot's frame, shape (n, 5).
        mahalanobis_distance: Distance of each load's readings from the model [1], shape (n,); 2 if its errors hold.
    """

    electrodes: Electrodes
    information: Vector
    coordinates: Vector
    mahalanobis_distance: Vector


def fit_electrodes(
    models: DesignModels,
    readings: LoadReadings,
    before: Electrodes,
    *,
    start: Vector | None = None,
    coordinates: Vector | None = None,
    coordinate_sigma: Vector = _COORDINATE_SIGMA,
    max_rounds: int = _MAX_ITERATIONS,
    tolerance: float = 0.0,
) -> ElectrodeFit:
    """Fit the electrodes of a foot to loads.

    Args:
        models: Models of the foot's type.
        readings: Readings of the loads.
        before: What is known of the electrodes.
        start: Parameters to start from; None for those of before.
        coordinates: Contact coordinates of the loads to start from, foot's frame, shape (n, 5); None for those that the
            network says with the parameters at the start.
        coordinate_sigma: Prior standard deviation of the coordinates, shape (5,).
        max_rounds: Largest number of steps.
        tolerance: Gain of a step below which the fit ends [1].
    """
    start = before.parameters if start is None else start
    if coordinates is None:
        coordinates = network_coordinates(models, before._replace(parameters=start), readings)
    twin = FootTwin(models.response, readings.unloaded_pf)
    known = np.asarray(np.linalg.inv(before.covariance), np.float64)
    problem = _Problem(twin, readings, before, known, coordinate_sigma)
    state = _State(problem, start, before.floor_pf, within_bounds(coordinates))
    damping = 1e-3
    for _ in range(max_rounds):
        equations = _Equations(state)
        while damping < _MAX_DAMPING:
            tried = state.moved(*equations.step(damping))
            if tried.cost < state.cost:
                break
            damping *= 8.0
        if damping >= _MAX_DAMPING:
            break
        gain, enough = state.cost - tried.cost, max(_TOLERANCE_REL * state.cost, tolerance)
        state, damping = tried, max(damping / 10.0, 1e-6)
        if gain < enough:
            break
    information = _Equations(state, own_gaps=True).reduced_information(0.0)
    return ElectrodeFit(
        Electrodes(state.parameters, state.floor_pf, np.asarray(np.linalg.inv(information), np.float64)),
        information - known,
        state.coordinates,
        state.distance,
    )


def network_coordinates(models: DesignModels, electrodes: Electrodes, readings: LoadReadings) -> Vector:
    """Return the contact coordinates of loads, shape (n, 5), as the network says with a foot's electrodes."""
    stray_pf, gain_rel = electrodes.parameters[STRAY], 1.0 + electrodes.parameters[GAIN]
    load = models.estimate_in_foot_frame(
        readings.capacitance_pf - electrodes.floor_pf, readings.unloaded_pf, stray_pf, gain_rel
    )
    return contact_coordinates(load.force_n, load.contact_point_and_friction)


class _Problem(NamedTuple):
    """What a fit is given; `information` is that of `before`."""

    twin: FootTwin
    readings: LoadReadings
    before: Electrodes
    information: Vector
    coordinate_sigma: Vector


class _State:
    """Parameters and coordinates with the residuals that they leave."""

    def __init__(self, problem: _Problem, parameters: Vector, floor_pf: Vector, coordinates: Vector) -> None:
        self.problem = problem
        self.parameters, self.floor_pf, self.coordinates = parameters, floor_pf, coordinates
        twin, readings, before, information, coordinate_sigma = problem
        self._cells_um = twin.cell_closures_um(parameters, contact_loads(coordinates))
        self._model_pf = twin.reading_pf(parameters, self._cells_um)
        self.residual = (readings.capacitance_pf - self._model_pf - floor_pf) / readings.sigma_pf
        self.distance = np.linalg.norm(self.residual, axis=1)
        self.weight = np.minimum(1.0, _HUBER_DISTANCE / np.maximum(self.distance, _HUBER_DISTANCE))
        changed = (parameters - before.parameters)[:N_ELECTRODE_PARAMETERS]
        deviation = np.append(changed, floor_pf - before.floor_pf)
        self.pull: Vector = information @ deviation
        within = np.minimum(self.distance, _HUBER_DISTANCE)
        losses = (within * (2.0 * self.distance - within)).sum()
        priors = deviation @ self.pull + ((coordinates / coordinate_sigma) ** 2).sum()
        self.cost = float(losses + priors)

    def moved(self, change: Vector, coordinate_change: Vector) -> Self:
        """Return the state after a step of parameters and floor, (36,), and of the coordinates, both limited."""
        parameters = self.parameters.copy()
        parameters[:N_ELECTRODE_PARAMETERS] += change[:N_ELECTRODE_PARAMETERS]
        floor_pf = np.maximum(self.floor_pf + change[N_ELECTRODE_PARAMETERS:], 0.0)
        parameters = np.clip(parameters, *self.problem.twin.parameter_bounds())
        most_n = _MAX_STEP_REL * self.coordinates[:, :1]
        limited = np.clip(coordinate_change, -_MAX_STEP, _MAX_STEP)
        limited[:, :1] = np.clip(coordinate_change[:, :1], -most_n, most_n)
        return type(self)(self.problem, parameters, floor_pf, within_bounds(self.coordinates + limited))

    def slopes(self, *, own_gaps: bool) -> tuple[Vector, Vector]:
        """Return the slopes of whitened readings by parameters and floor, (n, 9, 36), and coordinates, (n, 9, 5).

        Args:
            own_gaps: Whether the slope of a gap is its own on all elements, as of what the loads tell of it; else that
                of all gaps together on its own element: one that closes in the foot and not yet in the model would have
                none, and never close.
        """
        twin = self.problem.twin
        gaps = [slice(one, one + 1) for one in range(GAP.start, GAP.stop)] if own_gaps else [GAP]
        steps = _COORDINATE_STEPS * np.ones_like(self.coordinates)
        steps[:, 0] *= self.coordinates[:, 0]
        # Smaller coordinates stay within the table.
        less = [contact_loads(self.coordinates - steps * one) for one in np.eye(COORDINATES)]
        here = contact_loads(self.coordinates)
        nearby_um = twin.cell_closures_for_closed_cells_um(
            [
                *((shifted(self.parameters, gap, _PARAMETER_STEPS), here) for gap in gaps),
                *((self.parameters, one) for one in less),
            ],
            twin.closed_cells(self.parameters, self._cells_um),
        )
        by_parameter = twin.electrode_slopes_pf(
            self.parameters, self._cells_um, nearby_um[: len(gaps)], _PARAMETER_STEPS
        )
        by_floor = np.tile(np.eye(ELEMENTS), (len(less[0].normal), 1, 1))
        less_pf = twin.reading_pf(self.parameters, nearby_um[len(gaps) :])
        by_coordinate = (self._model_pf - less_pf).transpose(1, 2, 0) / steps[:, None]
        sigma_pf = self.problem.readings.sigma_pf[:, :, None]
        return np.concatenate([by_parameter, by_floor], axis=2) / sigma_pf, by_coordinate / sigma_pf


class _Equations:
    """Normal equations of a state at its slopes; the loads' part is block diagonal."""

    def __init__(self, state: _State, *, own_gaps: bool = False) -> None:
        by_parameter, by_coordinate = state.slopes(own_gaps=own_gaps)
        of_prior = state.problem.coordinate_sigma**-2.0
        weighted = (state.weight[:, None, None] * by_coordinate).transpose(0, 2, 1)
        self._own = weighted @ by_coordinate + np.diag(of_prior)
        self._mixed = weighted @ by_parameter
        self._own_gradient = (weighted @ state.residual[..., None])[..., 0] - state.coordinates * of_prior
        flat = by_parameter.reshape(-1, by_parameter.shape[2])
        weights = np.repeat(state.weight, ELEMENTS)
        self._shared = (weights * flat.T) @ flat + state.problem.information
        self._gradient = flat.T @ (weights * state.residual.ravel()) - state.pull

    def reduced_information(self, damping: float) -> Vector:
        """Return the information of the parameters alone, after that of the loads is taken away, shape (36, 36)."""
        m = len(self._gradient)
        taken = self._mixed.reshape(-1, m).T @ np.linalg.solve(self._damped(damping), self._mixed).reshape(
            -1, m
        )
        information: Vector = self._shared + damping * np.diag(np.diag(self._shared)) - taken
        return information

    def step(self, damping: float) -> tuple[Vector, Vector]:
        """Return the changes of parameters and floor, (36,), and of coordinates, (n, 5)."""
        own = self._damped(damping)
        alone = np.linalg.solve(own, self._own_gradient[..., None])[..., 0]
        gradient = self._gradient - np.einsum("ncp,nc->p", self._mixed, alone)
        change = np.linalg.solve(self.reduced_information(damping), gradient)
        return change, alone - np.linalg.solve(own, (self._mixed @ change)[..., None])[..., 0]

    def _damped(self, damping: float) -> Vector:
        diagonal = np.einsum("ncc->nc", self._own)
        damped: Vector = self._own + damping * diagonal[:, :, None] * np.eye(COORDINATES)
        return damped
