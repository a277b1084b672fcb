"""True loads of a tripod gait on flat ground, with rounded stances or the measured ones of a walking person, scaled."""

import math
from collections.abc import Callable, Sequence
from importlib.resources import files
from typing import NamedTuple

import numpy as np

from footsense.frames import ALL_LEGS, Vector
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


_NS_PER_S = 1_000_000_000
_RIGHT_LEGS = ("rf", "rm", "rr", "r4")


class MeasuredStride(NamedTuple):
    """One measured stride of a person: time from heel strike [s], force [N] of shape (n, 3), stride and stance [s]."""

    t_s: Vector
    force_n: Vector
    stride_s: float
    stance_s: float


def measured_strides_by_side() -> dict[str, MeasuredStride]:
    """Return the measured strides of the "right" and "left" foot of a person; x forward, y left, z up.

    Source:
        Ground reaction forces of subject11_noload_free_trial03 of the OpenSim project's models
        (Pipelines/Rajagopal/ExpData/grf_walk.mot), every second sample of 2 kHz; Rajagopal et al.,
        IEEE Trans. Biomed. Eng. 63(10), 2016.
    """
    text = files("footsense.sim.loads").joinpath("measured_walk_grf.csv").read_text(encoding="utf-8")
    data = np.loadtxt(text.splitlines(), delimiter=",", skiprows=1)
    t_s = data[:, 0]
    columns = {"right": slice(1, 4), "left": slice(4, 7)}
    touchdowns = {
        foot: t_s[np.flatnonzero(np.diff((data[:, own][:, 2] > 0).astype(int)) > 0) + 1]
        for foot, own in columns.items()
    }
    # Only the right foot strikes twice in the recording; both feet walk at the same pace.
    stride_s = float(touchdowns["right"][1] - touchdowns["right"][0])
    strides = {}
    for foot, own in columns.items():
        start_s = float(touchdowns[foot][0])
        inside = (t_s >= start_s) & (t_s < start_s + stride_s)
        force_n = data[inside, own]
        stance_s = float(t_s[inside][np.flatnonzero(force_n[:, 2] > 0)[-1]] - start_s)
        strides[foot] = MeasuredStride(t_s[inside] - start_s, force_n, stride_s, stance_s)
    return strides


def measured_walk(peak_force_n: float, pitch_deg: float, from_ns: int) -> Walk:
    """Return a tripod gait with measured ground reaction forces, scaled to `peak_force_n` vertically.

    Args:
        peak_force_n: Largest vertical force [N].
        pitch_deg: As of `Walk`.
        from_ns: As of `Walk`.
    """
    strides = measured_strides_by_side()
    largest_n = max(float(stride.force_n[:, 2].max()) for stride in strides.values())
    scale = peak_force_n / largest_n
    right = strides["right"]

    def replay_stride(stride: MeasuredStride) -> ReactionOverPhase:
        scaled_n = stride.force_n * scale
        last = len(scaled_n) - 1
        dt_s = float(stride.t_s[1] - stride.t_s[0])

        def reaction(phase: float) -> Vector:
            position = phase * stride.stride_s / dt_s
            index = min(int(position), last)
            following = min(index + 1, last)
            part = position - index
            reaction_n: Vector = (1 - part) * scaled_n[index] + part * scaled_n[following]
            return reaction_n

        return reaction

    by_foot = {foot: replay_stride(stride) for foot, stride in strides.items()}
    return Walk(
        reaction={leg: by_foot["right" if leg in _RIGHT_LEGS else "left"] for leg in ALL_LEGS},
        period_ns=round(right.stride_s * _NS_PER_S),
        duty_rel=max(stride.stance_s for stride in strides.values()) / right.stride_s,
        pitch_deg=pitch_deg,
        from_ns=from_ns,
    )
