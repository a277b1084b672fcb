"""Random stances on rough ground: friction from ice to rubber, slopes, stones, soft soil; the true slip is known.

Normal force, roll and demanded friction are those of `random_gait`; here the ground answers. Stances on stones lean by
up to 30 deg, and a part of the weight pulls downhill. On soft ground the leg's spring is softer and creeps more. In
some stances the leg drags its foot: the body moves on while the ground no longer holds it. In swing the foot shakes.

The leg holds the foot against the ground through a spring: leg, drives and rubber. Without any sliding the ground would
react with the demanded tangential force D(t): the share of the weight that a slope or a stone asks for, and the spring
times the leg's way against the body. Sliding relaxes the spring:

    f(t) = D(t) - k x(t),    |f| <= mu s(t),    s the normal force, x the slid way

While it sticks, the contact creeps in the direction of the force, the faster the nearer the force is to the cone. It
breaks loose at the coefficient of static friction and slides at that of kinetic friction until it rests.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from footsense.foot.specimen import ContactLoads
from footsense.frames import Vector
from footsense.lab.training.random_gait import SWING_DURATION_RANGE_S, RandomStance

#: Step of the integration [s].
INTEGRATION_STEP_S = 1e-3
#: Power of the creep in tangential over normal force.
_CREEP_EXPONENT = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class SlidingGround:
    """Friction coefficients of the ground, creep speed, and stiffness of the spring between foot and body.

    Attributes:
        kinetic_friction: Coefficient of kinetic friction.
        static_over_kinetic_friction: Coefficient of static friction over it, at least 1.
        leg_stiffness_n_per_mm: Spring between contact and body, along the ground [N/mm].
        max_creep_mm_per_s: Creep at the cone [mm/s].
    """

    kinetic_friction: float
    static_over_kinetic_friction: float
    leg_stiffness_n_per_mm: float
    max_creep_mm_per_s: float

    def tangential_n_and_slid_mm(self, pressing_n: Vector, demand_n: Vector) -> tuple[Vector, Vector]:
        """Return the tangential ground forces [N] and the distance slid [mm] over one stance.

        Args:
            pressing_n: Normal force at every `INTEGRATION_STEP_S` from touchdown [N], shape (n,).
            demand_n: Tangential force if the foot did not slide [N], shape (n, 2).

        Returns:
            Tangential force [N], shape (n, 2), and length of the way slid since touchdown [mm], shape (n,).
        """
        stiffness, creep = self.leg_stiffness_n_per_mm, self.max_creep_mm_per_s * INTEGRATION_STEP_S
        slid_x = slid_y = slid_mm = 0.0
        slides = False
        forces, ways = [], []
        for s_n, (demand_x, demand_y) in zip(pressing_n.tolist(), demand_n.tolist(), strict=True):
            x, y = demand_x - stiffness * slid_x, demand_y - stiffness * slid_y
            size = math.hypot(x, y)
            cone_n = self.kinetic_friction * s_n * (1.0 if slides else self.static_over_kinetic_friction)
            slides = size > cone_n
            if slides:
                step_mm = (size - self.kinetic_friction * s_n) / stiffness
                kept = self.kinetic_friction * s_n / size
            elif size:
                step_mm = min(creep * (size / cone_n) ** _CREEP_EXPONENT, size / stiffness)
                kept = 1.0 - step_mm * stiffness / size
            else:
                step_mm, kept = 0.0, 1.0
            if size:
                slid_x += step_mm * x / size
                slid_y += step_mm * y / size
            slid_mm += step_mm
            forces.append((kept * x, kept * y))
            ways.append(slid_mm)
        return np.array(forces).reshape(-1, 2), np.array(ways)


#: Kinetic friction of the ground of a gait, and its spread between stances [1]; static over kinetic friction [1].
FRICTION, _FRICTION_SPREAD_REL, _STATIC_REL = (0.2, 0.6), 0.03, (1.0, 1.15)
#: Spring along the ground [N/mm], and creep at the cone [mm/s], of hard and of soft ground; share of soft ground.
_STIFFNESS, _CREEP, _SOFT_SHARE = ((0.4, 2.0), (0.1, 0.4)), (0.3, 2.0), 0.25
#: Largest lean of stones and slopes [deg], and their share; largest lean of any contact [deg].
_STONE_DEG, _STONE_SHARE, _LARGEST_DEG = 30.0, 0.5, 45.0
#: Share of the stances in which the foot is dragged; way [mm], speed [mm/s] and time to reach it [s].
_DRAGGED_SHARE, _DRAG_MM, _DRAG_MM_PER_S, _DRAG_EASE_S = 0.3, (5.0, 30.0), (20.0, 300.0), 0.02

#: Mass of the outer rubber half: a half ball of 10 mm radius, 1.1 g/cm3 [kg].
OUTER_HALF_KG = 2.3e-3
#: Largest acceleration of a swing, of each gait, along the leg and across it [m/s2].
_MAX_SWING_ACCELERATION_ALONG_AND_ACROSS_M_S2 = (4.0, 7.0)
#: Tremor: acceleration [m/s2], frequency [Hz], decay [s] and mean time between two [s].
_TREMOR_M_S2, _TREMOR_HZ, _DECAY_S, _BETWEEN_S = 2.0, (15.0, 60.0), 0.03, 0.2


class SwingShake:
    """Inertial force on the sensor of one foot in all swings of a gait: swing acceleration and tremor.

    The half below the sheet of elements hangs on it: a small force on the sensor without contact. A leg that swings
    forward accelerates and brakes it, and every step of another leg makes it tremble:

        f(t) = -m (a_swing(t) + a_tremor(t))

    Args:
        rng: Source of the draws.
        duration_s: Duration of the gait [s].
    """

    def __init__(self, rng: np.random.Generator, duration_s: float) -> None:
        along, across = (rng.uniform(0.0, most) for most in _MAX_SWING_ACCELERATION_ALONG_AND_ACROSS_M_S2)
        around = rng.uniform(0.0, 2.0 * np.pi)
        self._swing_m_s2 = np.array([across * np.cos(around), across * np.sin(around), along])
        n = rng.poisson(duration_s / _BETWEEN_S)
        self._at_s = np.sort(rng.uniform(0.0, duration_s, n))
        self._rate = 2.0 * np.pi * rng.uniform(*_TREMOR_HZ, n)
        self._tremor_m_s2 = _TREMOR_M_S2 * rng.normal(size=(n, 3))

    def force_n(self, t_s: Vector, swing_rel: Vector) -> Vector:
        """Return the inertial force on the sensor at n times [N], shape (n, 3); zero in stance.

        Args:
            t_s: Times [s], shape (n,).
            swing_rel: How much of the swing is over, 0 to 1, shape (n,); NaN in stance, which has no shake.
        """
        swinging = np.isfinite(swing_rel)
        turn = 2.0 * np.pi * np.where(swinging, swing_rel, 0.0)
        acceleration = np.outer(np.sin(turn), self._swing_m_s2)
        for at_s, rate, size in zip(self._at_s, self._rate, self._tremor_m_s2, strict=True):
            since_s = t_s - at_s
            near = (since_s > 0.0) & (since_s < 8.0 * _DECAY_S)
            shape = np.exp(-since_s[near] / _DECAY_S) * np.sin(rate * since_s[near])
            acceleration[near] += np.outer(shape, size)
        return np.asarray(-OUTER_HALF_KG * acceleration * swinging[:, None], np.float64)


class TrueSlip(NamedTuple):
    """True stance number, slid distance and friction coefficient of one foot at n times.

    Attributes:
        stance_number: Number of the stance, -1 in the air, shape (n,).
        slid_mm: Distance slid since touchdown [mm], shape (n,).
        kinetic_friction: Coefficient of kinetic friction below the foot, NaN in the air, shape (n,).
    """

    stance_number: Vector
    slid_mm: Vector
    kinetic_friction: Vector


class RoughStance:
    """Random load and slip of one foot over one stance on rough ground.

    Args:
        rng: Source of the draws.
        max_n: Full load of the foot [N].
        friction: Coefficient of kinetic friction.
        is_soft: Whether the ground is soft.
    """

    def __init__(self, rng: np.random.Generator, max_n: float, friction: float, *, is_soft: bool) -> None:
        stance = RandomStance(rng, max_n)
        self.duration_s = stance.duration_s
        self.friction = friction
        ground = SlidingGround(
            kinetic_friction=friction,
            static_over_kinetic_friction=rng.uniform(*_STATIC_REL),
            leg_stiffness_n_per_mm=rng.uniform(*_STIFFNESS[is_soft]),
            max_creep_mm_per_s=_CREEP[is_soft],
        )
        self._t_s = np.asarray(
            INTEGRATION_STEP_S * np.arange(round(self.duration_s / INTEGRATION_STEP_S) + 2), np.float64
        )
        loads = stance.loads(self._t_s)
        self._pressing_n = np.einsum("ij,ij->i", loads.normal, loads.force_n)
        stone = rng.random() < _STONE_SHARE
        lean = np.radians(_STONE_DEG) * np.sqrt(rng.random()) * stone
        around = rng.uniform(0.0, 2.0 * np.pi)
        self._normal = _limited_normals(
            loads.normal[:, :2] + np.sin(lean) * np.array([np.cos(around), np.sin(around)])
        )
        pressed = np.maximum(self._pressing_n, 1e-9)[:, None]
        wanted = loads.force_n[:, :2] / pressed - loads.normal[:, :2]
        downhill = rng.random() * stone * self._normal[:, :2] / self._normal[:, 2:]
        demand_n = pressed * (np.where(pressed > 1e-6, wanted, 0.0) - downhill)
        demand_n += ground.leg_stiffness_n_per_mm * self._drag_mm(rng)
        tangential_n, self._slid_mm = ground.tangential_n_and_slid_mm(self._pressing_n, demand_n)
        self._force_n = _contact_forces_n(self._normal, self._pressing_n, tangential_n)

    def _drag_mm(self, rng: np.random.Generator) -> Vector:
        """Return the distance by which the leg drags the foot along the ground since touchdown [mm], shape (n, 2)."""
        if rng.random() >= _DRAGGED_SHARE:
            return np.zeros((len(self._t_s), 2))
        since_s = np.maximum(self._t_s - rng.uniform(0.05, 0.7) * self.duration_s, 0.0)
        speed = float(np.exp(rng.uniform(*np.log(_DRAG_MM_PER_S))))
        eased_s = np.where(
            since_s < _DRAG_EASE_S, 0.5 * since_s**2 / _DRAG_EASE_S, since_s - 0.5 * _DRAG_EASE_S
        )
        drag_mm = np.minimum(speed * eased_s, rng.uniform(*_DRAG_MM))
        around = rng.uniform(0.0, 2.0 * np.pi)
        return np.asarray(np.outer(drag_mm, [np.cos(around), np.sin(around)]), np.float64)

    def loads(self, t_s: Vector) -> ContactLoads:
        """Return the loads at n times since touchdown [s]."""
        normal = _interpolate_rows(t_s, self._t_s, self._normal)
        return ContactLoads(
            normal / np.linalg.norm(normal, axis=1, keepdims=True),
            _interpolate_rows(t_s, self._t_s, self._force_n),
        )

    def slid_mm(self, t_s: Vector) -> Vector:
        """Return the distance slid on the ground at n times since touchdown [mm]."""
        return np.asarray(np.interp(t_s, self._t_s, self._slid_mm), np.float64)


def _limited_normals(across: Vector) -> Vector:
    """Return unit normals, shape (n, 3), of forward and left components, shape (n, 2), their lean limited."""
    size = np.linalg.norm(across, axis=1, keepdims=True)
    across = across * np.minimum(1.0, np.sin(np.radians(_LARGEST_DEG)) / np.maximum(size, 1e-9))
    return np.hstack([across, np.sqrt(1.0 - (across**2).sum(axis=1, keepdims=True))])


def _contact_forces_n(normal: Vector, pressing_n: Vector, tangential_n: Vector) -> Vector:
    """Return the forces [N] of given normal and tangential magnitudes, each tangential one along the surface."""
    along = -(normal[:, :2] * tangential_n).sum(axis=1, keepdims=True) / normal[:, 2:]
    tangential = np.hstack([tangential_n, along])
    wanted = np.linalg.norm(tangential_n, axis=1, keepdims=True)
    tangential *= wanted / np.maximum(np.linalg.norm(tangential, axis=1, keepdims=True), 1e-12)
    return np.asarray(pressing_n[:, None] * normal + tangential, np.float64)


def _interpolate_rows(t_s: Vector, known_s: Vector, values: Vector) -> Vector:
    """Return the rows of a table, linearly interpolated at n times."""
    return np.stack([np.interp(t_s, known_s, column) for column in values.T], axis=1)


class RoughGait:
    """Random stances of one foot on rough ground in sequence, with inertial shake in every swing.

    Args:
        rng: Source of the draws.
        max_n: Full load of the foot [N].
        duration_s: Time to fill with stances [s].
        friction: Mean coefficient of kinetic friction: that of the other legs' ground; None to draw one.
    """

    def __init__(
        self, rng: np.random.Generator, max_n: float, duration_s: float, friction: float | None = None
    ) -> None:
        friction = rng.uniform(*FRICTION) if friction is None else friction
        is_soft = bool(rng.random() < _SOFT_SHARE)
        self._shake = SwingShake(rng, duration_s)
        self.stances: list[tuple[float, RoughStance]] = []
        start_s = rng.uniform(0.1, 0.25)
        while start_s < duration_s:
            own = friction * (1.0 + _FRICTION_SPREAD_REL * rng.normal())
            stance = RoughStance(rng, max_n, own, is_soft=is_soft)
            self.stances.append((start_s, stance))
            start_s += stance.duration_s + rng.uniform(*SWING_DURATION_RANGE_S)
        self._bounds_s = np.array(
            [0.0, *(at for start, stance in self.stances for at in (start, start + stance.duration_s))]
        )

    def loads(self, t_s: Vector) -> ContactLoads:
        """Return the loads at n times [s]; in swing the normal points up and the force is the inertial shake."""
        place = np.searchsorted(self._bounds_s, t_s, "right") - 1
        first = self._bounds_s[place]
        last = np.append(self._bounds_s, self._bounds_s[-1] + 1.0)[place + 1]
        swing_rel = np.where(place % 2 == 0, (t_s - first) / (last - first), np.nan)
        normal = np.tile([0.0, 0.0, 1.0], (len(t_s), 1))
        force_n = self._shake.force_n(t_s, swing_rel)
        for start_s, stance in self.stances:
            on = (t_s >= start_s) & (t_s < start_s + stance.duration_s)
            if on.any():
                normal[on], force_n[on] = stance.loads(t_s[on] - start_s)
        return ContactLoads(normal, force_n)

    def true_slip(self, t_s: Vector) -> TrueSlip:
        """Return true stance number, slid distance and friction coefficient at n times [s]."""
        number = np.full(len(t_s), -1.0)
        slid_mm, friction = np.zeros(len(t_s)), np.full(len(t_s), np.nan)
        for k, (start_s, stance) in enumerate(self.stances):
            on = (t_s >= start_s) & (t_s < start_s + stance.duration_s)
            number[on], friction[on] = k, stance.friction
            slid_mm[on] = stance.slid_mm(t_s[on] - start_s)
        return TrueSlip(number, slid_mm, friction)
