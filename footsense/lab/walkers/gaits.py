"""Open-loop gaits of the walking robots: where each foot should be over time, and what pushes the body.

A foot follows its own clock: in stance it moves back under the body at the speed of the gait, in swing it is lifted and
brought forward. Times are those of a robot with a shank of 0.21 m; smaller robots step faster (`Robot.time_rel`).
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from footsense.errors import ConfigError
from footsense.frames import Vector
from footsense.lab.walkers.robots import GRAVITY_M_S2, Robot

#: Time in which a robot stands before it moves [s], and in which a gait comes to its full stride [s].
STAND_S, _EASE_S = 0.6, 0.8
#: Share of a stance in which a leg takes its load, and in which it gives it back [1].
_LOAD_FLANK = 0.15
#: Time in which a robot comes from the speed of a bout to that of the next [s].
_BOUT_EASE_S = 0.4


class Footfalls(NamedTuple):
    """Phase of each leg's touchdown within the period [1], in the order of a robot's legs; empty for a kind without.

    Attributes:
        quadruped: Of the legs lf, lr, rf, rr.
        hexapod: Of the legs lf, lm, lr, rf, rm, rr.
    """

    quadruped: tuple[float, ...] = ()
    hexapod: tuple[float, ...] = ()


class Bout(NamedTuple):
    """Part of a walk: duration [s], and shares of the gait's speed [1] and turning [1]; of none, it stands."""

    duration_s: float
    speed_rel: float
    turn_rel: float = 0.0


#: Legs across from each other together: a trot, and a tripod.
DIAGONAL = Footfalls((0.0, 0.5, 0.5, 0.0), (0.0, 0.5, 0.0, 0.5, 0.0, 0.5))
#: One leg after the other, on each side from the rear.
WAVE = Footfalls((0.25, 0.0, 0.75, 0.5), (2 / 6, 1 / 6, 0.0, 5 / 6, 4 / 6, 3 / 6))
#: Legs of a side together; one leg after the other in pairs of rear and front; each side a wave from the rear, half a
#: period apart.
PACE = Footfalls(quadruped=(0.0, 0.0, 0.5, 0.5))
GALLOP = Footfalls(quadruped=(0.5, 0.0, 0.62, 0.12))
RIPPLE = Footfalls(hexapod=(4 / 6, 2 / 6, 0.0, 1 / 6, 5 / 6, 3 / 6))
#: After a front leg the rear one of its side; two of six legs in the air; both legs of a pair together, from the rear.
DIAGONAL_WALK = Footfalls(quadruped=(0.0, 0.25, 0.5, 0.75))
TETRAPOD = Footfalls(hexapod=(0.0, 1 / 3, 2 / 3, 1 / 3, 2 / 3, 0.0))
PAIRS = Footfalls(hexapod=(2 / 3, 1 / 3, 0.0, 2 / 3, 1 / 3, 0.0))
#: Walks, stands, turns on the spot, stands, and walks on in a curve.
_STOPS = (Bout(1.8, 1.0), Bout(0.9, 0.0), Bout(1.6, 0.0, 1.0), Bout(0.8, 0.0), Bout(1.4, 0.5, -0.7))
_OTHER_STOPS = (Bout(1.3, 0.7, 0.5), Bout(1.1, 0.0), Bout(2.0, 1.0), Bout(0.7, 0.0), Bout(1.2, -0.5, -0.8))
#: Lift of feet that drag over the ground, of quadrupeds and of hexapods, over the shank [1].
_DRAG_REL, _HEXAPOD_DRAG_REL = 0.08, 0.04


