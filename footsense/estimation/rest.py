"""Loads that stand still: fitted to their readings on the response table of the foot, from the network's answer on.

A load has five unknowns: its normal force s [N], the friction ratio (tangential over normal force, forward and to the
left) and the stereographic contact point. A foot has nine readings y. Each round of Gauss-Newton minimises

    sum ((y - h(x)) / (k sigma_y))^2 + sum ((x - x0) / sigma_0)^2

with the table's closures h, and the network's answer x0 and sigma_0. sigma_y holds noise and the table's error on the
designed foot. A made foot differs from its design by more, so k grows, from 1, with what the nine readings leave
unexplained by any load. Where k comes to its limit, the network's answer stays.

The network still gives the contact, and sigma is never below that of the network: what a made foot has in common with
the designed one is not known, and stiffness and mount leave no residual.
"""

import math
from pathlib import Path
from typing import NamedTuple

import numpy as np

from footsense.errors import ModelError
from footsense.estimation.network import DIFFERENCE_STEP_REL, READINGS, Network
from footsense.estimation.settings import (
    BASELINE_NOISE_PF,
    CONTACT_THRESHOLD_REL,
    READING_NOISE_PF,
    SIGMAS,
    SMALL_SHARE,
)
from footsense.foot import gap_contact
from footsense.foot.contact_coordinates import (
    COORDINATES,
    contact_loads,
    normals_of_stereographic_points,
    within_bounds,
)
from footsense.foot.network_card import TrainedInputs
from footsense.foot.response_table import FootResponse
from footsense.frames import ELEMENTS, Vector
from footsense.ports import LoadEstimate, LoadEstimator, Window

#: Error of the table over the closure [1].
_TABLE_ERROR_REL = 1e-3
#: Rounds of a fit, one in each turn of a leg: from the network's answer, and as many from the other side where those
#: fail.
_ROUNDS_FROM_NETWORK = 7
ROUNDS = 2 * _ROUNDS_FROM_NETWORK
#: Of coordinates: near the diagonals, loads of opposite sides close the gaps nearly alike [1].
_OTHER_SIDE = np.array([1.0, -1.0, -1.0, -1.0, -1.0])
#: Largest k with which a fit is used [1].
_MAX_ERROR_FACTOR = 10.0
#: Most cells beyond their gap: contact of more takes long.
_MAX_CLOSED_CELLS = 60

#: Steps of the differences: of the normal force over itself, and of the other coordinates [1]; the base has none.
_STEPS = DIFFERENCE_STEP_REL * np.vstack([np.zeros(COORDINATES), np.eye(COORDINATES)])
#: Sigma of x0 over that of the network [1]: the same readings are in both.
_PRIOR_OVER_NETWORK_SIGMA = math.sqrt(2.0)
#: Least sigma of ratio and point [1]: what the table may be off by.
_MIN_PRIOR_SIGMA = SIGMAS * _TABLE_ERROR_REL


def trained_response(folder: Path, network: Network) -> FootResponse:
    """Return the response table in a foot type's folder.

    Args:
        folder: The folder.
        network: The network in use.

    Raises:
        ModelError: There is none, or it is not the one that the network was trained on.
    """
    path = folder / "response.npz"
    response = FootResponse.load(path)
    if response.sha256 != network.card.response_sha256:
        raise ModelError(f"{path}: not the response table that the network was trained on")
    return response


class _Linearization(NamedTuple):
    """Closures over the gap [1] and force [N] of a load, shapes (9,) and (3,), with derivatives by its coordinates."""

    closure_rel: Vector
    closure_slopes: Vector
    force_n: Vector
    force_slopes: Vector


class _Round(NamedTuple):
    """Result of a round.

    Attributes:
        coordinates: Fitted coordinates, shape (5,).
        force_n: Their force [N], shape (3,).
        force_n_per_closure: Derivative of the fitted force by the measured closures [N], shape (3, 9).
        sigma_n: Standard deviation of the force [N], shape (3,).
        usable: Whether the table explains the readings, and the step was not cut.
    """

    coordinates: Vector
    force_n: Vector
    force_n_per_closure: Vector
    sigma_n: Vector
    usable: bool


