"""Response tables of fields that are known in closed form, without a mesh."""

import numpy as np
import pytest
from msgspec.structs import replace

from footsense.foot.directions import directions
from footsense.foot.response_table import series_basis
from footsense.frames import Vector
from footsense.lab.fem.adjoint import AdjointFields
from footsense.lab.fem.mesh import COARSE_MESH, cavity_cells
from footsense.lab.fem.quarter import SOLVED_CLASSES, Parity
from footsense.lab.geometry import MIN_FITTED_ELEVATION_DEG
from footsense.lab.response import (
    SERIES_DEGREE,
    fit_series,
    mean_over_patch,
    patch_series,
    spherical_cap_normals,
    tabulate_response,
)
from tests.lab.released import FOOT_DESIGN

pytestmark = pytest.mark.lab

AROUND = directions([10.0, 100.0, 215.0, 300.0], [85.0, 70.0, 60.0, 50.0])


def basis(normal: Vector) -> Vector:
    return series_basis(normal, SERIES_DEGREE, MIN_FITTED_ELEVATION_DEG)


def harmonics(normal: Vector) -> Vector:
    """Return spherical harmonics of degree 0 and 2, shape (n, 2)."""
    return np.column_stack([np.ones(len(normal)), normal[:, 0] * normal[:, 1]])


def harmonics_series() -> Vector:
    normal = spherical_cap_normals(MIN_FITTED_ELEVATION_DEG)
    return np.asarray(np.linalg.lstsq(basis(normal), harmonics(normal), rcond=None)[0], np.float64)


def test_the_mean_over_a_hertz_patch_is_that_of_funk_and_hecke() -> None:
    """A harmonic of degree 2 is multiplied by the mean of P2 over the patch, 1 - 0.6 a^2 / R^2; a constant stays."""
    mean = mean_over_patch(harmonics_series(), AROUND, 2.0, FOOT_DESIGN)
    share = 1.0 - 0.6 * (2.0 / FOOT_DESIGN.ball_radius_mm) ** 2
    np.testing.assert_allclose(mean, [1.0, share] * harmonics(AROUND), atol=1e-5)


@pytest.mark.parametrize("ball_radius_mm", [10.0, 25.0])
def test_the_series_of_the_patch_is_per_square_millimetre(ball_radius_mm: float) -> None:
    foot = replace(FOOT_DESIGN, ball_radius_mm=ball_radius_mm)
    grown = basis(AROUND) @ patch_series(harmonics_series(), foot)
    np.testing.assert_allclose(grown, [0.0, -0.6 / ball_radius_mm**2] * harmonics(AROUND), atol=1e-5)


def fields_of(parity: Parity, rng: np.random.Generator) -> AdjointFields:
    """Return some smooth field of a class, sampled on a quarter of the ball."""
    normal = spherical_cap_normals(MIN_FITTED_ELEVATION_DEG, rings=20, spokes=120)
    normal = normal[(normal[:, :2] < 0.0).all(axis=1)]
    n_cells = len(cavity_cells(FOOT_DESIGN))
    x, y, z = normal.T
    influence = np.empty((len(normal), n_cells, 3))
    for component in range(3):
        sign_x, sign_y = parity.mirror_image_signs(component)
        of_parity = (1.0 if sign_x > 0 else x) * (1.0 if sign_y > 0 else y) * np.stack([z, x * x, y * y])
        influence[..., component] = of_parity.T @ rng.normal(size=(3, n_cells))
    compliance = rng.normal(size=(n_cells, n_cells))
    return AdjointFields(parity, normal, np.full(len(normal), 0.1), influence, compliance @ compliance.T)


@pytest.mark.parametrize("parity", SOLVED_CLASSES)
def test_a_class_that_is_known_on_a_quarter_has_its_mirror_images_on_the_others(parity: Parity) -> None:
    series = fit_series(fields_of(parity, np.random.default_rng(1)))
    here = np.tensordot(basis(AROUND), series, 1)
    for axis in (0, 1):
        mirrored = AROUND.copy()
        mirrored[:, axis] *= -1.0
        signs = [parity.mirror_image_signs(component)[axis] for component in range(3)]
        np.testing.assert_allclose(np.tensordot(basis(mirrored), series, 1), here * signs, atol=1e-6)


def test_a_table_knows_that_x_and_y_are_alike_though_its_mesh_does_not() -> None:
    """Forces and contacts with x and y exchanged close the transposed elements, gaps that touch included."""
    rng = np.random.default_rng(2)
    fields = {parity: fields_of(parity, rng) for parity in SOLVED_CLASSES}
    response = tabulate_response(FOOT_DESIGN, COARSE_MESH, fields, {})
    force_n = np.array([0.3, -0.2, 0.9])
    here, there = (
        response.free_element_closures_um(AROUND[:, order], np.tile(force_n[order], (len(AROUND), 1)))
        for order in ([0, 1, 2], [1, 0, 2])
    )
    np.testing.assert_allclose(there.reshape(-1, 3, 3), here.reshape(-1, 3, 3).transpose(0, 2, 1), atol=1e-4)
    compliance = response.quarter_compliance
    np.testing.assert_array_equal(compliance, compliance.transpose(1, 0, 3, 2))
