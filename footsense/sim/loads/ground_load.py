"""True contact (normal and force) of each simulated foot with the ground as a function of time.

A load gives, for a leg and a time, the surface normal at the contact and the ground reaction on the foot, both in
the foot frame (x forward, y left, z along the leg towards the body). On flat ground a leg that leans by the pitch p
(foot ahead of the hip: p > 0) sees the world's vertical as (sin p, 0, cos p): the contact wanders over the ball
during a stance, and the friction makes the force lean away from the normal.
"""

from typing import NamedTuple, Protocol

import numpy as np

from footsense.frames import Vector


class GroundContact(NamedTuple):
    """True contact of one foot with the ground: contact normal and force [N], foot frame.

    Attributes:
        normal: Inward unit normal of the ball at the contact, shape (3,).
        force_n: Ground reaction on the foot [N], shape (3,); zero in the air.
    """

    normal: Vector
    force_n: Vector


class ContactSource(Protocol):
    """Interface: the true ground contact of each leg as a function of time."""

    def contact(self, leg: str, t_ns: int) -> GroundContact:
        """Return the true ground contact of a leg at a time [ns]."""
        ...


#: Lowest elevation of a contact that the responses of feet are known for [deg].
MIN_ELEVATION_DEG = 30

_UP = np.array([0.0, 0.0, 1.0])
IN_THE_AIR = GroundContact(_UP, np.zeros(3))


class RampContact:
    """The same force on every foot, through the centre of its ball: rises linearly from zero, then stays constant.

    Args:
        force_n: Force in the end [N], foot frame, not zero.
        from_ns: Start of the rise [ns].
        rise_ns: Duration of the rise [ns]; 0 for a step.
    """

    def __init__(self, force_n: tuple[float, float, float], from_ns: int, rise_ns: int = 0) -> None:
        self._force_n = np.array(force_n)
        self._normal = self._force_n / np.linalg.norm(self._force_n)
        self._from_ns = from_ns
        self._rise_ns = rise_ns

    def contact(self, leg: str, t_ns: int) -> GroundContact:
        """Return the true ground contact at a time [ns], the same for every leg."""
        del leg
        since_ns = t_ns - self._from_ns
        if since_ns < 0:
            return IN_THE_AIR
        share = min(since_ns / self._rise_ns, 1.0) if self._rise_ns else 1.0
        return GroundContact(self._normal, share * self._force_n)
