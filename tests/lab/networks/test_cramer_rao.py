"""The bound is what a maximum-likelihood fit really shows, whatever the step of its differences."""

import numpy as np
import pytest

from footsense.foot.directions import directions, paper_directions
from footsense.foot.force_errors import GRAM_FORCE_N
from footsense.foot.response_table import FootResponse
from footsense.foot.specimen import Foot
from footsense.lab.evaluation.bound_ratio import compare_with_cramer_rao_bound, leaning_contacts
from footsense.lab.evaluation.cramer_rao import Bound, Unknowns, force_bound
from footsense.lab.evaluation.maximum_likelihood import maximum_likelihood
from footsense.lab.training.load_cases import measured_closure_rel, sensed_closure_um
from tests.lab.released import FOOT_DESIGN, RELEASED


@pytest.fixture(scope="module")
def foot() -> Foot:
    """Return the released foot as designed."""
    return Foot(FootResponse.load(RELEASED / "response.npz"))


def test_the_step_of_the_differences_does_not_matter(foot: Foot) -> None:
    normal, direction = leaning_contacts(FOOT_DESIGN.loads, np.random.default_rng(3), 60)
    # Below the force at which gaps shut: a cell that shuts within a step is a kink, not an error of the difference.
    force = 30.0 * GRAM_FORCE_N * direction
    fine, middle, coarse = (
        force_bound(foot, normal, force, Unknowns.LEANING, step).direction_rms_deg
        for step in (1e-5, 1e-4, 1e-3)
    )
    np.testing.assert_allclose(fine, middle, rtol=1e-4)
    np.testing.assert_allclose(coarse, middle, rtol=1e-2)


@pytest.mark.parametrize(
    ("azimuth", "elevation", "lean"), [(20.0, 60.0, 0.0), (100.0, 75.0, 20.0), (5.0, 45.0, 0.0)]
)
def test_the_best_fit_of_noisy_scans_scatters_as_the_bound_says(
    foot: Foot, azimuth: float, elevation: float, lean: float
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
    np.testing.assert_allclose(scatter, bound.component_sigma_n[0], rtol=0.12)
    size_gf = np.linalg.norm(fit.force_n, axis=1) / GRAM_FORCE_N - 60.0
    assert np.sqrt(np.mean(size_gf**2)) == pytest.approx(bound.magnitude_rms_gf[0], rel=0.12)
    # Five closures' worth of freedom is fitted away from nine: what is left is chi squared with four degrees.
    assert np.mean(fit.misfit_sigmas**2) == pytest.approx(4.0, rel=0.15)


def test_knowing_that_a_load_is_centred_never_hurts(foot: Foot) -> None:
    direction = paper_directions("verification")
    for gf in (20.0, 100.0):
        force = direction * gf * GRAM_FORCE_N
        three = force_bound(foot, direction, force, Unknowns.CENTRED)
        five = force_bound(foot, direction, force, Unknowns.LEANING)
        difference_from = np.linalg.eigvalsh(five.covariance_n2 - three.covariance_n2)
        assert difference_from.min() > -1e-6 * five.covariance_n2.max()


def test_the_mean_angle_is_that_of_a_gaussian() -> None:
    covariance = np.diag([4e-8, 1e-8, 1e-8])
    bound = Bound(np.array([[0.0, 0.0, 1.0]]), covariance[None])
    drawn = np.random.default_rng(5).multivariate_normal(np.zeros(2), covariance[:2, :2], 200_000)
    angle = np.degrees(np.linalg.norm(drawn, axis=1))
    assert bound.direction_mean_deg[0] == pytest.approx(angle.mean(), rel=0.01)
    assert bound.direction_rms_deg[0] == pytest.approx(np.sqrt(np.mean(angle**2)), rel=0.01)


def test_a_read_out_of_known_scatter_has_the_ratio_of_its_scatter(foot: Foot) -> None:
    calls = []

    def never_sure(closure_rel: np.ndarray) -> np.ndarray:
        """Return the true forces of the first set, each off by one degree sideways."""
        calls.append(len(closure_rel))
        force = paper_directions("verification") * 100.0 * GRAM_FORCE_N
        sideways = np.cross(force, [0.0, 0.0, 1.0])
        sideways *= np.linalg.norm(force, axis=1, keepdims=True) / np.linalg.norm(
            sideways, axis=1, keepdims=True
        )
        turned: np.ndarray = np.cos(np.radians(1.0)) * force + np.sin(np.radians(1.0)) * sideways
        return np.resize(turned, (len(closure_rel), 3))

    ratio = compare_with_cramer_rao_bound(
        foot.response, FOOT_DESIGN.loads, never_sure, draws=2, magnitudes_gf=(100.0,)
    )
    (only,) = ratio.centred
    assert only.estimator_errors.direction_rms_deg == pytest.approx(1.0)
    assert ratio.worst_centred_direction_error_ratio == pytest.approx(
        1.0 / only.bound_five_unknowns.direction_rms_deg
    )
    assert only.estimator_errors.magnitude_rms_gf == pytest.approx(0.0, abs=1e-9)
    assert calls[:2] == [180, 180]
