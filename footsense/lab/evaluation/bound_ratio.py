"""Ratio of a force estimator's error to the Cramer-Rao bound, by magnitude of the force."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from footsense.foot.directions import angles_between_deg, paper_directions, random_directions
from footsense.foot.force_errors import GRAM_FORCE_N
from footsense.foot.response_table import FootResponse
from footsense.foot.specimen import Foot
from footsense.frames import Vector
from footsense.lab.evaluation.cramer_rao import Bound, Unknowns, force_bound
from footsense.lab.evaluation.evaluate import rms
from footsense.lab.geometry import LoadRange
from footsense.lab.training.load_cases import (
    FULL_SCALE_PF,
    leaning_normals,
    measured_closure_rel,
    sensed_closure_um,
)

#: Magnitudes at which a network is compared with the bound [gf].
MAGNITUDES_GF = (20.0, 35.0, 50.0, 75.0, 100.0, 125.0, 150.0)
#: Leaning loads at each magnitude, before those beyond the converter's range are left out.
N_LEANING_LOADS = 1000
#: Seed of the noise and of the leaning loads.
_SEED = 1


@dataclass(frozen=True, slots=True)
class ErrorSummary:
    """Error statistics at one force magnitude, over loads and noise.

    Attributes:
        direction_rms_deg: Root of the mean squared angle [deg].
        direction_mean_deg: Mean angle [deg].
        magnitude_rms_gf: Root of the mean squared magnitude error [gf].
        component_rms_n: Root of the mean squared error of each force component [N].
    """

    direction_rms_deg: float
    direction_mean_deg: float
    magnitude_rms_gf: float
    component_rms_n: list[float]

    @classmethod
    def of_bound(cls, bound: Bound) -> "ErrorSummary":
        """Return the errors that an estimator at the Cramer-Rao bound would have."""
        return cls(
            rms(bound.direction_rms_deg),
            float(bound.direction_mean_deg.mean()),
            rms(bound.magnitude_rms_gf),
            [rms(component_sigma_n) for component_sigma_n in bound.component_sigma_n.T],
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class ErrorsAtMagnitude:
    """Errors of a force estimator and the Cramer-Rao bound at one force magnitude.

    Attributes:
        magnitude_gf: The force magnitude [gf].
        n: Loads.
        n_saturated: Loads beyond the converter's range, left out.
        estimator_errors: Errors of the force estimator.
        bound_five_unknowns: The Cramer-Rao bound with five unknowns.
        bound_three_unknowns: The bound with three unknowns; None where the loads lean.
        median_direction_error_ratio: Median over the loads of the rms angle over the bound's, load by load.
    """

    magnitude_gf: float
    n: int
    n_saturated: int
    estimator_errors: ErrorSummary
    bound_five_unknowns: ErrorSummary
    bound_three_unknowns: ErrorSummary | None
    median_direction_error_ratio: float

    @property
    def direction_error_ratio(self) -> float:
        """Ratio of the rms angle to that of the Cramer-Rao bound with five unknowns [1]."""
        return self.estimator_errors.direction_rms_deg / self.bound_five_unknowns.direction_rms_deg

    @property
    def magnitude_error_ratio(self) -> float:
        """Ratio of the rms magnitude error to that of the Cramer-Rao bound with five unknowns [1]."""
        return self.estimator_errors.magnitude_rms_gf / self.bound_five_unknowns.magnitude_rms_gf


@dataclass(frozen=True, slots=True)
class BoundComparison:
    """Errors of a force estimator and the Cramer-Rao bound, for each force magnitude.

    Attributes:
        centred: The paper's 180 verification directions, centred.
        leaning: Random directions on contacts that lean by up to the friction angle.
    """

    centred: tuple[ErrorsAtMagnitude, ...]
    leaning: tuple[ErrorsAtMagnitude, ...]

    @property
    def worst_centred_direction_error_ratio(self) -> float:
        """Largest `direction_error_ratio` over the magnitudes of the centred loads."""
        return max(one.direction_error_ratio for one in self.centred)


def leaning_contacts(loads: LoadRange, rng: np.random.Generator, n: int) -> tuple[Vector, Vector]:
    """Return random contact normals and force directions within the table's range, shapes (m, 3), m <= n.

    Both are drawn like the random loads of the training.
    """
    direction = random_directions(rng, n, loads.min_elevation_deg)
    normal = leaning_normals(loads, rng, direction)
    reached = normal[:, 2] >= np.sin(np.radians(loads.min_elevation_deg))
    return normal[reached], direction[reached]


def _errors_at_magnitude(
    foot: Foot,
    estimate_force_n: Callable[[Vector], Vector],
    contacts: tuple[Vector, Vector],
    magnitude_gf: float,
    draws: int,
    rng: np.random.Generator,
) -> ErrorsAtMagnitude:
    """Return the error statistics of a force estimator at one force magnitude."""
    design = foot.response.design
    normal, force = contacts[0], contacts[1] * magnitude_gf * GRAM_FORCE_N
    closure_um = sensed_closure_um(foot, normal, force)
    in_range = design.capacitance_pf(closure_um).max(axis=1) < FULL_SCALE_PF
    normal, force, closure_um = normal[in_range], force[in_range], closure_um[in_range]
    estimate = np.stack(
        [estimate_force_n(measured_closure_rel(design, closure_um, rng)) for _ in range(draws)]
    )
    angle = angles_between_deg(force, estimate)
    excess_gf = np.linalg.norm(estimate, axis=-1) / GRAM_FORCE_N - magnitude_gf
    bound = force_bound(foot, normal, force, Unknowns.LEANING)
    centred = np.allclose(contacts[0], contacts[1])
    return ErrorsAtMagnitude(
        magnitude_gf=magnitude_gf,
        n=len(force),
        n_saturated=len(in_range) - len(force),
        estimator_errors=ErrorSummary(
            direction_rms_deg=rms(angle),
            direction_mean_deg=float(angle.mean()),
            magnitude_rms_gf=rms(excess_gf),
            component_rms_n=[rms(off_n) for off_n in (estimate - force).T],
        ),
        bound_five_unknowns=ErrorSummary.of_bound(bound),
        bound_three_unknowns=ErrorSummary.of_bound(force_bound(foot, normal, force, Unknowns.CENTRED))
        if centred
        else None,
        median_direction_error_ratio=float(
            np.median(np.sqrt((angle**2).mean(axis=0)) / bound.direction_rms_deg)
        ),
    )


def compare_with_cramer_rao_bound(
    response: FootResponse,
    loads: LoadRange,
    estimate_force_n: Callable[[Vector], Vector],
    *,
    draws: int = 64,
    magnitudes_gf: tuple[float, ...] = MAGNITUDES_GF,
) -> BoundComparison:
    """Return the errors of a force estimator under noise beside the Cramer-Rao bound.

    Args:
        response: The foot.
        loads: Range of the leaning loads.
        estimate_force_n: Estimator: returns forces [N], shape (n, 3), of noisy closures over the gap, shape (n, 9).
        draws: Draws of the noise per load.
        magnitudes_gf: Magnitudes [gf].
    """
    foot, rng = Foot(response), np.random.default_rng(_SEED)
    direction = paper_directions("verification")
    sets = ((direction, direction), leaning_contacts(loads, rng, N_LEANING_LOADS))
    centred, leaning = (
        tuple(_errors_at_magnitude(foot, estimate_force_n, contacts, gf, draws, rng) for gf in magnitudes_gf)
        for contacts in sets
    )
    return BoundComparison(centred, leaning)
