"""The Cramer-Rao bound: how well any unbiased read-out of one scan could know the force.

What is read is nine closures as the daemon finds them (`dataset.measured_closure_rel`): through a capacitance with the
converter's noise sigma_C and a baseline with its own, sigma_B. With the distance D = K / C of the electrodes,

    sigma_d^2 = (D^2 sigma_C / K)^2 + (D_0^2 sigma_B / K)^2        per element, white
    F = J^T diag(1 / sigma_d^2) J,      cov >= F^-1,      J = d(closure) / d(unknowns)

That sigma_d moves with the load adds information of the order (sigma_d / D)^2, 1e-8 of the rest: left out.

Two sets of unknowns. `Unknowns.CENTRED`: the force alone, its line known to go through the middle of the ball.
`Unknowns.LEANING`: the force and the two angles of the contact normal. A read-out that has to be right on leaning
contacts cannot know that a load is centred, so the second is its bound, on centred loads too.

Source:
    Kay, Fundamentals of Statistical Signal Processing: Estimation Theory, 1993, chapter 3.
"""

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ellipe

from footsense.foot.capacitor import EPS0_PF_UM_PER_MM2, CapacitorDesign
from footsense.foot.response_table import FootResponse
from footsense.foot.specimen import Foot
from footsense.lab.geometry import LoadRange
from footsense.lab.training.load_cases import (
    BASELINE_NOISE_PF,
    FULL_SCALE_PF,
    GRAM_FORCE_N,
    NOISE_PF,
    directions,
    leaning_normals,
    measured_closure_rel,
    sensed_closure_um,
)

Vector = NDArray[np.float64]

#: Magnitudes at which a network is held against the bound [gf].
MAGNITUDES_GF = (20.0, 35.0, 50.0, 75.0, 100.0, 125.0, 150.0)
#: Leaning loads at each magnitude, before those beyond the converter's range are left out.
LEANING_LOADS = 1000
#: Step of the central differences: of the force relative to its magnitude, of the normal in radians.
STEP = 1e-4


class Unknowns(Enum):
    """What a read-out does not know beforehand."""

    CENTRED = 3
    LEANING = 5


@dataclass(frozen=True, slots=True, eq=False)
class Bound:
    """Least covariance of unbiased estimates of the force, load by load.

    Attributes:
        force_n: The loads [N], shape (n, 3).
        covariance_n2: Bound on the covariance of the estimated force [N2], shape (n, 3, 3).
    """

    force_n: Vector
    covariance_n2: Vector

    @property
    def component_n(self) -> Vector:
        """Least standard deviation of each component [N], shape (n, 3)."""
        sigma: Vector = np.sqrt(np.diagonal(self.covariance_n2, axis1=1, axis2=2))
        return sigma

    @property
    def magnitude_gf(self) -> Vector:
        """Least rms error of the magnitude [gf], shape (n,)."""
        along = self._along()
        variance = np.einsum("ni,nij,nj->n", along, self.covariance_n2, along)
        rms: Vector = np.sqrt(variance) / GRAM_FORCE_N
        return rms

    @property
    def direction_rms_deg(self) -> Vector:
        """Least rms angle between force and estimate [deg], shape (n,)."""
        rms: Vector = np.degrees(np.sqrt(self._angular_variances().sum(axis=1)))
        return rms

    @property
    def direction_mean_deg(self) -> Vector:
        """Mean angle [deg], shape (n,), of a Gaussian on the tangent plane that reaches the bound.

        With variances a >= b along the ellipse's axes the mean length is sqrt(2 a / pi) E(1 - b / a), E the complete
        elliptic integral of the second kind.
        """
        small, large = self._angular_variances().T
        mean: Vector = np.degrees(np.sqrt(2.0 * large / np.pi) * ellipe(1.0 - small / large))
        return mean

    def _along(self) -> Vector:
        """Return the directions of the forces, shape (n, 3)."""
        return _unit(self.force_n)

    def _angular_variances(self) -> Vector:
        """Return the variances of the direction along its ellipse's axes [rad2], shape (n, 2), the smaller first."""
        across = tangents(self._along())
        plane = np.einsum("nai,nij,nbj->nab", across, self.covariance_n2, across)
        squared = (self.force_n**2).sum(axis=1)[:, None]
        variances: Vector = np.maximum(np.linalg.eigvalsh(plane), 0.0) / squared
        return variances


