"""True loads of a tripod gait on flat ground."""

import math
from collections.abc import Callable, Sequence

import numpy as np

from footsense.frames import Vector
from footsense.sim.faults.scene_faults import Leg
from footsense.sim.loads.ground_load import IN_THE_AIR, GroundContact

#: Legs that step half a period later than the others in a tripod gait of six legs, and a tetrapod gait of eight.
SECOND_LEG_GROUP: tuple[Leg, ...] = ("rf", "lm", "rr", "l4")

#: Ground reaction in the world frame [N] over the phase of the gait cycle, 0 at touchdown, in [0, 1).
ReactionOverPhase = Callable[[float], Vector]


class Walk:
    """True loads of a tripod gait on flat ground, with optional standstills.

    A stand begins for each leg in the middle of its next stance and lasts whole gait cycles, so that all six are on
    the ground and then walk on as if they had never stood.

    Args:
        reaction: Ground reaction of each leg over its phase.
        period_ns: Duration of a gait cycle [ns].
        duty_rel: Share of the cycle in stance [1].
        pitch_deg: Lean of the leg at touchdown; it changes linearly to the opposite at lift-off [deg].
        from_ns: Start of the walk; before that, all feet are in the air [ns].
        standstills_ns: Start and end of each stand, in the order of time [ns].
        second: Legs that step half a period later than the others.

    Attributes:
        period_ns: As given.
        duty_rel: As given.
        reaction: As given.
    """

    def __init__(
        self,
        reaction: dict[str, ReactionOverPhase],
        period_ns: int,
        duty_rel: float,
        pitch_deg: float,
        from_ns: int,
        standstills_ns: Sequence[tuple[int, int]] = (),
        second: Sequence[str] = SECOND_LEG_GROUP,
    ) -> None:
        self.reaction = reaction
        self.period_ns = period_ns
        self.duty_rel = duty_rel
        self._pitch_rad = math.radians(pitch_deg)
        self._from_ns = from_ns
        self._stands_ns = tuple(standstills_ns)
        self._second = frozenset(second)
        self._last_contact: tuple[ReactionOverPhase, float, GroundContact] | None = (
            None  # three legs touch the ground alike
        )

    def contact(self, leg: str, t_ns: int) -> GroundContact:
        """Return the true ground contact of a leg at a time [ns]."""
        phase = self.gait_phase_in_stance(leg, t_ns)
        if phase is None:
            return IN_THE_AIR
        reaction = self.reaction[leg]
        if self._last_contact is None or self._last_contact[:2] != (reaction, phase):
            self._last_contact = reaction, phase, self.contact_at_phase(leg, phase)
        return self._last_contact[2]

    def gait_phase_in_stance(self, leg: str, t_ns: int) -> float | None:
        """Return the gait phase of a leg at a time [ns]: 0 at touchdown, up to `duty_rel`; None in swing."""
        from_ns = self._from_ns + (self.period_ns // 2 if leg in self._second else 0)
        since_ns = t_ns - from_ns
        if since_ns < 0:
            return None
        for stand_ns, until_ns in self._stands_ns:
            middle_ns = round(0.5 * self.duty_rel * self.period_ns)
            before = -((from_ns + middle_ns - stand_ns) // self.period_ns)
            stood_ns = middle_ns + max(before, 0) * self.period_ns
            lasts_ns = -((stand_ns - until_ns) // self.period_ns) * self.period_ns
            if stood_ns <= since_ns < stood_ns + lasts_ns:
                since_ns = stood_ns
        phase = since_ns % self.period_ns / self.period_ns
        return phase if phase < self.duty_rel else None

    def contact_at_phase(self, leg: str, phase: float) -> GroundContact:
        """Return the true ground contact of a leg at a gait phase [1], 0 at touchdown, up to `duty_rel`."""
        x, y, z = self.reaction[leg](phase).tolist()
        if z <= 0.0:
            return IN_THE_AIR
        pitch = self._pitch_rad * (1 - 2 * phase / self.duty_rel)
        sin, cos = math.sin(pitch), math.cos(pitch)
        return GroundContact(
            normal=np.array([sin, 0.0, cos]), force_n=np.array([x * cos + z * sin, y, z * cos - x * sin])
        )


def smooth_stance_reaction(duty_rel: float, peak_force_n: float, friction_rel: float) -> ReactionOverPhase:
    """Return a stance's reaction force as a function of phase: braking, then propulsion, rounded at both ends.

    Args:
        duty_rel: Share of the cycle in stance [1].
        peak_force_n: Largest vertical force [N].
        friction_rel: Largest horizontal over vertical force [1].
    """
    flank = 0.2  # share of the stance in which the force rises, and in which it falls

    def reaction(phase: float) -> Vector:
        stance = phase / duty_rel
        edge = min(stance, 1 - stance) / flank
        vertical = peak_force_n * (0.5 - 0.5 * math.cos(math.pi * min(edge, 1.0)))
        along = -friction_rel * math.cos(math.pi * stance)
        return np.array([along * vertical, 0.2 * friction_rel * vertical, vertical])

    return reaction
