"""Random touchdowns of some feet (hard or soft, upright or leaning): true loads over time."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from footsense.frames import Mask, Vector


class Touchdown(NamedTuple):
    """Type of touchdown: full load [N], rise time [s], and lean [deg].

    Attributes:
        force_n: Full load [N].
        rise_s: Time to the full load [s].
        lean_deg: Distance of the contact from the middle of the ball [deg], to any side.
    """

    force_n: float
    rise_s: float
    lean_deg: float


TOUCHDOWNS = {
    "hard, upright": Touchdown(0.5, 5e-3, 0.0),
    "hard, leaning by 25 deg": Touchdown(0.5, 5e-3, 25.0),
    "soft, upright": Touchdown(1.0, 0.144, 0.0),
    "soft, leaning by 25 deg": Touchdown(1.0, 0.144, 25.0),
}


#: Load from which a foot counts as in contact [N].
CONTACT_THRESHOLD_N = 0.03
#: First touchdown, and times in the air and on the ground after that [s].
_FIRST_S, _SWING_S, _STANCE_S = 1.6, (0.55, 0.75), 0.35
#: Fall time of the load [s], and time after lift-off until a foot counts as in swing [s].
_LIFT_S, _SETTLED_S = 0.05, 0.1
#: Rise time up to which a load rises evenly [s], else rounded like a step of the walk.
_MAX_LINEAR_RISE_S = 0.01
#: Tremor of a foot in the air after a step of its neighbour [N, Hz, s]: an assumption, a quarter of a contact.
VIBRATION_N, _VIBRATION_HZ, _VIBRATION_DECAY_S = CONTACT_THRESHOLD_N / 4, 25.0, 0.05


class RandomTouchdowns:
    """Touchdowns of some feet at random times; each foot always has the same type of touchdown.

    Args:
        n_feet: Feet of each manner.
        until_s: End of the run [s].
        rng: Source of times and sides.

    Attributes:
        kind: Number of the manner of each foot, shape (feet,).
        starts_s: First touch of each step [s], shape (feet, steps).
        crossed_s: Time at which each step reaches `CONTACT_THRESHOLD_N` along the leg [s], same shape.
        normals: Inward normal of each contact, shape (feet, steps, 3).
        upright: Share of the force of each foot that is along its leg [1], shape (feet,).
    """

    def __init__(self, n_feet: int, until_s: float, rng: np.random.Generator) -> None:
        self.kind = np.arange(len(TOUCHDOWNS)).repeat(n_feet)
        manner = np.array(list(TOUCHDOWNS.values()))[self.kind]
        self._force_n, self._rise_s, lean_rad = manner[:, 0], manner[:, 1], np.radians(manner[:, 2])
        n_steps = int((until_s - _FIRST_S) / (_SWING_S[0] + _STANCE_S)) + 1
        cycles_s = rng.uniform(*_SWING_S, (len(manner), n_steps)) + _STANCE_S
        self.starts_s = _FIRST_S - cycles_s[:, :1] + np.cumsum(cycles_s, axis=1)
        azimuth_rad = rng.uniform(0, 2 * np.pi, self.starts_s.shape)
        self.upright = np.cos(lean_rad)
        sin, up = np.sin(lean_rad)[:, None], np.broadcast_to(self.upright[:, None], azimuth_rad.shape)
        self.normals = np.stack((sin * np.cos(azimuth_rad), sin * np.sin(azimuth_rad), up), axis=2)
        share = CONTACT_THRESHOLD_N / (self._force_n * self.upright)
        rises = np.where(self._rise_s <= _MAX_LINEAR_RISE_S, share, np.arccos(1 - 2 * share) / np.pi)
        self.crossed_s = self.starts_s + (rises * self._rise_s)[:, None]

    def latest_touchdown_index(self, t_s: Vector) -> NDArray[np.intp]:
        """Return the index of each foot's latest touchdown at some times, shape (times, feet); -1 before the first."""
        return np.stack(
            [np.searchsorted(starts_s, t_s, side="right") - 1 for starts_s in self.starts_s], axis=1
        )

    def normal_force_n(self, t_s: Vector) -> Vector:
        """Return the true normal force on each foot at some times [N], shape (times, feet)."""
        since_s = self._time_since_touchdown_s(t_s)
        risen = np.clip(since_s / self._rise_s, 0.0, 1.0)
        risen = np.where(self._rise_s <= _MAX_LINEAR_RISE_S, risen, 0.5 - 0.5 * np.cos(np.pi * risen))
        force_n: Vector = self._force_n * risen * np.clip((_STANCE_S - since_s) / _LIFT_S, 0.0, 1.0)
        return force_n

    def is_swing(self, t_s: Vector) -> Mask:
        """Return the mask of feet unloaded for at least 0.1 s at some times, shape (times, feet)."""
        is_swing: Mask = self._time_since_touchdown_s(t_s) > _STANCE_S + _SETTLED_S
        return is_swing

    def vibration_after_neighbour_n(self, t_s: Vector) -> Vector:
        """Return the decaying vibration force on each foot after a neighbour's touchdown [N], shape (times, feet)."""
        since_s = np.roll(self._time_since_touchdown_s(t_s), len(TOUCHDOWNS) // 2 + 1, axis=1)
        wave = np.sin(2 * np.pi * _VIBRATION_HZ * np.minimum(since_s, 1.0))
        vibration_after_neighbour_n: Vector = VIBRATION_N * np.exp(-since_s / _VIBRATION_DECAY_S) * wave
        return vibration_after_neighbour_n

    def _time_since_touchdown_s(self, t_s: Vector) -> Vector:
        """Return the time since each foot's latest touchdown [s], shape (times, feet); infinite before the first."""
        touchdown_number = self.latest_touchdown_index(t_s)
        start_s = np.where(
            touchdown_number < 0,
            -np.inf,
            self.starts_s[np.arange(touchdown_number.shape[1]), touchdown_number],
        )
        since_s: Vector = t_s[:, None] - start_s
        return since_s
