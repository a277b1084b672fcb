"""Maximum-likelihood fit of loads to measured closures, by Gauss-Newton, and loads that closures cannot tell apart."""

from typing import NamedTuple

import numpy as np

from footsense.foot.directions import angles_between_deg, directions, normalized, tangent_frame
from footsense.foot.force_errors import GRAM_FORCE_N
from footsense.foot.specimen import Foot
from footsense.frames import Vector
from footsense.lab.evaluation.cramer_rao import Unknowns, closure_sigma_um, jacobian_um
from footsense.lab.training.load_cases import sensed_closure_um

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


def maximum_likelihood(foot: Foot, closure_um: Vector, start: tuple[Vector, Vector], rounds: int = 8) -> Fit:
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
        sigma = closure_sigma_um(design, explained)[..., None]
        slope = jacobian_um(foot, normal, force, Unknowns.LEANING) / sigma
        step = (np.linalg.pinv(slope) @ ((closure_um - explained)[..., None] / sigma))[..., 0]
        step *= np.minimum(
            1.0, _MAX_STEP_REL / np.maximum(np.linalg.norm(step, axis=1, keepdims=True), 1e-12)
        )
        turned = normal + np.einsum("na,ani->ni", step[:, 3:], tangent_frame(normal))
        force = force + np.linalg.norm(force, axis=1, keepdims=True) * step[:, :3]
        normal = clamp_to_min_elevation(normalized(turned))
    explained = sensed_closure_um(foot, normal, force)
    misfit = np.linalg.norm((closure_um - explained) / closure_sigma_um(design, explained), axis=1)
    return Fit(normal, force, misfit)


def clamp_to_min_elevation(unit_vectors: Vector) -> Vector:
    """Return unit vectors with elevations raised to the lowest allowed one, shape (n, 3)."""
    z = np.maximum(unit_vectors[:, 2:], np.sin(np.radians(_MIN_NORMAL_ELEVATION_DEG)))
    across = np.linalg.norm(unit_vectors[:, :2], axis=1, keepdims=True)
    return np.concatenate([unit_vectors[:, :2] * np.sqrt(1.0 - z**2) / np.maximum(across, 1e-12), z], axis=1)


def ambiguous_load_distance_and_angle(
    foot: Foot, magnitude_gf: float, elevation_deg: Vector
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
