"""Conversion of a force sensor's readings to the force on the foot, by its axes, mounting, units and range."""

from collections.abc import Mapping, Sequence

import numpy as np

from footsense.foot.force_errors import GRAM_FORCE_N
from footsense.frames import Mask, Vector

#: Units of force [N]; the pound is the international one of 0.45359237 kg.
NEWTONS_PER_UNIT = {
    "N": 1.0,
    "mN": 1e-3,
    "kgf": 1e3 * GRAM_FORCE_N,
    "gf": GRAM_FORCE_N,
    "lbf": 4.4482216152605,
}

#: Share of its range from which an axis counts as saturated.
_SATURATION_THRESHOLD_REL = 0.999


class SensorMounting:
    """Converts raw sensor readings to the ground reaction force on the foot, in the foot's frame.

    Args:
        axes: Signed sensor axis along each of the foot's: {"x": "-y", "y": "x", "z": "-z"}. A sensor under the foot
            reads the foot's push, so that all three have a minus.
        mount_deg: Further rotation of the sensor about the foot's x, then y, then z [deg], shape (3,).
        unit: One of `NEWTONS_PER_UNIT`.
        unit_per_count: Value of one count of the readings [unit].
        rated: End of the range of the sensor's own x, y and z [unit], shape (3,).
    """

    def __init__(
        self,
        axes: Mapping[str, str],
        mount_deg: Sequence[float],
        unit: str,
        unit_per_count: float,
        rated: Sequence[float],
    ) -> None:
        permutation = np.zeros((3, 3))
        for row, axis in enumerate("xyz"):
            permutation[row, "xyz".index(axes[axis][-1])] = -1.0 if axes[axis][0] == "-" else 1.0
        self._to_foot = rotation_matrix(mount_deg) @ permutation * NEWTONS_PER_UNIT[unit]
        self._unit_per_count = unit_per_count
        self._limit = _SATURATION_THRESHOLD_REL * np.array(rated)

    def to_foot_force_n(self, sensor_values: Vector) -> tuple[Vector, Mask]:
        """Return forces [N], shape (n, 3), and saturation masks, shape (n,), of raw readings, shape (n, 3)."""
        readings = sensor_values * self._unit_per_count
        saturated: Mask = np.any(np.abs(readings) >= self._limit, axis=1)
        return readings @ self._to_foot.T, saturated


def rotation_matrix(angles_deg: Sequence[float]) -> Vector:
    """Return the rotation matrix, shape (3, 3), of rotations about the fixed axes x, y, z [deg], in this order."""
    (cx, cy, cz), (sx, sy, sz) = np.cos(np.radians(angles_deg)), np.sin(np.radians(angles_deg))
    about_x = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    about_y = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    about_z = np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
    matrix: Vector = about_z @ about_y @ about_x
    return matrix