@dataclass(frozen=True, slots=True, kw_only=True)
class WalkerGait:
    """An open-loop gait; times and speeds of a robot with a shank of 0.21 m.

    Attributes:
        name: Its name.
        period_s: From one step of a foot to its next [s].
        duty_rel: Share of the period on the ground [1].
        forward_m_s: Speed forward [m/s].
        left_m_s: Speed to the left [m/s].
        turn_rad_s: Speed of turning to the left [rad/s].
        lift_rel: Height of a swing over the shank [1].
        footfalls: Phases of the legs.
        bouts: Speeds one after the other, over and over; none for the gait's own all the time.
        hop_rel: Way by which all legs push the body up together, over the shank [1].
        drop_rel: Height from which the robot falls, again and again, over the shank [1].
        push_rel: Pushes against a robot that stands, over its weight [1].
    """

    name: str
    period_s: float = 1.0
    duty_rel: float = 0.6
    forward_m_s: float = 0.0
    left_m_s: float = 0.0
    turn_rad_s: float = 0.0
    lift_rel: float = 0.25
    footfalls: Footfalls = DIAGONAL
    bouts: tuple[Bout, ...] = ()
    hop_rel: float = 0.0
    drop_rel: float = 0.0
    push_rel: float = 0.0

    def phases(self, robot: Robot) -> Vector:
        """Return the phase of each leg's touchdown within the period [1], shape (legs,).

        Raises:
            ConfigError: Robots of this kind have no such gait.
        """
        phases = self.footfalls.quadruped if robot.kind == "quadruped" else self.footfalls.hexapod
        if not phases:
            raise ConfigError(f"a {robot.kind} has no gait {self.name!r}")
        return np.array(phases)

    def feet_m(self, robot: Robot, t_s: Vector) -> Vector:
        """Return where the feet should be in the body's frame at n times [m], shape (n, legs, 3)."""
        time_rel, shank_m = robot.time_rel, robot.shank_m
        period_s, speed_rel = time_rel * self.period_s, shank_m / 0.21 / time_rel
        neutral_m = np.stack([robot.neutral_m(leg) for leg in robot.legs])
        feet_m = np.tile(neutral_m, (len(t_s), 1, 1))
        moving_s = np.maximum(t_s - time_rel * STAND_S, 0.0)[:, None]
        if self.hop_rel:
            feet_m[:, :, 2] -= self._hop_m(shank_m, moving_s[:, 0] / period_s)[:, None]
            return feet_m
        if not (self.forward_m_s or self.left_m_s or self.turn_rad_s):
            return feet_m
        eased = np.clip(moving_s / (time_rel * _EASE_S), 0.0, 1.0)
        phase = np.mod(moving_s / period_s - self.phases(robot), 1.0)
        speed, turning = self._bout_shares(moving_s[:, 0] / time_rel)
        # A foot that has not stepped yet stays where it stands.
        eased = eased * (moving_s > 0.0)
        swing = np.clip((phase - self.duty_rel) / (1.0 - self.duty_rel), 0.0, 1.0)
        stance = np.clip(phase / self.duty_rel, 0.0, 1.0)
        # From half a stride ahead to half a stride behind, and back along a cycloid.
        ahead = np.where(
            phase < self.duty_rel, 0.5 - stance, -0.5 + swing - np.sin(2.0 * np.pi * swing) / (2.0 * np.pi)
        )
        velocity_m_s = speed_rel * np.array([self.forward_m_s, self.left_m_s])
        turn_rad_s = self.turn_rad_s / time_rel
        turning_m_s = turn_rad_s * neutral_m[:, [1, 0]] * np.array([-1.0, 1.0])
        of_leg_m_s = speed[:, None, None] * velocity_m_s + turning[:, None, None] * turning_m_s
        stride_m = self.duty_rel * period_s * of_leg_m_s
        feet_m[:, :, :2] += (eased * ahead)[:, :, None] * stride_m
        feet_m[:, :, 2] += (
            self.lift_rel
            * shank_m
            * np.clip(2.0 * eased, 0.0, _steps(speed, turning))
            * np.sin(np.pi * swing) ** 2
        )
        return feet_m

    def load_shares(self, robot: Robot, t_s: Vector) -> Vector:
        """Return each leg's share of the weight by the gait's clock [1], shape (n, legs)."""
        n_legs = len(robot.legs)
        if self.hop_rel or not (self.forward_m_s or self.left_m_s or self.turn_rad_s):
            return np.full((len(t_s), n_legs), 1.0 / n_legs)
        moving_s = np.maximum(t_s - robot.time_rel * STAND_S, 0.0)[:, None]
        phase = np.mod(moving_s / (robot.time_rel * self.period_s) - self.phases(robot), 1.0)
        edge = np.minimum(phase, self.duty_rel - phase) / (_LOAD_FLANK * self.duty_rel)
        steps = _steps(*self._bout_shares(moving_s[:, 0] / robot.time_rel))
        carries = np.where(moving_s > 0.0, np.maximum(np.clip(edge, 0.0, 1.0), 1.0 - steps), 1.0)
        return np.asarray(carries / np.maximum(carries.sum(axis=1, keepdims=True), 1.0))

    def _bout_shares(self, moved_s: Vector) -> tuple[Vector, Vector]:
        """Return the shares of speed and turning after times of moving [s], each of shape (n,)."""
        if not self.bouts:
            return np.ones_like(moved_s), np.ones_like(moved_s)
        durations_s, speed_rel, turn_rel = np.array(self.bouts).T
        ends_s = np.cumsum(durations_s)
        knots_s = np.stack([ends_s - durations_s + _BOUT_EASE_S, ends_s], axis=1).ravel()
        speed, turning = (
            np.interp(moved_s, knots_s, np.repeat(shares, 2), period=ends_s[-1])
            for shares in (speed_rel, turn_rel)
        )
        return speed, turning

    def _hop_m(self, shank_m: float, cycles: Vector) -> Vector:
        """Return by how much the legs are longer than in a stance [m], shape (n,): they fold, push, and draw in."""
        phase = np.mod(cycles, 1.0)
        shape = np.interp(phase, [0.0, 0.35, 0.47, 0.6, 1.0], [0.0, -0.6, 1.0, -0.3, 0.0])
        started = np.clip(cycles, 0.0, 1.0) if len(cycles) else cycles
        way_m: Vector = self.hop_rel * shank_m * shape * started
        return way_m

    def push_n(self, robot: Robot, t_s: Vector, rng: np.random.Generator) -> Vector:
        """Return the pushes against the body at n times [N], shape (n, 3): one after another, to all sides."""
        force_n = np.zeros((len(t_s), 3))
        if not self.push_rel:
            return force_n
        weight_n, start_s = robot.mass_kg * GRAVITY_M_S2, STAND_S
        while start_s < t_s[-1]:
            lasts_s = robot.time_rel * float(np.exp(rng.uniform(*np.log((0.03, 0.5)))))
            around = rng.uniform(0.0, 2.0 * np.pi)
            down = rng.uniform(-0.6, 1.2)
            direction = np.array([np.cos(around), np.sin(around), -down])
            size_n = self.push_rel * rng.uniform(0.3, 1.0) * weight_n
            shape = np.sin(np.pi * np.clip((t_s - start_s) / lasts_s, 0.0, 1.0)) ** 2
            force_n += size_n * shape[:, None] * direction
            start_s += lasts_s + robot.time_rel * rng.uniform(0.1, 0.6)
        return force_n


