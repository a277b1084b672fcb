"""The adapter of Isaac Lab's contact sensor, with a fake of its documented shapes of 2.3 and of 3.0."""

import importlib.util
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from footsense.frames import Vector

EXAMPLE = Path(__file__).parents[2] / "examples/isaac_lab_feet.py"
#: Environments, bodies of the sensor, those that are feet, and bodies that it filters.
N, B, FEET, M = 3, 5, [1, 3], 2


@pytest.fixture(scope="module")
def example() -> Any:
    spec = importlib.util.spec_from_file_location("isaac_lab_feet", EXAMPLE)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def sensed(version: str, normal_n: Vector, friction_n: Vector) -> SimpleNamespace:
    """Return what a sensor has of forces, shape (N, B, 3); nothing of the second filter, which nothing touches."""
    matrix_n = np.full((N, B, M, 3), np.nan)
    matrix_n[:, :, 0] = friction_n
    if version == "2.3":
        return SimpleNamespace(net_forces_w=normal_n, friction_forces_w=matrix_n)
    return SimpleNamespace(net_normal_forces_w=normal_n, friction_force_matrix_w=matrix_n)


@pytest.mark.parametrize("version", ["2.3", "3.0"])
def test_each_foot_publishes_the_force_of_its_sensor_in_its_own_frame(example: Any, version: str) -> None:
    """One leans by 20 deg about the world's x, so that the ground's normal does in its frame."""
    half = np.radians(20.0) / 2.0
    upright, leaning = [1.0, 0.0, 0.0, 0.0], [np.cos(half), np.sin(half), 0.0, 0.0]
    quat = np.tile([upright, leaning], (N, 1, 1))
    normal_n, friction_n = np.zeros((2, N, B, 3))
    normal_n[:, 1:, 2] = 8.0
    friction_n[:, :, 1] = 2.0  # of feet in the air too: of a contact that has just ended
    normal_n[2, 3] = 0.0
    data = sensed(version, normal_n, friction_n)
    soft = example.SoftFeet(SimpleNamespace(data=data), FEET, "hexapod-2kg", like=quat)
    for _ in range(6):
        force_n, sigma_n, usable = soft.step(0.02, quat if version == "2.3" else np.roll(quat, -1, axis=-1))
    assert force_n.shape == sigma_n.shape == (N, 2, 3)
    assert usable.all()
    cos, sin = np.cos(2.0 * half), np.sin(2.0 * half)
    in_leaning = [0.0, 2.0 * cos + 8.0 * sin, 8.0 * cos - 2.0 * sin]
    expected = np.array([[[0.0, 2.0, 8.0], in_leaning]] * 2 + [[[0.0, 2.0, 8.0], [0.0, 0.0, 0.0]]])
    np.testing.assert_allclose(force_n, expected, atol=0.8)
    data.friction_forces_w = data.friction_force_matrix_w = None
    with pytest.raises(ValueError, match=r"^no friction: set track_friction_forces"):
        soft.step(0.001, quat)
    data.friction_forces_w = data.friction_force_matrix_w = np.zeros((N, B, M, 3))
    soft.reset(np.array([1]))
    _, _, usable = soft.step(0.001, quat if version == "2.3" else np.roll(quat, -1, axis=-1))
    assert usable.tolist() == [[True, True], [False, False], [True, True]]