class LoadFit:
    """Gauss-Newton fit of one load to nine closures.

    Args:
        response: Response of the foot type.
    """

    def __init__(self, response: FootResponse) -> None:
        self._response, self._design = response, response.design
        self._gap_um = np.full(gap_contact.N_CELLS, response.design.gap_um)
        # Each variant of a load has the same gaps.
        self._gaps_um = np.tile(self._gap_um, (len(_STEPS), 1))
        self._unloaded_pf = np.array(response.design.unloaded_pf)

    def noise_rel(self, closure_rel: Vector) -> Vector:
        """Return the noise of a reading [1 of the gap], same shape as the closures over the gap."""
        return READING_NOISE_PF * self._um_per_pf(closure_rel) / self._design.gap_um

    def sigma_rel(self, closure_rel: Vector, n_readings: int) -> Vector:
        """Return sigma_y of means of readings [1], same shape as the closures over the gap."""
        noise_rel = self.noise_rel(closure_rel) / math.sqrt(n_readings)
        baseline_rel = BASELINE_NOISE_PF * self._um_per_pf(np.zeros(ELEMENTS)) / self._design.gap_um
        sigma: Vector = np.sqrt(noise_rel**2 + baseline_rel**2 + (_TABLE_ERROR_REL * closure_rel) ** 2)
        return sigma

    def _um_per_pf(self, closure_rel: Vector) -> Vector:
        design = self._design
        distance_um = design.gap_um * (1.0 - closure_rel) + design.film_equivalent_um
        per_pf: Vector = distance_um**2 / design.plate_distance_um(np.ones(1))
        return per_pf

    def round(
        self, coordinates: Vector, prior: Vector, prior_sigma: Vector, closure_rel: Vector, sigma_rel: Vector
    ) -> _Round | None:
        """Do one round from given coordinates; None where too many cells are closed.

        Args:
            coordinates: Where to start, shape (5,).
            prior: x0, shape (5,).
            prior_sigma: sigma_0, shape (5,).
            closure_rel: Measured closures over the gap [1], shape (9,).
            sigma_rel: sigma_y [1], shape (9,).
        """
        here = self._linearize(coordinates)
        if here is None:
            return None
        residual = (closure_rel - here.closure_rel) / sigma_rel
        slopes = here.closure_slopes / sigma_rel[:, None]
        unexplained = residual - slopes @ np.linalg.lstsq(slopes, residual, rcond=None)[0]
        error_factor = max(1.0, math.sqrt(float(unexplained @ unexplained) / (ELEMENTS - COORDINATES)))
        weight = slopes.T / error_factor**2
        information = weight @ slopes + np.diag(prior_sigma**-2.0)
        step = np.linalg.solve(information, weight @ residual + (prior - coordinates) / prior_sigma**2)
        longest = float(np.abs(step[1:]).max())
        # Ratio and contact point are of the size of one.
        cut = longest > SMALL_SHARE
        if cut:
            step *= SMALL_SHARE / longest
        after = within_bounds((coordinates + step)[None])[0]
        gain = here.force_slopes @ np.linalg.inv(information)
        return _Round(
            after,
            contact_loads(after[None])[1][0],
            gain @ weight / sigma_rel,
            np.sqrt((gain * here.force_slopes).sum(axis=1)),
            usable=error_factor <= _MAX_ERROR_FACTOR and not cut,
        )

    def _linearize(self, coordinates: Vector) -> _Linearization | None:
        steps = _STEPS.copy()
        steps[:, 0] *= coordinates[0]
        normal, force_n = contact_loads(coordinates - steps)
        cells_um = self._response.free_closure_um(normal, force_n)
        n_closed = np.count_nonzero(cells_um[0] > self._gap_um)
        if n_closed > _MAX_CLOSED_CELLS:
            return None
        if n_closed:
            compliance = self._response.compliance_um_per_n
            contact_n = gap_contact.solve_contact_lcp(cells_um[0], self._gap_um, compliance).cell_forces_n
            cells_um = gap_contact.closures_for_closed_cells_um(
                cells_um[:, None], self._gaps_um, compliance, (contact_n > 0.0)[None]
            )[:, 0]
        design = self._design
        distance_um = design.gap_um - cells_um + design.film_equivalent_um
        closure_um = design.closure_um(gap_contact.capacitance_pf(design, distance_um), self._unloaded_pf)
        closure_rel, step = closure_um / design.gap_um, steps.sum(axis=0)
        return _Linearization(
            closure_rel[0],
            ((closure_rel[0] - closure_rel[1:]) / step[:, None]).T,
            force_n[0],
            ((force_n[0] - force_n[1:]) / step[:, None]).T,
        )


