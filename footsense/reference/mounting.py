"""How a force sensor sits under a foot: its axes, its units and its range, made into the force on the foot."""

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

__all__ = ["NEWTON_PER", "Mounting"]

#: Units that a sensor may speak in [N]; the pound is the international one of 0.45359237 kg, g_n 9.80665 m/s2.
NEWTON_PER = {"N": 1.0, "mN": 1e-3, "kgf": 9.80665, "gf": 9.80665e-3, "lbf": 4.4482216152605}

#: From this share of its range on, an axis is taken to stand at its end.
_END_REL = 0.999


class Mounting:
    """Turns readings into ground reactions on the foot, in the foot's frame.

    Args:
        axes: Axis of the sensor that is each of the foot's, with its sign: {"x": "-y", "y": "x", "z": "-z"}. A sensor
            on whose top the foot stands reads the foot's push, so that all three have a minus.
        mount_deg: Turns of the sensor about the foot's x, then y, then z, that the axes leave out [deg], shape (3,).
        unit: One of `NEWTON_PER`.
        unit_per_count: What a count of the readings is [unit].
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
        turned = np.zeros((3, 3))
        for row, axis in enumerate("xyz"):
            turned[row, "xyz".index(axes[axis][-1])] = -1.0 if axes[axis][0] == "-" else 1.0
        self._to_foot = _rotation(mount_deg) @ turned * NEWTON_PER[unit]
        self._unit_per_count = unit_per_count
        self._end = _END_REL * np.array(rated)

    def apply(self, raw: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Return the forces [N], shape (n, 3), and whether an axis stands at its end, shape (n,), of some readings."""
        readings = raw * self._unit_per_count
        saturated = np.any(np.abs(readings) >= self._end, axis=1)
        return readings @ self._to_foot.T, np.asarray(saturated)


def _rotation(angles_deg: Sequence[float]) -> NDArray[np.float64]:
    """Return the turn about x, then y, then z, the axes standing still."""
    turn = np.eye(3)
    for axis, angle_deg in enumerate(angles_deg):
        cos, sin = math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))
        a, b = (axis + 1) % 3, (axis + 2) % 3
        one = np.eye(3)
        one[a, a], one[a, b], one[b, a], one[b, b] = cos, -sin, sin, cos
        turn = one @ turn
    return turn