def _steps(speed: Vector, turning: Vector) -> Vector:
    """Return how high the feet are lifted [1], shape (n, 1): a robot that stands does not step."""
    return np.clip(2.0 * np.maximum(np.abs(speed), np.abs(turning)), 0.0, 1.0)[:, None]


#: The gaits by name.
GAITS: dict[str, WalkerGait] = {
    gait.name: gait
    for gait in (
        WalkerGait(name="walk", period_s=1.0, duty_rel=0.78, forward_m_s=0.25, footfalls=WAVE),
        WalkerGait(name="trot-slow", period_s=0.7, duty_rel=0.6, forward_m_s=0.3, lift_rel=0.2),
        WalkerGait(name="trot-fast", period_s=0.4, duty_rel=0.54, forward_m_s=0.6, lift_rel=0.25),
        WalkerGait(name="tripod", period_s=0.9, duty_rel=0.58, forward_m_s=0.25),
        WalkerGait(name="tripod-fast", period_s=0.5, duty_rel=0.55, forward_m_s=0.45),
        WalkerGait(name="turn", period_s=0.7, duty_rel=0.6, turn_rad_s=0.7),
        WalkerGait(name="sideways", period_s=0.7, duty_rel=0.6, left_m_s=0.2),
        WalkerGait(name="stand", push_rel=0.35),
        WalkerGait(name="hop", period_s=0.8, hop_rel=0.3),
        WalkerGait(name="landing", drop_rel=0.6),
        WalkerGait(
            name="trot-stops", period_s=0.55, duty_rel=0.6, forward_m_s=0.35, turn_rad_s=0.5, bouts=_STOPS
        ),
        WalkerGait(name="trot-drag", period_s=0.7, duty_rel=0.6, forward_m_s=0.25, lift_rel=_DRAG_REL),
        WalkerGait(
            name="tripod-stops", period_s=0.7, duty_rel=0.58, forward_m_s=0.25, turn_rad_s=0.5, bouts=_STOPS
        ),
        WalkerGait(
            name="tripod-drag", period_s=0.9, duty_rel=0.58, forward_m_s=0.2, lift_rel=_HEXAPOD_DRAG_REL
        ),
        # Gaits of selection, and gaits of judgement: none is like one of the above, nor of the other part.
        WalkerGait(
            name="pace",
            period_s=0.36,
            duty_rel=0.56,
            forward_m_s=0.3,
            lift_rel=0.2,
            footfalls=PACE,
        ),
        WalkerGait(
            name="gallop",
            period_s=0.4,
            duty_rel=0.5,
            forward_m_s=0.5,
            footfalls=GALLOP,
        ),
        WalkerGait(name="crawl", period_s=1.4, duty_rel=0.89, forward_m_s=0.15, footfalls=WAVE),
        WalkerGait(
            name="ripple",
            period_s=0.9,
            duty_rel=0.68,
            forward_m_s=0.25,
            footfalls=RIPPLE,
        ),
        WalkerGait(name="tripod-long", period_s=0.9, duty_rel=0.72, forward_m_s=0.25),
        WalkerGait(
            name="gallop-stops",
            period_s=0.5,
            duty_rel=0.6,
            forward_m_s=0.3,
            turn_rad_s=0.5,
            footfalls=GALLOP,
            bouts=_STOPS,
        ),
        WalkerGait(
            name="ripple-stops",
            period_s=0.7,
            duty_rel=0.68,
            forward_m_s=0.25,
            turn_rad_s=0.6,
            footfalls=RIPPLE,
            bouts=_STOPS,
        ),
        WalkerGait(
            name="pace-drag", period_s=0.8, duty_rel=0.7, forward_m_s=0.2, lift_rel=_DRAG_REL, footfalls=PACE
        ),
        WalkerGait(
            name="ripple-drag",
            period_s=0.9,
            duty_rel=0.68,
            forward_m_s=0.2,
            lift_rel=_HEXAPOD_DRAG_REL,
            footfalls=RIPPLE,
        ),
        WalkerGait(
            name="bound",
            period_s=0.4,
            duty_rel=0.55,
            forward_m_s=0.4,
            footfalls=Footfalls(quadruped=(0.5, 0.0, 0.5, 0.0)),
        ),
        WalkerGait(name="amble", period_s=0.6, duty_rel=0.64, forward_m_s=0.35, footfalls=WAVE),
        WalkerGait(
            name="diagonal-walk",
            period_s=0.8,
            duty_rel=0.72,
            forward_m_s=0.25,
            footfalls=DIAGONAL_WALK,
        ),
        WalkerGait(
            name="rotary-gallop",
            period_s=0.4,
            duty_rel=0.5,
            forward_m_s=0.5,
            footfalls=Footfalls(quadruped=(0.62, 0.0, 0.5, 0.12)),
        ),
        WalkerGait(
            name="tetrapod",
            period_s=0.8,
            duty_rel=0.66,
            forward_m_s=0.28,
            footfalls=TETRAPOD,
        ),
        WalkerGait(
            name="front-wave",
            period_s=1.0,
            duty_rel=0.8,
            forward_m_s=0.2,
            footfalls=Footfalls(hexapod=(0.0, 1 / 6, 2 / 6, 3 / 6, 4 / 6, 5 / 6)),
        ),
        WalkerGait(
            name="pairs",
            period_s=0.8,
            duty_rel=0.7,
            forward_m_s=0.25,
            footfalls=PAIRS,
        ),
        WalkerGait(
            name="diagonal-stops",
            period_s=0.6,
            duty_rel=0.68,
            forward_m_s=0.3,
            turn_rad_s=0.6,
            footfalls=DIAGONAL_WALK,
            bouts=_OTHER_STOPS,
        ),
        WalkerGait(
            name="tetrapod-stops",
            period_s=0.6,
            duty_rel=0.66,
            forward_m_s=0.28,
            turn_rad_s=0.7,
            footfalls=TETRAPOD,
            bouts=_OTHER_STOPS,
        ),
        WalkerGait(
            name="diagonal-drag",
            period_s=0.8,
            duty_rel=0.72,
            forward_m_s=0.25,
            lift_rel=_DRAG_REL,
            footfalls=DIAGONAL_WALK,
        ),
        WalkerGait(
            name="tetrapod-drag",
            period_s=0.8,
            duty_rel=0.66,
            forward_m_s=0.28,
            lift_rel=_HEXAPOD_DRAG_REL,
            footfalls=TETRAPOD,
        ),
    )
}
