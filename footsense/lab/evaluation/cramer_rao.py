"""Cramer-Rao bound: least variance of the force of any unbiased estimator from one scan.

An estimator gets nine closures as the service measures them (`load_cases.measured_closure_rel`): from a capacitance
with the converter's noise sigma_C and a baseline with its own, sigma_B. With the distance D = K / C of the electrodes,

    sigma_d^2 = (D^2 sigma_C / K)^2 + (D_0^2 sigma_B / K)^2        per element, white
    F = J^T diag(1 / sigma_d^2) J,      cov >= F^-1,      J = d(closure) / d(unknowns)

That sigma_d moves with the load adds information of the order (sigma_d / D)^2, 1e-8 of the rest: left out.

Two sets of unknowns. `Unknowns.CENTRED`: the force alone, its line known to go through the middle of the ball.
`Unknowns.LEANING`: the force and the two angles of the contact normal. An estimator that has to be right on leaning
contacts cannot know that a load is centred, so the second is its bound, on centred loads too.

The fit that reaches it, Gauss-Newton, also finds loads that closures cannot tell apart.

Source:
    Kay, Fundamentals of Statistical Signal Processing: Estimation Theory, 1993, chapter 3.
"""

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import Any, NamedTuple

import numpy as np

from footsense.foot.capacitor import EPS0_PF_UM_PER_MM2, Capacitor
from footsense.foot.directions import angles_between_deg, directions, normalized, tangent_frame
from footsense.foot.force_errors import GRAM_FORCE_N
from footsense.foot.specimen import Specimen
from footsense.frames import Vector
from footsense.lab.evaluation.evaluate_models import rms
from footsense.lab.training.load_cases import (
    BASELINE_NOISE_PF,
    FULL_SCALE_PF,
    NOISE_PF,
    measured_closure_rel,
    sensed_closure_um,
)

#: Step of the central differences: of the force relative to its magnitude, of the normal in radians.
DIFFERENCE_STEP_REL = 1e-4


class Unknowns(Enum):
    """Parameters that an estimator has to find: the force alone (centred contact), or force and contact normal."""

    CENTRED = 3
    LEANING = 5


@dataclass(frozen=True, slots=True, eq=False)
class Bound:
    """Cramer-Rao bound: least covariance of an unbiased force estimate, for each of n loads.

    Attributes:
        true_force_n: The loads [N], shape (n, 3).
        covariance_n2: Bound on the covariance of the estimated force [N2], shape (n, 3, 3).
    """

    true_force_n: Vector
    covariance_n2: Vector

    @property
    def magnitude_rms_gf(self) -> Vector:
        """Least rms error of the force magnitude [gf], shape (n,)."""
        along = normalized(self.true_force_n)
        variance = np.einsum("ni,nij,nj->n", along, self.covariance_n2, along)
        rms: Vector = np.sqrt(variance) / GRAM_FORCE_N
        return rms

    @property
    def direction_rms_deg(self) -> Vector:
        """Least rms angle between estimated and true force [deg], shape (n,)."""
        across = np.stack(tangent_frame(normalized(self.true_force_n)), axis=1)
        variance = np.einsum("nai,nij,naj->n", across, self.covariance_n2, across)
        rms: Vector = np.degrees(np.sqrt(variance / (self.true_force_n**2).sum(axis=1)))
        return rms


def closure_sigma_um(
    open_um: Any,
    plates_pf_um: Any,
    closure_um: Vector,
    noise_pf: float = NOISE_PF,
    baseline_noise_pf: float = BASELINE_NOISE_PF,
) -> Vector:
    """Return the standard deviation of measured closures [um] from noise and baseline noise, shape of `closure_um`.

    Args:
        open_um: Distance of the unloaded electrodes [um], as of air.
        plates_pf_um: Capacitance times that distance [pF um].
        closure_um: The closures [um].
        noise_pf: Noise of a conversion [pF, rms].
        baseline_noise_pf: Noise of a baseline [pF, rms].
    """
    now, rest = (open_um - closure_um) ** 2 * noise_pf, open_um**2 * baseline_noise_pf
    sigma: Vector = np.hypot(now, rest) / plates_pf_um
    return sigma


def _sigma_on_foot_um(
    design: Capacitor,
    closure_um: Vector,
    noise_pf: float = NOISE_PF,
    baseline_noise_pf: float = BASELINE_NOISE_PF,
) -> Vector:
    open_um = design.gap_um + design.film_equivalent_um
    plates_pf_um = EPS0_PF_UM_PER_MM2 * design.electrode_area_mm2
    return closure_sigma_um(open_um, plates_pf_um, closure_um, noise_pf, baseline_noise_pf)