class RefinedAtRest:
    """The network, with the force of legs that stand still refined by a fit, one round of one leg in each call.

    A leg stands still while the last three readings of every element are equal but for noise. Its force is then that of
    the fit, and of what the readings have changed since, in every call until one reading differs.

    Args:
        network: Network of the foot type.
        response: Response that it was trained on.
        trained: Inputs that it was trained for.
        n_rows: Legs of a call.
    """

    def __init__(
        self, network: LoadEstimator, response: FootResponse, trained: TrainedInputs, n_rows: int
    ) -> None:
        self._network, self._fit = network, LoadFit(response)
        self._min_force_n = CONTACT_THRESHOLD_REL * trained.max_force_n
        self._closure_rel_max = trained.closure_rel_max
        # Readings of a free foot have the most noise.
        self._moves_from_rel = float(2.0 * SIGMAS * self._fit.noise_rel(np.zeros(1))[0])
        self._turn, self._has_begun = 0, False
        # Readings of each leg's last fit [1], NaN before one, and the distance within which others are equal.
        self._fitted_rel = np.full((n_rows, 1, ELEMENTS), np.nan)
        self._equal_rel = np.zeros((n_rows, 1, ELEMENTS))
        self._rounds = np.zeros(n_rows, np.int64)
        self._usable = np.zeros(n_rows, bool)
        self._coordinates, self._prior, self._prior_sigma = np.zeros((3, n_rows, COORDINATES))
        self._force_n, self._sigma_n = np.zeros((2, n_rows, 3))
        self._force_n_per_closure = np.zeros((n_rows, 3, ELEMENTS))

    def estimate(self, window: Window) -> LoadEstimate:
        """Return the estimated load of every row of the window."""
        load = self._network.estimate(window)
        stands = np.zeros(len(self._rounds), bool)
        if self._has_begun:
            equal = np.abs(window.closure_rel - self._fitted_rel) <= self._equal_rel
            stands = np.logical_and.reduce(equal & ~window.missing[:, None], axis=(1, 2))
        row = self._turn
        self._turn = (row + 1) % len(stands)
        if not stands[row]:
            force_n = load.force_n[row]
            is_loaded = force_n @ force_n >= self._min_force_n**2
            stands[row] = is_loaded and self._is_quiet(row, window) and self._begin(row, window, load)
        if stands[row]:
            rounds = self._rounds[row]
            if rounds != ROUNDS and not (rounds == _ROUNDS_FROM_NETWORK and self._usable[row]):
                self._do_round(row)
        if not np.count_nonzero(stands):
            return load
        used = (stands & self._usable)[:, None]
        if not used.any():
            return load
        changed_rel = window.closure_rel.mean(axis=1) - self._fitted_rel[:, 0]
        refined_n = self._force_n + (self._force_n_per_closure @ changed_rel[..., None])[..., 0]
        return load._replace(
            force_n=np.where(used, refined_n, load.force_n),
            sigma_n=np.where(used, np.maximum(load.sigma_n, self._sigma_n), load.sigma_n),
        )

    def _is_quiet(self, row: int, window: Window) -> bool:
        # In plain Python numbers: of a foot that moves, the first element tells.
        readings_rel = zip(*window.closure_rel[row].tolist(), strict=True)
        return all(max(three_rel) - min(three_rel) <= self._moves_from_rel for three_rel in readings_rel)

    def _begin(self, row: int, window: Window, load: LoadEstimate) -> bool:
        """Take the readings of a loaded row for a fit; return whether they are of a load that stands still."""
        readings_rel = window.closure_rel[row]
        mean_rel = readings_rel.mean(axis=0)
        equal_rel = SIGMAS * self._fit.noise_rel(mean_rel)
        is_equal = (np.abs(readings_rel - mean_rel) <= equal_rel).all()
        in_range = (mean_rel < self._closure_rel_max).all()
        if not (is_equal and in_range) or window.missing[row].any():
            return False
        self._fitted_rel[row], self._equal_rel[row] = mean_rel, equal_rel
        self._rounds[row], self._usable[row], self._has_begun = 0, False, True
        point, ratio = np.split(load.contact_point_and_friction[row], 2)
        pressing_n = load.force_n[row] @ normals_of_stereographic_points(point[None])[0]
        start = within_bounds(np.array([[pressing_n, *ratio, *point]]))[0]
        self._coordinates[row] = self._prior[row] = start
        sigma_point, sigma_ratio = np.split(
            _PRIOR_OVER_NETWORK_SIGMA * load.contact_sigma[row] + _MIN_PRIOR_SIGMA, 2
        )
        # The readings alone determine how hard it is pressed.
        self._prior_sigma[row] = pressing_n, *sigma_ratio, *sigma_point
        return True

    def _do_round(self, row: int) -> None:
        mean_rel = self._fitted_rel[row, 0]
        fitted = self._fit.round(
            self._coordinates[row],
            self._prior[row],
            self._prior_sigma[row],
            mean_rel,
            self._fit.sigma_rel(mean_rel, READINGS),
        )
        if fitted is None:
            self._rounds[row], self._usable[row] = ROUNDS, False
            return
        self._rounds[row] += 1
        self._coordinates[row], self._force_n[row], self._force_n_per_closure[row] = fitted[:3]
        self._sigma_n[row], self._usable[row] = fitted[3:]
        if self._rounds[row] == _ROUNDS_FROM_NETWORK and not fitted.usable:
            self._prior[row] *= _OTHER_SIDE
            self._prior_sigma[row, 1:] = 1.0
            self._coordinates[row] = self._prior[row]