def tangents(direction: Vector) -> Vector:
    """Return two unit vectors across each direction and across each other, shape (n, 2, 3)."""
    aside = np.where(np.abs(direction[:, :1]) < 0.5, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    first = np.cross(direction, aside)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([first, np.cross(direction, first)], axis=1)


def closure_sigma_um(design: CapacitorDesign, closure_um: Vector) -> Vector:
    """Return the standard deviation of measured closures [um], any shape, from converter and baseline noise."""
    stretch = EPS0_PF_UM_PER_MM2 * design.electrode_area_mm2
    now = (design.gap_um - closure_um + design.film_equivalent_um) ** 2
    rest = (design.gap_um + design.film_equivalent_um) ** 2
    sigma: Vector = np.hypot(now * NOISE_PF, rest * BASELINE_NOISE_PF) / stretch
    return sigma


def _unit(vector: Vector) -> Vector:
    """Return vectors scaled to length one, shape (..., 3)."""
    scaled: Vector = vector / np.linalg.norm(vector, axis=-1, keepdims=True)
    return scaled


def jacobian_um(
    foot: Foot, normal: Vector, force_n: Vector, unknowns: Unknowns, step: float = STEP
) -> Vector:
    """Return how the sensed closures follow the unknowns, by central differences through the gap contact.

    Args:
        foot: The specimen.
        normal: Contact normals, shape (n, 3); of centred loads the forces' directions.
        force_n: Forces [N], shape (n, 3), none zero.
        unknowns: What may vary.
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
            pairs.append((_unit(moved) if centred else normal, moved))
    if not centred:
        for across in np.moveaxis(tangents(normal), 1, 0):
            pairs.extend((_unit(normal + sign * across), force_n) for sign in (step, -step))
    closure = sensed_closure_um(
        foot, np.concatenate([n for n, _ in pairs]), np.concatenate([f for _, f in pairs])
    )
    ahead, behind = np.moveaxis(closure.reshape(-1, 2, len(force_n), 9), 1, 0)
    slope: Vector = np.moveaxis(ahead - behind, 0, 2) / (2.0 * step)
    return slope


def force_bound(foot: Foot, normal: Vector, force_n: Vector, unknowns: Unknowns, step: float = STEP) -> Bound:
    """Return the Cramer-Rao bound of the force.

    Args:
        foot: The specimen, as the designed one as the read-out believes.
        normal: Contact normals, shape (n, 3); of centred loads the forces' directions.
        force_n: Forces [N], shape (n, 3), none zero.
        unknowns: What the read-out does not know.
        step: As for `jacobian_um`.
    """
    closure_um = sensed_closure_um(foot, normal, force_n)
    slope = jacobian_um(foot, normal, force_n, unknowns, step)
    whitened = slope / closure_sigma_um(foot.response.design, closure_um)[..., None]
    # The inverse of F = J^T J through the triangle of J = Q R: the square of J's condition never appears.
    inverse = np.linalg.inv(np.linalg.qr(whitened, mode="r"))[:, :3]
    size = np.linalg.norm(force_n, axis=1)
    return Bound(force_n, inverse @ inverse.transpose(0, 2, 1) * (size**2)[:, None, None])


class Summary(NamedTuple):
    """Errors of one magnitude, over loads and noise.

    Attributes:
        direction_rms_deg: Root of the mean squared angle [deg].
        direction_mean_deg: Mean angle [deg].
        magnitude_rms_gf: Root of the mean squared magnitude error [gf].
        component_rms_n: The same of each component [N].
    """

    direction_rms_deg: float
    direction_mean_deg: float
    magnitude_rms_gf: float
    component_rms_n: tuple[float, float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Rung:
    """A read-out against the bound at one magnitude.

    Attributes:
        magnitude_gf: The magnitude [gf].
        n: LoadRange.
        n_saturated: LoadRange beyond the converter's range, left out.
        network: What the read-out does.
        leaning: The bound with five unknowns.
        centred: The bound with three unknowns; None where the loads lean.
        typical_ratio: Median over the loads of the rms angle over the bound's, load by load.
    """

    magnitude_gf: float
    n: int
    n_saturated: int
    network: Summary
    leaning: Summary
    centred: Summary | None
    typical_ratio: float

    @property
    def direction_ratio(self) -> float:
        """Rms angle over the bound's with five unknowns."""
        return self.network.direction_rms_deg / self.leaning.direction_rms_deg

    @property
    def magnitude_ratio(self) -> float:
        """Rms magnitude error over the bound's with five unknowns."""
        return self.network.magnitude_rms_gf / self.leaning.magnitude_rms_gf


@dataclass(frozen=True, slots=True)
class CrbRatio:
    """A read-out against the bound over the loading range.

    Attributes:
        centred: The paper's 180 verification directions, centred.
        leaning: Random directions on contacts that lean by up to the friction angle.
    """

    centred: tuple[Rung, ...]
    leaning: tuple[Rung, ...]

    @property
    def worst(self) -> float:
        """The headline: the largest `direction_ratio` of the centred loads."""
        return max(rung.direction_ratio for rung in self.centred)


def verification_directions() -> Vector:
    """Return the directions of the paper's verification cases, shape (180, 3)."""
    azimuth, elevation = np.meshgrid(
        5.0 + 10.0 * np.arange(36), [45.0, 55.0, 65.0, 75.0, 85.0], indexing="ij"
    )
    return directions(azimuth.ravel(), elevation.ravel())


def leaning_contacts(loads: LoadRange, rng: np.random.Generator, n: int) -> tuple[Vector, Vector]:
    """Return contact normals and directions of force, shapes (m, 3), m <= n: those of n whose contact is in reach.

    Both are drawn as those of the wide set.
    """
    lowest = np.sin(np.radians(loads.min_elevation_deg))
    elevation = np.degrees(np.arcsin(rng.uniform(lowest, 1.0, n)))
    direction = directions(rng.uniform(0.0, 360.0, n), elevation)
    normal = leaning_normals(loads, rng, direction)
    reached = normal[:, 2] >= lowest
    return normal[reached], direction[reached]


def _rms(values: Vector) -> float:
    """Return the root mean square."""
    return float(np.sqrt(np.mean(values**2)))


def _components(values: Vector) -> tuple[float, float, float]:
    """Return the root mean square of each component over all loads."""
    x, y, z = (_rms(values[..., axis]) for axis in range(3))
    return x, y, z


def summary_of(bound: Bound) -> Summary:
    """Return what a read-out that reaches the bound would show."""
    return Summary(
        _rms(bound.direction_rms_deg),
        float(bound.direction_mean_deg.mean()),
        _rms(bound.magnitude_gf),
        _components(bound.component_n),
    )


def _rung(
    foot: Foot,
    force_of: Callable[[Vector], Vector],
    contacts: tuple[Vector, Vector],
    magnitude_gf: float,
    draws: int,
    rng: np.random.Generator,
) -> Rung:
    """Return how a read-out does at one magnitude."""
    design = foot.response.design
    normal, force = contacts[0], contacts[1] * magnitude_gf * GRAM_FORCE_N
    closure_um = sensed_closure_um(foot, normal, force)
    seen = design.capacitance_pf(closure_um).max(axis=1) < FULL_SCALE_PF
    normal, force, closure_um = normal[seen], force[seen], closure_um[seen]
    estimate = np.stack([force_of(measured_closure_rel(design, closure_um, rng)) for _ in range(draws)])
    sine = np.linalg.norm(np.cross(force, estimate), axis=-1)
    angle = np.degrees(np.arctan2(sine, (force * estimate).sum(axis=-1)))
    excess_gf = np.linalg.norm(estimate, axis=-1) / GRAM_FORCE_N - magnitude_gf
    bound = force_bound(foot, normal, force, Unknowns.LEANING)
    centred = np.allclose(contacts[0], contacts[1])
    return Rung(
        magnitude_gf=magnitude_gf,
        n=len(force),
        n_saturated=len(seen) - len(force),
        network=Summary(_rms(angle), float(angle.mean()), _rms(excess_gf), _components(estimate - force)),
        leaning=summary_of(bound),
        centred=summary_of(force_bound(foot, normal, force, Unknowns.CENTRED)) if centred else None,
        typical_ratio=float(np.median(np.sqrt((angle**2).mean(axis=0)) / bound.direction_rms_deg)),
    )


def crb_ratio(
    response: FootResponse,
    loads: LoadRange,
    force_of: Callable[[Vector], Vector],
    *,
    draws: int = 64,
    magnitudes_gf: tuple[float, ...] = MAGNITUDES_GF,
    seed: int = 1,
) -> CrbRatio:
    """Return the errors of a read-out with noise over the Cramer-Rao bound.

    Args:
        response: The foot.
        loads: What its network was trained for, for the leaning loads.
        force_of: The read-out: forces [N], shape (n, 3), of noisy closures over the gap, shape (n, 9).
        draws: Draws of the noise per load.
        magnitudes_gf: Magnitudes [gf].
        seed: Of the noise and of the leaning loads.
    """
    foot, rng = Foot(response), np.random.default_rng(seed)
    direction = verification_directions()
    sets = ((direction, direction), leaning_contacts(loads, rng, LEANING_LOADS))
    centred, leaning = (
        tuple(_rung(foot, force_of, contacts, gf, draws, rng) for gf in magnitudes_gf) for contacts in sets
    )
    return CrbRatio(centred, leaning)
