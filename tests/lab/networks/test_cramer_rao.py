"""The bound is what a maximum-likelihood fit really shows, whatever the step of its differences."""

import numpy as np
import pytest

from footsense.foot.directions import directions, paper_directions, random_directions
from footsense.foot.force_errors import GRAM_FORCE_N
from footsense.foot.response_table import FootResponse
from footsense.foot.specimen import Specimen
from footsense.lab.evaluation.cramer_rao import Unknowns, force_bound, maximum_likelihood
from footsense.lab.training.load_cases import leaning_normals, measured_closure_rel, sensed_closure_um
from tests.lab.released import FOOT_DESIGN, RELEASED


@pytest.fixture(scope="module")
def foot() -> Specimen:
    """Return the released foot as designed."""
    return Specimen(FootResponse.load(RELEASED / "response.npz"))


def test_the_step_of_the_differences_does_not_matter(foot: Specimen) -> None:
    loads, rng = FOOT_DESIGN.loads, np.random.default_rng(3)
    direction = random_directions(rng, 60, 45.0)
    normal = leaning_normals(loads, rng, direction)
    normal = np.where(normal[:, 2:] > np.sin(np.radians(loads.min_elevation_deg)), normal, direction)
    # Below the force at which gaps shut: a cell that shuts within a step is a kink, not an error of the difference.
    force = 30.0 * GRAM_FORCE_N * direction
    fine, middle, coarse = (
        force_bound(foot, normal, force, Unknowns.LEANING, step).direction_rms_deg
        for step in (1e-5, 1e-4, 1e-3)
    )
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
    bound = force_bound(foot, normal[:1], force[:1], Unknowns.LEANING)
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


def test_knowing_that_a_load_is_centred_never_hurts(foot: Specimen) -> None:
    direction = paper_directions("verification")
    for gf in (20.0, 100.0):
        force = direction * gf * GRAM_FORCE_N
        three = force_bound(foot, direction, force, Unknowns.CENTRED)
        five = force_bound(foot, direction, force, Unknowns.LEANING)
        difference_from = np.linalg.eigvalsh(five.covariance_n2 - three.covariance_n2)
        assert difference_from.min() > -1e-6 * five.covariance_n2.max()
