"""A bench that loads a foot: a stick is pressed against the ball, held, and let go, once after the other.

The paper's stick is fixed between rails (Fig. 16): its direction is set, so the force goes nearly through the centre of
the ball. By how much the contact's normal leans away from the force differs from load to load.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from footsense.sim.loads.ground_load import IN_THE_AIR, Contact

Vector = NDArray[np.float64]

GRAM_FORCE_N = 9.80665e-3

_AZIMUTHS = 36


def paper_presses(name: str) -> Vector:
    """Return the paper's forces (section III F) [N], shape (n, 3).

    Args:
        name: `training`: 36 azimuths at 40 to 80 deg of elevation and the pole, at 50 and 150 gf: 362.
            `verification`: both angles 5 deg farther, at 100 gf: 180.

    Raises:
        KeyError: There is no such set.

    Example:
        >>> paper_presses("training").shape, paper_presses("verification").shape
        ((362, 3), (180, 3))
    """
    first_deg, elevations_deg, pole, sizes_gf = {
        "training": (0.0, (40.0, 50.0, 60.0, 70.0, 80.0), True, (50.0, 150.0)),
        "verification": (5.0, (45.0, 55.0, 65.0, 75.0, 85.0), False, (100.0,)),
    }[name]
    azimuth, elevation = np.meshgrid(
        np.radians(first_deg + 360.0 / _AZIMUTHS * np.arange(_AZIMUTHS)),
        np.radians(elevations_deg),
        indexing="ij",
    )
    ring = np.stack(
        [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)], axis=-1
    ).reshape(-1, 3)
    directions = np.concatenate([ring, [[0.0, 0.0, 1.0]]]) if pole else ring
    return np.concatenate([size * GRAM_FORCE_N * directions for size in sizes_gf])


class PressSequence:
    """Presses one after the other, the same on every leg.

    Args:
        force_n: Force of each press [N], shape (n, 3), leg's frame, none of them zero.
        from_ns: When the first begins [ns].
        rise_ns: How long the force grows evenly, and how long it goes [ns].
        dwell_ns: How long it stands between [ns].
        rest_ns: How long the foot is free before the next [ns].
        lean_deg: Root mean square angle between the contact's normal and the force [deg].
        seed: Of how each one leans.
    """

    def __init__(
        self,
        force_n: Sequence[Sequence[float]] | Vector,
        *,
        from_ns: int,
        rise_ns: int,
        dwell_ns: int,
        rest_ns: int,
        lean_deg: float = 0.0,
        seed: int = 0,
    ) -> None:
        self._force_n = np.asarray(force_n, dtype=np.float64)
        direction = self._force_n / np.linalg.norm(self._force_n, axis=1, keepdims=True)
        # Two of the three axes turn a direction, so that the angle has the stated root mean square.
        turn = np.radians(lean_deg) * np.sqrt(0.5) * np.random.default_rng(seed).normal(size=direction.shape)
        leaning = direction + np.cross(turn, direction)
        self._normal = leaning / np.linalg.norm(leaning, axis=1, keepdims=True)
        self._from_ns, self._rise_ns, self._dwell_ns = from_ns, rise_ns, dwell_ns
        self._lasts_ns = 2 * rise_ns + dwell_ns + rest_ns

    @property
    def ends_ns(self) -> int:
        """When the foot is free after the last press [ns]."""
        return self._from_ns + len(self._force_n) * self._lasts_ns

    def contact(self, leg: str, t_ns: int) -> Contact:
        """Return the same for every leg."""
        del leg
        number, since_ns = divmod(t_ns - self._from_ns, self._lasts_ns)
        pressed_ns = 2 * self._rise_ns + self._dwell_ns
        if not 0 <= number < len(self._force_n) or since_ns >= pressed_ns:
            return IN_THE_AIR
        share = min(since_ns, pressed_ns - since_ns, self._rise_ns) / self._rise_ns if self._rise_ns else 1.0
        return Contact(self._normal[number], share * self._force_n[number])
