"""Load of a test stand: a sequence of presses by a stick (rise, dwell, release, pause).

The paper's stick is fixed between rails (Fig. 16): its direction is set, so the force goes nearly through the centre of
the ball. The angle between the contact's normal and the force differs from press to press.
"""

from collections.abc import Sequence
from typing import Literal

import numpy as np

from footsense.foot.directions import normalized, paper_directions
from footsense.foot.force_errors import GRAM_FORCE_N
from footsense.frames import Vector
from footsense.sim.loads.ground_load import IN_THE_AIR, GroundContact


def paper_presses(protocol: Literal["training", "verification"]) -> Vector:
    """Return the forces of the paper's calibration presses [N], shape (n, 3).

    Args:
        protocol: `training`: 181 directions at 50 and 150 gf, 362; `verification`: 180 other directions at 100 gf.

    Source:
        Aoyagi et al., section III F.

    Example:
        >>> paper_presses("training").shape, paper_presses("verification").shape
        ((362, 3), (180, 3))
    """
    directions = paper_directions(protocol)
    magnitudes_gf = (50.0, 150.0) if protocol == "training" else (100.0,)
    return np.concatenate([magnitude * GRAM_FORCE_N * directions for magnitude in magnitudes_gf])


class PressSequence:
    """Contact source of a sequence of presses on a test stand, the same on every leg.

    Args:
        force_n: Force of each press [N], shape (n, 3), leg's frame, none of them zero.
        from_ns: Start of the first press [ns].
        rise_ns: Duration of the linear rise of the force, and of its fall [ns].
        dwell_ns: Duration of the constant force between [ns].
        pause_ns: Time without load before the next press [ns].
        lean_deg: Root mean square angle between the contact's normal and the force [deg].
        seed: Seed of these angles.
    """

    def __init__(
        self,
        force_n: Sequence[Sequence[float]] | Vector,
        *,
        from_ns: int,
        rise_ns: int,
        dwell_ns: int,
        pause_ns: int,
        lean_deg: float = 0.0,
        seed: int = 0,
    ) -> None:
        self._force_n = np.asarray(force_n, dtype=np.float64)
        direction = normalized(self._force_n)
        # Only two of the three axes turn a direction: the factor keeps the stated root mean square.
        turn = np.radians(lean_deg) * np.sqrt(0.5) * np.random.default_rng(seed).normal(size=direction.shape)
        self._normal = normalized(direction + np.cross(turn, direction))
        self._from_ns, self._rise_ns, self._dwell_ns = from_ns, rise_ns, dwell_ns
        self._press_period_ns = 2 * rise_ns + dwell_ns + pause_ns

    @property
    def end_ns(self) -> int:
        """End of the pause after the last press [ns]."""
        return self._from_ns + len(self._force_n) * self._press_period_ns

    def contact(self, leg: str, t_ns: int) -> GroundContact:
        """Return the true contact at a time [ns], the same for every leg."""
        del leg
        number, since_ns = divmod(t_ns - self._from_ns, self._press_period_ns)
        pressed_ns = 2 * self._rise_ns + self._dwell_ns
        if not 0 <= number < len(self._force_n) or since_ns >= pressed_ns:
            return IN_THE_AIR
        share = min(since_ns, pressed_ns - since_ns, self._rise_ns) / self._rise_ns if self._rise_ns else 1.0
        return GroundContact(self._normal[number], share * self._force_n[number])
