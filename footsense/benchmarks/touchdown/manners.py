"""Manners of touching down: hard and soft, upright and leaning."""

from typing import NamedTuple


class Touchdown(NamedTuple):
    """A manner of touching down.

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
