"""Open-loop gaits of the walking robots: where each foot should be over time, and what pushes the body.

A foot follows its own clock: in stance it moves back under the body at the speed of the gait, in swing it is lifted and
brought forward. Times are those of a robot with a shank of 0.21 m; smaller robots step faster (`Robot.time_rel`).
"""

from dataclasses import dataclass

import numpy as np

from footsense.frames import Vector
from footsense.lab.walkers.robots import GRAVITY_M_S2, Robot

#: Time in which a robot stands before it moves [s], and in which a gait comes to its full stride [s].
STAND_S, _EASE_S = 0.6, 0.8
#: Share of a stance in which a leg takes its load, and in which it gives it back [1].
_LOAD_FLANK = 0.15


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
        wave: Whether one leg steps after the other; else the legs of a group step together.
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
    wave: bool = False
    hop_rel: float = 0.0
    drop_rel: float = 0.0
    push_rel: float = 0.0

    def phases(self, robot: Robot) -> Vector:
        """Return the phase of each leg's touchdown within the period [1], shape (legs,)."""
        if not self.wave:
            return np.array([0.5 * place.group for place in robot.legs.values()])
        order = (
            ("lr", "lf", "rr", "rf") if robot.kind == "quadruped" else ("lr", "lm", "lf", "rr", "rm", "rf")
        )
        return np.array([order.index(leg) / len(order) for leg in robot.legs])

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
        of_leg_m_s = velocity_m_s + turn_rad_s * neutral_m[:, [1, 0]] * np.array([-1.0, 1.0])
        stride_m = self.duty_rel * period_s * of_leg_m_s
        feet_m[:, :, :2] += (eased * ahead)[:, :, None] * stride_m
        feet_m[:, :, 2] += (
            self.lift_rel * shank_m * np.clip(2.0 * eased, 0.0, 1.0) * np.sin(np.pi * swing) ** 2
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
        carries = np.where(moving_s > 0.0, np.clip(edge, 0.0, 1.0), 1.0)
        return np.asarray(carries / np.maximum(carries.sum(axis=1, keepdims=True), 1.0))

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


#: The gaits by name.
GAITS: dict[str, WalkerGait] = {
    gait.name: gait
    for gait in (
        WalkerGait(name="walk", period_s=1.0, duty_rel=0.78, forward_m_s=0.25, wave=True),
        WalkerGait(name="trot-slow", period_s=0.7, duty_rel=0.6, forward_m_s=0.3, lift_rel=0.2),
        WalkerGait(name="trot-fast", period_s=0.4, duty_rel=0.54, forward_m_s=0.6, lift_rel=0.25),
        WalkerGait(name="tripod", period_s=0.9, duty_rel=0.58, forward_m_s=0.25),
        WalkerGait(name="tripod-fast", period_s=0.5, duty_rel=0.55, forward_m_s=0.45),
        WalkerGait(name="turn", period_s=0.7, duty_rel=0.6, turn_rad_s=0.7),
        WalkerGait(name="sideways", period_s=0.7, duty_rel=0.6, left_m_s=0.2),
        WalkerGait(name="stand", push_rel=0.35),
        WalkerGait(name="hop", period_s=0.8, hop_rel=0.3),
        WalkerGait(name="landing", drop_rel=0.6),
    )
}
