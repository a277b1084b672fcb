"""Open-loop gaits of the walking robots: where each foot should be over time, and what pushes the body.

A foot follows its own clock: in stance it moves back under the body at the speed of the gait, in swing it is lifted and
brought forward. Times are those of a robot with a shank of 0.21 m; smaller robots step faster (`Robot.time_rel`).
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from msgspec import Struct

from footsense.errors import ConfigError
from footsense.frames import Vector
from footsense.lab.walkers.robots import GRAVITY_M_S2, Robot
from footsense.strict_yaml import load

#: Time in which a robot stands before it moves [s], and in which a gait comes to its full stride [s].
STAND_S, _EASE_S = 0.6, 0.8
#: Share of a stance in which a leg takes its load, and in which it gives it back [1].
_LOAD_FLANK = 0.15
#: Time in which a robot comes from the speed of a bout to that of the next [s].
_BOUT_EASE_S = 0.4


class Bout(NamedTuple):
    """Part of a walk: duration [s], and shares of the gait's speed [1] and turning [1]; of none, it stands."""

    duration_s: float
    speed_rel: float
    turn_rel: float


class WalkerGait(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """An open-loop gait; times and speeds of a robot with a shank of 0.21 m.

    Attributes:
        name: Its name.
        period_s: From one step of a foot to its next [s].
        duty_rel: Share of the period on the ground [1].
        forward_m_s: Speed forward [m/s].
        left_m_s: Speed to the left [m/s].
        turn_rad_s: Speed of turning to the left [rad/s].
        lift_rel: Height of a swing over the shank [1].
        footfalls: Name of the phases of the legs in the table.
        bouts: Name of its bouts in the table, over and over; empty for the gait's own speed all the time.
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
    footfalls: str = "diagonal"
    bouts: str = ""
    hop_rel: float = 0.0
    drop_rel: float = 0.0
    push_rel: float = 0.0

    def phases(self, robot: Robot) -> Vector:
        """Return the phase of each leg's touchdown within the period [1], shape (legs,).

        Raises:
            ConfigError: Robots of this kind have no such gait.
        """
        footfalls = _TABLE.footfalls[self.footfalls]
        if robot.kind not in footfalls:
            raise ConfigError(f"a {robot.kind} has no gait {self.name!r}")
        return np.array(footfalls[robot.kind])

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
        durations_s, speed_rel, turn_rel = np.array(_TABLE.bouts[self.bouts]).T
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


class _Table(Struct, frozen=True, forbid_unknown_fields=True):
    """The table of gaits: phases of the legs by name and kind of robot, bouts by name, and the gaits."""

    footfalls: dict[str, dict[str, tuple[float, ...]]]
    bouts: dict[str, tuple[Bout, ...]]
    gaits: tuple[WalkerGait, ...]


#: File of the table.
GAITS_FILE = Path(__file__).with_name("gaits.yaml")
_TABLE = load(GAITS_FILE, _Table)
#: The gaits by name.
GAITS = {gait.name: gait for gait in _TABLE.gaits}