def jacobian_um(
    foot: Specimen, normal: Vector, force_n: Vector, unknowns: Unknowns, step: float = DIFFERENCE_STEP_REL
) -> Vector:
    """Return the Jacobian of the measured closures by the unknowns, by central differences, gap contact included.

    Args:
        foot: The specimen.
        normal: Contact normals, shape (n, 3); of centred loads the forces' directions.
        force_n: Forces [N], shape (n, 3), none zero.
        unknowns: The quantities that vary.
        step: Step, of the force relative to its magnitude and of the normal [rad].

    Returns:
        [um] per relative force and per radian, shape (n, 9, 3 or 5): the force's components over |f| come first.
    """
    size = np.linalg.norm(force_n, axis=1, keepdims=True)
    centred = unknowns is Unknowns.CENTRED
    pairs = []
    for axis in np.eye(3):
        for sign in (step, -step):
            moved = force_n + sign * size * axis
            pairs.append((normalized(moved) if centred else normal, moved))
    if not centred:
        for across in tangent_frame(normal):
            pairs.extend((normalized(normal + sign * across), force_n) for sign in (step, -step))
    closure = sensed_closure_um(
        foot, np.concatenate([n for n, _ in pairs]), np.concatenate([f for _, f in pairs])
    )
    ahead, behind = np.moveaxis(closure.reshape(-1, 2, len(force_n), closure.shape[1]), 1, 0)
    slope: Vector = np.moveaxis(ahead - behind, 0, 2) / (2.0 * step)
    return slope


def force_bound(
    foot: Specimen,
    normal: Vector,
    force_n: Vector,
    unknowns: Unknowns,
    step: float = DIFFERENCE_STEP_REL,
    *,
    noise_pf: float = NOISE_PF,
    baseline_noise_pf: float = BASELINE_NOISE_PF,
) -> Bound:
    """Return the Cramer-Rao bound of the force under each load.

    Args:
        foot: The specimen.
        normal: Contact normals, shape (n, 3); of centred loads the forces' directions.
        force_n: Forces [N], shape (n, 3), none zero.
        unknowns: The unknowns of the estimator.
        step: As for `jacobian_um`.
        noise_pf: Noise of a conversion [pF, rms].
        baseline_noise_pf: Noise of a baseline [pF, rms].
    """
    closure_um = sensed_closure_um(foot, normal, force_n)
    slope = jacobian_um(foot, normal, force_n, unknowns, step)
    sigma_um = _sigma_on_foot_um(foot.response.design, closure_um, noise_pf, baseline_noise_pf)
    whitened = slope / sigma_um[..., None]
    # The inverse of F = J^T J through the triangle of J = Q R: the square of J's condition never appears.
    inverse = np.linalg.inv(np.linalg.qr(whitened, mode="r"))[:, :3]
    size = np.linalg.norm(force_n, axis=1)
    return Bound(force_n, inverse @ inverse.transpose(0, 2, 1) * (size**2)[:, None, None])


def errors_over_bound(
    foot: Specimen,
    estimate_force_n: Callable[[Vector], Vector],
    contacts: tuple[Vector, Vector],
    magnitude_gf: float,
    n_draws: int,
    rng: np.random.Generator,
) -> dict[str, float]:
    """Return the errors of a force estimator under noise beside the bound, at one magnitude, by name.

    Args:
        foot: The specimen.
        estimate_force_n: Returns forces [N], shape (n, 3), of noisy closures over the gap, shape (n, 9).
        contacts: Contact normals and directions of force, shapes (n, 3); those beyond the converter's range are left
            out.
        magnitude_gf: The magnitude [gf].
        n_draws: Draws of the noise per load.
        rng: Of the noise.
    """
    design = foot.response.design
    normal, force = contacts[0], contacts[1] * magnitude_gf * GRAM_FORCE_N
    closure_um = sensed_closure_um(foot, normal, force)
    in_range = design.capacitance_pf(closure_um).max(axis=1) < FULL_SCALE_PF
    normal, force, closure_um = normal[in_range], force[in_range], closure_um[in_range]
    draws = [estimate_force_n(measured_closure_rel(design, closure_um, rng)) for _ in range(n_draws)]
    angle_deg = angles_between_deg(force, np.stack(draws))
    excess_gf = np.linalg.norm(draws, axis=-1) / GRAM_FORCE_N - magnitude_gf
    noiseless = estimate_force_n(closure_um / design.gap_um)
    bound = force_bound(foot, normal, force, Unknowns.LEANING)
    return {
        "magnitude_gf": magnitude_gf,
        "direction_rms_deg": rms(angle_deg),
        "noiseless_direction_rms_deg": rms(angles_between_deg(force, noiseless)),
        "bound_deg": rms(bound.direction_rms_deg),
        "over_bound": rms(angle_deg) / rms(bound.direction_rms_deg),
        "median_over_bound": float(np.median(np.sqrt((angle_deg**2).mean(axis=0)) / bound.direction_rms_deg)),
        "magnitude_rms_gf": rms(excess_gf),
        "bound_gf": rms(bound.magnitude_rms_gf),
    }


