"""Cramer-Rao bound: least variance of the force of any unbiased estimator from one scan.

An estimator gets nine closures as the service measures them (`load_cases.measured_closure_rel`): from a capacitance
with the converter's noise sigma_C and a baseline with its own, sigma_B. With the distance D = K / C of the electrodes,

    sigma_d^2 = (D^2 sigma_C / K)^2 + (D_0^2 sigma_B / K)^2        per element, white
    F = J^T diag(1 / sigma_d^2) J,      cov >= F^-1,      J = d(closure) / d(unknowns)

That sigma_d moves with the load adds information of the order (sigma_d / D)^2, 1e-8 of the rest: left out.

The unknowns are the force and two angles of the contact normal. An estimator that has to be right on leaning contacts
cannot know that a load is centred, so this is its bound on centred loads, too.

Source:
    Kay, Fundamentals of Statistical Signal Processing: Estimation Theory, 1993, chapter 3.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from footsense.foot.capacitor import EPS0_PF_UM_PER_MM2
from footsense.foot.directions import angles_between_deg, normalized, tangent_frame
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


class Bound(NamedTuple):
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


def jacobian_um(foot: Specimen, normal: Vector, force_n: Vector) -> Vector:
    """Return the Jacobian of the measured closures by the unknowns, by central differences, gap contact included.

    Args:
        foot: The specimen.
        normal: Contact normals, shape (n, 3); of centred loads the forces' directions.
        force_n: Forces [N], shape (n, 3), none zero.

    Returns:
        [um] per relative force and per radian, shape (n, 9, 5): the force's components over |f| come first.
    """
    size, step = np.linalg.norm(force_n, axis=1, keepdims=True), DIFFERENCE_STEP_REL
    pairs = [(normal, force_n + sign * size * axis) for axis in np.eye(3) for sign in (step, -step)]
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
    *,
    noise_pf: float = NOISE_PF,
    baseline_noise_pf: float = BASELINE_NOISE_PF,
) -> Bound:
    """Return the Cramer-Rao bound of the force under each load.

    Args:
        foot: The specimen.
        normal: Contact normals, shape (n, 3); of centred loads the forces' directions.
        force_n: Forces [N], shape (n, 3), none zero.
        noise_pf: Noise of a conversion [pF, rms].
        baseline_noise_pf: Noise of a baseline [pF, rms].
    """
    design, closure_um = foot.response.design, sensed_closure_um(foot, normal, force_n)
    open_um = design.gap_um + design.film_equivalent_um
    plates_pf_um = EPS0_PF_UM_PER_MM2 * design.electrode_area_mm2
    sigma_um = closure_sigma_um(open_um, plates_pf_um, closure_um, noise_pf, baseline_noise_pf)
    whitened = jacobian_um(foot, normal, force_n) / sigma_um[..., None]
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
    bound = force_bound(foot, normal, force)
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
