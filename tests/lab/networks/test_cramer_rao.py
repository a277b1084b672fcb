"""The bound is what a maximum-likelihood fit really shows, whatever the step of its differences.

The same fit finds loads that closures cannot tell apart.
"""

from typing import NamedTuple

import numpy as np
import pytest

from footsense.foot.capacitor import EPS0_PF_UM_PER_MM2
from footsense.foot.directions import (
    angles_between_deg,
    directions,
    normalized,
    random_directions,
    tangent_frame,
)
from footsense.foot.force_errors import GRAM_FORCE_N
from footsense.foot.response_table import FootResponse
from footsense.foot.specimen import Specimen
from footsense.frames import Vector
from footsense.lab.evaluation.cramer_rao import closure_sigma_um, force_bound, jacobian_um
from footsense.lab.training.load_cases import leaning_normals, measured_closure_rel, sensed_closure_um
from tests.lab.released import FOOT_DESIGN, RELEASED


@pytest.fixture(scope="module")
def foot() -> Specimen:
    """Return the released foot as designed."""
    return Specimen(FootResponse.load(RELEASED / "response.npz"))


class Fit(NamedTuple):
    """Loads fitted to measured closures, and how far they are from explaining these, in standard deviations."""

    force_n: Vector
    misfit_sigmas: Vector


def sigma_um(foot: Specimen, closure_um: Vector) -> Vector:
    """Return the standard deviation of measured closures [um]."""
    design = foot.response.design
    open_um = design.gap_um + design.film_equivalent_um
    return closure_sigma_um(open_um, EPS0_PF_UM_PER_MM2 * design.electrode_area_mm2, closure_um)


def maximum_likelihood(foot: Specimen, closure_um: Vector, start: tuple[Vector, Vector], rounds: int) -> Fit:
    """Return loads fitted to measured closures, from contact normals and forces on, by step-limited Gauss-Newton."""
    normal, force = start
    for _ in range(rounds):
        explained = sensed_closure_um(foot, normal, force)
        sigma = sigma_um(foot, explained)[..., None]
        slope = jacobian_um(foot, normal, force) / sigma
        step = (np.linalg.pinv(slope) @ ((closure_um - explained)[..., None] / sigma))[..., 0]
        step *= np.minimum(1.0, 0.2 / np.maximum(np.linalg.norm(step, axis=1, keepdims=True), 1e-12))
        turned = normalized(normal + np.einsum("na,ani->ni", step[:, 3:], tangent_frame(normal)))
        force = force + np.linalg.norm(force, axis=1, keepdims=True) * step[:, :3]
        # The table and its differences need normals that are not below 26 deg.
        z = np.maximum(turned[:, 2:], np.sin(np.radians(26.0)))
        across = np.maximum(np.linalg.norm(turned[:, :2], axis=1, keepdims=True), 1e-12)
        normal = np.concatenate([turned[:, :2] * np.sqrt(1.0 - z**2) / across, z], axis=1)
    explained = sensed_closure_um(foot, normal, force)
    return Fit(force, np.linalg.norm((closure_um - explained) / sigma_um(foot, explained), axis=1))


def test_the_step_of_the_differences_does_not_matter(foot: Specimen, monkeypatch: pytest.MonkeyPatch) -> None:
    loads, rng = FOOT_DESIGN.loads, np.random.default_rng(3)
    direction = random_directions(rng, 60, 45.0)
    normal = leaning_normals(loads, rng, direction)
    normal = np.where(normal[:, 2:] > np.sin(np.radians(loads.min_elevation_deg)), normal, direction)
    # Below the force at which gaps shut: a cell that shuts within a step is a kink, not an error of the difference.
    force = 30.0 * GRAM_FORCE_N * direction
    bounds = []
    for step in (1e-5, 1e-4, 1e-3):
        monkeypatch.setattr("footsense.lab.evaluation.cramer_rao.DIFFERENCE_STEP_REL", step)
        bounds.append(force_bound(foot, normal, force).direction_rms_deg)
    fine, middle, coarse = bounds
    np.testing.assert_allclose(fine, middle, rtol=1e-4)
    np.testing.assert_allclose(coarse, middle, rtol=1e-2)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("azimuth", "elevation", "lean"), [(20.0, 60.0, 0.0), (100.0, 75.0, 20.0), (5.0, 45.0, 0.0)]
)
def test_the_best_fit_of_noisy_scans_scatters_as_the_bound_says(
    foot: Specimen, azimuth: float, elevation: float, lean: float
) -> None:
    draws = 400
    force = directions(np.full(draws, azimuth), np.full(draws, elevation)) * 60.0 * GRAM_FORCE_N
    normal = directions(np.full(draws, azimuth), np.full(draws, elevation - lean))
    bound = force_bound(foot, normal[:1], force[:1])
    closure_um = sensed_closure_um(foot, normal, force)
    design = foot.response.design
    measured = measured_closure_rel(design, closure_um, np.random.default_rng(4)) * design.gap_um
    fit = maximum_likelihood(foot, measured, (normal, force), rounds=4)
    scatter = np.sqrt(np.mean((fit.force_n - force) ** 2, axis=0))
    # 400 draws know a standard deviation to 4 %.
    np.testing.assert_allclose(scatter, np.sqrt(np.diagonal(bound.covariance_n2[0])), rtol=0.12)
    size_gf = np.linalg.norm(fit.force_n, axis=1) / GRAM_FORCE_N - 60.0
    assert np.sqrt(np.mean(size_gf**2)) == pytest.approx(bound.magnitude_rms_gf[0], rel=0.12)
    # Five closures' worth of freedom is fitted away from nine: what is left is chi squared with four degrees.
    assert np.mean(fit.misfit_sigmas**2) == pytest.approx(4.0, rel=0.15)


def test_light_loads_have_a_twin_and_heavy_ones_none(foot: Specimen) -> None:
    """A limit of the sensor: forces 80 deg apart that nine noisy closures of 20 gf cannot tell, and of 100 gf can."""
    elevation_deg, apart = np.arange(43.0, 46.0, 0.5), {}
    alike = np.ones_like(elevation_deg)
    direction = directions(45.0 * alike, elevation_deg)
    other, normal = (directions(225.0 * alike, elevation * alike) for elevation in (50.0, 57.0))
    for magnitude_gf in (20.0, 100.0):
        size_n = magnitude_gf * GRAM_FORCE_N
        closure_um = sensed_closure_um(foot, direction, size_n * direction)
        fit = maximum_likelihood(foot, closure_um, (normal, 0.88 * size_n * other), rounds=25)
        assert angles_between_deg(direction, fit.force_n).min() > 60.0
        apart[magnitude_gf] = fit.misfit_sigmas.min()
    assert apart[20.0] < 2.0
    assert apart[100.0] > 10.0