#: An ambiguous load of a centred one on the diagonal: where the search for it starts, azimuth and elevation [deg].
AZIMUTH_DEG, _START_DEG, _START_CONTACT_DEG = 45.0, (225.0, 50.0), (225.0, 57.0)
#: Largest step of a round, of the force relative to itself and of the normal [rad].
_MAX_STEP_REL = 0.2
#: Lowest elevation of a contact normal [deg], so that differences stay within the table.
_MIN_NORMAL_ELEVATION_DEG = 26.0


class Fit(NamedTuple):
    """Loads fitted to measured closures, with their misfit.

    Attributes:
        normal: Contact normals, shape (n, 3).
        force_n: Forces [N], shape (n, 3).
        misfit_sigmas: Distance between measured and explained closures, in their standard deviations, shape (n,).
    """

    normal: Vector
    force_n: Vector
    misfit_sigmas: Vector


def maximum_likelihood(
    foot: Specimen, closure_um: Vector, start: tuple[Vector, Vector], rounds: int = 8
) -> Fit:
    """Return force and contact normal fitted to measured closures, by step-limited Gauss-Newton.

    Args:
        foot: The specimen.
        closure_um: Measured closures [um], shape (n, 9).
        start: Contact normals and forces [N] of the start, shapes (n, 3).
        rounds: Steps.
    """
    design = foot.response.design
    normal, force = start
    for _ in range(rounds):
        explained = sensed_closure_um(foot, normal, force)
        sigma = _sigma_on_foot_um(design, explained)[..., None]
        slope = jacobian_um(foot, normal, force, Unknowns.LEANING) / sigma
        step = (np.linalg.pinv(slope) @ ((closure_um - explained)[..., None] / sigma))[..., 0]
        step *= np.minimum(
            1.0, _MAX_STEP_REL / np.maximum(np.linalg.norm(step, axis=1, keepdims=True), 1e-12)
        )
        turned = normal + np.einsum("na,ani->ni", step[:, 3:], tangent_frame(normal))
        force = force + np.linalg.norm(force, axis=1, keepdims=True) * step[:, :3]
        normal = clamp_to_min_elevation(normalized(turned))
    explained = sensed_closure_um(foot, normal, force)
    misfit = np.linalg.norm((closure_um - explained) / _sigma_on_foot_um(design, explained), axis=1)
    return Fit(normal, force, misfit)


def clamp_to_min_elevation(unit_vectors: Vector) -> Vector:
    """Return unit vectors with elevations raised to the lowest allowed one, shape (n, 3)."""
    z = np.maximum(unit_vectors[:, 2:], np.sin(np.radians(_MIN_NORMAL_ELEVATION_DEG)))
    across = np.linalg.norm(unit_vectors[:, :2], axis=1, keepdims=True)
    return np.concatenate([unit_vectors[:, :2] * np.sqrt(1.0 - z**2) / np.maximum(across, 1e-12), z], axis=1)


def ambiguous_load_distance_and_angle(
    foot: Specimen, magnitude_gf: float, elevation_deg: Vector
) -> tuple[Vector, Vector]:
    """Return distance [sigma of the noise] and force angle [deg] from centred loads to a most similar other load.

    Args:
        foot: The specimen.
        magnitude_gf: Magnitude of the centred loads [gf].
        elevation_deg: Elevations of the centred loads [deg], shape (n,).

    Returns:
        Distance in standard deviations of the noise, and angle between the two forces [deg], shapes (n,).
    """
    alike = np.ones_like(elevation_deg)
    direction = directions(AZIMUTH_DEG * alike, elevation_deg)
    force = direction * magnitude_gf * GRAM_FORCE_N
    other, normal = (directions(t1 * alike, t2 * alike) for t1, t2 in (_START_DEG, _START_CONTACT_DEG))
    start = (normal, other * 0.88 * magnitude_gf * GRAM_FORCE_N)
    fit = maximum_likelihood(foot, sensed_closure_um(foot, direction, force), start, rounds=25)
    return fit.misfit_sigmas, angles_between_deg(force, fit.force_n)
