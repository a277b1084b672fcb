"""Angles, grids and frames on the sphere, and the contact patch of a ball."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from footsense.foot.directions import (
    azimuth_elevation_deg,
    directions,
    random_directions,
    spiral_directions,
    tangent_frame,
)


def test_angles_of_directions_are_those_they_were_made_of() -> None:
    azimuth_deg, elevation_deg = np.array([-170.0, 0.0, 35.0]), np.array([-20.0, 5.0, 80.0])
    found = azimuth_elevation_deg(3.0 * directions(azimuth_deg, elevation_deg))
    np.testing.assert_allclose(found, [azimuth_deg, elevation_deg], atol=1e-12)


def test_a_tangent_frame_is_right_handed_for_every_normal() -> None:
    normals = np.concatenate([spiral_directions(50, -89.0), np.eye(3), -np.eye(3)])
    first, second = tangent_frame(normals)
    frames = np.stack([first, second, normals], axis=1)
    np.testing.assert_allclose(
        frames @ frames.transpose(0, 2, 1), np.tile(np.eye(3), (len(normals), 1, 1)), atol=1e-12
    )
    np.testing.assert_allclose(np.linalg.det(frames), 1.0)


@pytest.mark.parametrize(
    "spread", [spiral_directions, lambda n, low: random_directions(np.random.default_rng(1), n, low)]
)
def test_directions_over_a_cap_are_uniform_in_area(
    spread: Callable[[int, float], NDArray[np.float64]],
) -> None:
    found = spread(20_000, 30.0)
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1.0)
    assert found[:, 2].min() >= 0.5
    # The height of a uniform direction is uniform.
    assert found[:, 2].mean() == pytest.approx(0.75, abs=0.005)
    np.testing.assert_allclose(found[:, :2].mean(axis=0), 0.0, atol=0.01)
