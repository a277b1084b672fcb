"""What makes a foot differ from its design, found from loads: the most probable, the bench's own errors as noise.

A load's nine readings share errors: the reference's, the lean of the stick, the creep of the rubber. Each is a known
direction in the space of readings, so the covariance of a load is

    S = diag(sigma^2) + L L^T lean^2 + F (diag(sigma_f^2) + rubber^2 f f^T) F^T

with L and F the twin's slopes by the contact's normal and the force. CalibrationLoads that do not fit (a slip that nobody saw)
count less (Huber). Solved by Levenberg-Marquardt; closures whose gap shuts are solved anew at each step.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from footsense.calibration.fit.twin import (
    GAIN,
    GAP,
    MOUNT,
    N_PARAMETERS,
    STIFFNESS,
    STRAY,
    FootTwin,
    Load,
    unchanged,
)
from footsense.calibration.loads.load_set import LoadSet
from footsense.frames import ELEMENTS

Vector = NDArray[np.float64]

#: What a workshop's feet differ by before anything is measured, standard deviations in the order of the parameters:
#: strays of a wiring, electrodes by shadow mask, spun spacers, rubber of uncertain cure, a foot put on by hand.
PRIOR = np.concatenate(
    [
        np.full(ELEMENTS, 0.5),
        np.full(ELEMENTS, 0.02),
        np.full(ELEMENTS, 3.0),
        [0.4],
        np.full(3, np.radians(5.0)),
    ]
)

#: What a bench cannot hold still: the stick's lean [deg], the share of a force that rubber's memory makes uncertain,
#: the share of a change of capacitance that no model explains [1], and the noise of a mean reading [pF].
_LEAN_DEG, _RUBBER_REL, _UNEXPLAINED_REL, _READING_PF = 1.5, 0.015, 0.005, 0.3e-3
#: A mean of a reference is never known better, whatever its noise: its steps [N].
_LEAST_SIGMA_N = 0.003

#: Steps of the slopes.
_STEP = np.concatenate(
    [np.full(ELEMENTS, 0.01), np.full(ELEMENTS, 1e-3), np.full(ELEMENTS, 0.02), [0.005], np.full(3, 2e-3)]
)
_TURN_RAD, _PUSH_REL = 2e-3, 1e-3
#: A cell as near to its gap is shut [um].
_SHUT_WITHIN_UM = 1e-6
#: Mahalanobis distance of nine readings from which a load counts less: the 99th percentile of chi with 9 degrees.
_FITS_WITHIN = 4.65
_MOST_STEPS, _WON_REL = 25, 1e-5
#: The step before which the shape of the noise is found again, as of parameters that are nearly right.
_SHAPED_ANEW = 3
#: How many light loads there have to be for a beginning, and how many are taken.
_FEWEST_TO_BEGIN, _MOST_TO_BEGIN = 15, 40
_MOST_DAMPING = 1e8


class Fit(NamedTuple):
    """What was found.

    Attributes:
        parameters: As the twin has them, shape (N_PARAMETERS,).
        covariance: Of them, given the loads, shape (N_PARAMETERS, N_PARAMETERS).
        distance: Mahalanobis distance of each load [1], shape (n,); about 3 where all is as supposed.
    """

    parameters: Vector
    covariance: Vector
    distance: Vector

    @property
    def told_rel(self) -> Vector:
        """How much the loads told of each parameter: 0 nothing, 1 all, shape (N_PARAMETERS,)."""
        told: Vector = 1.0 - np.sqrt(np.diag(self.covariance)) / PRIOR
        return told


def fit(twin: FootTwin, loads: LoadSet) -> Fit:
    """Fit a twin to loads.

    Where there are enough, light ones from all sides come first: under them no gap shuts, and the way is straight.

    Args:
        twin: Of the foot, at its readings at rest.
        loads: At least one.
    """
    begin = unchanged()
    size_n = np.linalg.norm(loads.force_n, axis=1)
    light = loads.some(size_n <= np.median(size_n))
    if len(light) >= _FEWEST_TO_BEGIN:
        begin = _descend(twin, light.some(light.spread()[:_MOST_TO_BEGIN]), begin, lends=True).parameters
    # A gap that shuts in the foot and not yet in the twin has no slope, and never would shut. So each is lent that of
    # all gaps together on the way; in the end it has its own, and one that never shuts is as designed.
    lent = _descend(twin, loads, begin, lends=True)
    state = _descend(twin, loads, lent.parameters, lends=False)
    slopes = state.slopes(lends=False)
    covariance = np.asarray(np.linalg.inv(slopes.T @ slopes), dtype=np.float64)
    return Fit(state.parameters, covariance, state.distance)


def _descend(twin: FootTwin, loads: LoadSet, parameters: Vector, *, lends: bool) -> "_State":
    """Return the nearest parameters that explain the loads best; `lends` as of `_State.slopes`."""
    load, read_pf = Load.centred(loads.force_n), loads.undrifted_pf
    whiten = _whitening(twin, parameters, load, loads)
    state = _State(twin, load, read_pf, whiten, parameters)
    damping = 1e-3
    for number in range(_MOST_STEPS):
        if number == _SHAPED_ANEW:
            whiten = _whitening(twin, state.parameters, load, loads)
            state = _State(twin, load, read_pf, whiten, state.parameters)
        slopes = state.slopes(lends=lends)
        curvature, gradient = slopes.T @ slopes, slopes.T @ state.residual
        while damping < _MOST_DAMPING:
            step = np.linalg.solve(curvature + damping * np.diag(np.diag(curvature)), -gradient)
            tried = _State(twin, load, read_pf, whiten, twin.possible(state.parameters + step))
            if tried.cost < state.cost:
                break
            damping *= 10.0
        else:
            break
        won = 1.0 - tried.cost / state.cost
        state, damping = tried, max(damping / 10.0, 1e-9)
        if won < _WON_REL and number > _SHAPED_ANEW:
            break
    return state


class _State:
    """The twin at some parameters, held against the loads."""

    def __init__(
        self, twin: FootTwin, load: Load, read_pf: Vector, whiten: Vector, parameters: Vector
    ) -> None:
        self._twin, self._load, self._whiten = twin, load, whiten
        self.parameters = parameters
        self._cells_um = twin.cells_um(parameters, load)
        self._model_pf = twin.reading_pf(parameters, self._cells_um)
        white = self._whitened(self._model_pf - read_pf)
        self.distance = np.linalg.norm(white, axis=1)
        self._weight = np.sqrt(np.minimum(1.0, _FITS_WITHIN / np.maximum(self.distance, 1e-12)))[:, None]
        self.residual = np.concatenate([(self._weight * white).ravel(), parameters / PRIOR])
        inside = np.minimum(self.distance, _FITS_WITHIN)
        self.cost = float((inside * (2.0 * self.distance - inside)).sum() + ((parameters / PRIOR) ** 2).sum())

    def _whitened(self, difference_pf: Vector) -> Vector:
        white: Vector = np.einsum("nij,nj->ni", self._whiten, difference_pf)
        return white

    def slopes(self, *, lends: bool) -> Vector:
        """Return how the residual changes with each parameter, shape (rows, N_PARAMETERS).

        Args:
            lends: Whether each gap is taken to do to its own element what all gaps together do to it, which is
                something as soon as one shuts nearby; else what it does to all, which is nothing but where it shuts.
        """
        n = len(self._model_pf)
        columns = np.zeros((n * ELEMENTS, N_PARAMETERS))
        for kind in (STRAY, GAIN, GAP) if lends else (STRAY, GAIN):
            moved = self.parameters.copy()
            moved[kind] += _STEP[kind]
            cells_um = self._twin.cells_um(moved, self._load) if kind is GAP else self._cells_um
            slope = (self._twin.reading_pf(moved, cells_um) - self._model_pf) / _STEP[kind]
            for element in range(ELEMENTS):
                alone = np.zeros((n, ELEMENTS))
                alone[:, element] = slope[:, element]
                columns[:, kind.start + element] = (self._weight * self._whitened(alone)).ravel()
        for element in () if lends else range(ELEMENTS):
            columns[:, GAP.start + element] = (self._weight * self._whitened(self._by_gap(element))).ravel()
        for number in (*range(N_PARAMETERS)[STIFFNESS], *range(N_PARAMETERS)[MOUNT]):
            moved = self.parameters.copy()
            moved[number] += _STEP[number]
            slope = (self._twin.capacitance_pf(moved, self._load) - self._model_pf) / _STEP[number]
            columns[:, number] = (self._weight * self._whitened(slope)).ravel()
        return np.concatenate([columns, np.diag(1.0 / PRIOR)])

    def _by_gap(self, element: int) -> Vector:
        """Return how the readings change with one gap [pF/um], shape (n, 9): not at all but where it shuts."""
        slope = np.zeros_like(self._model_pf)
        cells_um = self._cells_um.reshape(len(slope), ELEMENTS, -1)[:, element]
        shut = (cells_um >= self._twin.gap_um(self.parameters)[element] - _SHUT_WITHIN_UM).any(axis=1)
        if shut.any():
            number = GAP.start + element
            moved = self.parameters.copy()
            moved[number] += _STEP[number]
            cells_um = self._twin.cells_um(moved, Load(self._load.normal[shut], self._load.force_n[shut]))
            slope[shut] = (self._twin.reading_pf(moved, cells_um) - self._model_pf[shut]) / _STEP[number]
        return slope


def _whitening(twin: FootTwin, parameters: Vector, load: Load, loads: LoadSet) -> Vector:
    """Return for each load the matrix that makes its residual white, shape (n, 9, 9)."""
    model_pf = twin.capacitance_pf(parameters, load)
    size_n = np.linalg.norm(load.force_n, axis=1, keepdims=True)
    across = _across(load.normal)
    by_lean = [
        (twin.capacitance_pf(parameters, Load(_unit(load.normal + _TURN_RAD * one), load.force_n)) - model_pf)
        / _TURN_RAD
        for one in across
    ]
    by_force = [
        (
            twin.capacitance_pf(parameters, Load(load.normal, load.force_n + _PUSH_REL * size_n * axis))
            - model_pf
        )
        / (_PUSH_REL * size_n)
        for axis in np.eye(3)
    ]
    leaning = np.stack(by_lean, axis=2) * np.radians(_LEAN_DEG) * np.sqrt(0.5)
    slope = np.stack(by_force, axis=2)
    pushed = slope * np.maximum(loads.sigma_n, _LEAST_SIGMA_N)[:, None, :]
    crept = np.einsum("nij,nj->ni", slope, load.force_n)[:, :, None] * _RUBBER_REL
    alone = _READING_PF**2 + (_UNEXPLAINED_REL * (model_pf - loads.unloaded_pf)) ** 2
    covariance = sum(part @ part.transpose(0, 2, 1) for part in (leaning, pushed, crept))
    covariance = covariance + alone[:, :, None] * np.eye(ELEMENTS)
    whiten: Vector = np.linalg.inv(np.linalg.cholesky(covariance))
    return whiten


def _across(normal: Vector) -> tuple[Vector, Vector]:
    """Return two unit vectors across each normal, shape (n, 3) each."""
    aside = np.where(np.abs(normal[:, :1]) < 0.8, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    one = _unit(np.cross(normal, aside))
    return one, np.cross(normal, one)


def _unit(vector: Vector) -> Vector:
    unit: Vector = vector / np.linalg.norm(vector, axis=1, keepdims=True)
    return unit
