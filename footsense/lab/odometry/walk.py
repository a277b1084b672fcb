"""What a robot senses of its own walk, for its odometry: IMU, joint angles and the published forces; and the truth.

The IMU is a Bosch BMI088: noise by its data sheet, biases as they are left after a calibration at rest. The forces are
those that the service publishes, as late as a controller has them.
"""

from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np

from footsense.estimation.network import Network
from footsense.foot.network_card import NETWORK_FILE
from footsense.foot.response_table import FootResponse
from footsense.foot.specimen import Specimen
from footsense.foot.type_folders import released_folder
from footsense.frames import Mask, Vector
from footsense.lab.evaluation.evaluate_models import RESPONSE_FILE
from footsense.lab.evaluation.walker_runs import (
    LEAD_IN_S,
    SCAN_TIMES,
    judging_pipeline,
    read_walker,
    run_pipeline,
    walker_loads,
)
from footsense.lab.walkers.robots import GRAVITY_M_S2, ROBOTS
from footsense.lab.walkers.simulate import LOG_STEP_S, BodyLog, WalkerLog, simulate_walk
from footsense.lab.walkers.split import GROUNDS, WalkerRun

#: Step of the odometry [s], and rows of a log in it.
STEP_S, _EVERY = 5e-3, 5
#: Noise of gyro [rad/s/sqrt(Hz)] and accelerometer [m/s2/sqrt(Hz)]; drift of their biases; biases after a calibration.
_GYRO_NOISE, _ACCEL_NOISE, _GYRO_DRIFT, _ACCEL_DRIFT = 2.44e-4, 1.72e-3, 2e-5, 1e-4
_GYRO_BIAS_RAD_S, _ACCEL_BIAS_M_S2 = np.radians(0.05), 0.1
#: Noise of the encoders [rad].
_ENCODER_RAD = np.radians(0.1)
#: Frames of readings of each force that a robot publishes, by board; and time of the frames of six legs on CAN [s].
PUBLISH_EVERY, _CAN_S = {"ad7147": 2, "fdc1004": 4}, 3e-3
#: From one begin of a metre of way to the next, and the first [m].
_METRE_STEP_M, _FIRST_METRE_M = 0.25, 0.1


class Senses(NamedTuple):
    """What a robot senses in each of n steps.

    Attributes:
        gyro: Mean rate of turning in the step [rad/s], shape (n, 3).
        accel: Mean of what the accelerometer reads in it [m/s2], same shape.
        foot_m: Where the feet are at its end, in the body's frame, by the joint angles [m], shape (n, legs, 3).
        turn_rad: By how much each foot turned in the body's frame [rad], same shape.
        rotation: Rotation of each foot's frame to the body's, shape (n, legs, 3, 3).
        accel_at_rest: What the accelerometer reads before the walk [m/s2], shape (3,).
    """

    gyro: Vector
    accel: Vector
    foot_m: Vector
    turn_rad: Vector
    rotation: Vector
    accel_at_rest: Vector


class ReceivedForces(NamedTuple):
    """What a controller has of the feet at the end of each of n steps.

    Attributes:
        force_n: Last published forces, foot frame [N], shape (n, legs, 3); NaN where there is none.
        contact: Whether contact is reported, shape (n, legs).
        holds: Last published probabilities that the feet stand still, same shape; NaN where there is none.
    """

    force_n: Vector
    contact: Mask
    holds: Vector


class OdometryWalk:
    """A walk: its truth at the end of each step, and what the robot senses.

    Args:
        run: The run.

    Attributes:
        run: The run.
        robot: The robot.
        feet: What its feet feel, at every `LOG_STEP_S`.
        body: How it moves, at the same times.
        rows: Rows of these at the begin of the first step, and at the end of each.
        position_m: Places of the body at those [m], shape (n + 1, 3).
        rotation: Its attitudes at those, shape (n + 1, 3, 3).
    """

    def __init__(self, run: WalkerRun) -> None:
        logs = simulate_walk(run.robot, run.gait, GROUNDS[run.ground], run.seed, run.duration_s)
        self.run, self.robot = run, ROBOTS[run.robot]
        self.feet: WalkerLog = logs[0]
        self.body: BodyLog = logs[1]
        self.rows = np.arange(0, len(self.body.position_m), _EVERY)
        self.position_m, self.rotation = self.body.position_m[self.rows], self.body.rotation[self.rows]

    @property
    def standing_n(self) -> float:
        """Load of a leg when the robot stands [N]."""
        return self.robot.mass_kg * GRAVITY_M_S2 / len(self.robot.legs)

    @cached_property
    def way_m(self) -> Vector:
        """Way over the ground until each row [m], shape (n + 1,)."""
        steps_m = np.linalg.norm(np.diff(self.position_m[:, :2], axis=0), axis=1)
        return np.concatenate([[0.0], np.cumsum(steps_m)])

    def senses(self) -> Senses:
        """Return what the robot senses."""
        rng, n = np.random.default_rng((1, self.run.seed)), len(self.rows) - 1
        before, after = self.rotation[:-1], self.rotation[1:]
        gyro = _turn_rad(before.transpose(0, 2, 1) @ after) / STEP_S
        velocity_m_s = self.body.velocity_m_s[self.rows]
        felt_m_s2 = np.diff(velocity_m_s, axis=0) / STEP_S + (0.0, 0.0, GRAVITY_M_S2)
        middle = self.body.rotation[self.rows[:-1] + _EVERY // 2]
        accel = np.einsum("nji,nj->ni", middle, felt_m_s2)
        gyro_bias = _GYRO_BIAS_RAD_S * rng.normal(size=3) + _drift(rng, _GYRO_DRIFT, n)
        accel_bias = _ACCEL_BIAS_M_S2 * rng.normal(size=3) + _drift(rng, _ACCEL_DRIFT, n)
        gyro = gyro + gyro_bias + _GYRO_NOISE / np.sqrt(STEP_S) * rng.normal(size=(n, 3))
        accel = accel + accel_bias + _ACCEL_NOISE / np.sqrt(STEP_S) * rng.normal(size=(n, 3))
        at_rest = self.rotation[0, 2] * GRAVITY_M_S2 + accel_bias[0]
        angles_rad = self.body.angles_rad[self.rows]
        angles_rad = angles_rad + _ENCODER_RAD * rng.normal(size=angles_rad.shape)
        poses = [self.robot.foot_poses(name, angles_rad[:, leg]) for leg, name in enumerate(self.robot.legs)]
        foot_m, turned = (np.stack(part, axis=1) for part in zip(*poses, strict=True))
        turn_rad = _turn_rad(turned[1:] @ turned[:-1].swapaxes(-1, -2))
        return Senses(gyro, accel, foot_m[1:], turn_rad, turned[1:], at_rest)

    def published(self, board: str, models: Path | None = None) -> ReceivedForces:
        """Return what the service publishes of the feet of the robot's own type, the friction known.

        Args:
            board: A key of `SCAN_TIMES`.
            models: Folder of the foot type; None for the released one of the robot's name.
        """
        folder, scan = models or released_folder(self.run.robot), SCAN_TIMES[board]
        response = FootResponse.load(folder / RESPONSE_FILE)
        legs = [None] * len(self.feet.legs)
        pipeline = judging_pipeline(
            Network(folder / NETWORK_FILE, len(legs)), response, scan, legs, friction=self.feet.friction
        )
        loads = walker_loads(self.feet, 1.0, 1e3 * self.robot.foot_radius_m)
        told = run_pipeline(pipeline, read_walker(Specimen(response), loads, self.run.seed, scan=scan))
        t_s = LEAD_IN_S + LOG_STEP_S * self.rows[1:] - _CAN_S
        newest = np.searchsorted(told.t_s, t_s, "right") - 1
        every = PUBLISH_EVERY[board]
        sent = newest // every * every
        return ReceivedForces(told.force_n[sent], told.contact[newest], told.holds[sent])

    def drift_rel(self, position_m: Vector, rotation: Vector) -> Vector:
        """Return the drift of b poses [1]: rms error of the way after a metre, in the body's frame at its begin.

        Args:
            position_m: Places at the rows [m], shape (n + 1, b, 3).
            rotation: Attitudes, shape (n + 1, b, 3, 3).

        Returns:
            Shape (b,); NaN where the way is shorter than a metre.
        """
        begins_m = np.arange(_FIRST_METRE_M, self.way_m[-1] - 1.0, _METRE_STEP_M)
        begin, end = np.searchsorted(self.way_m, begins_m), np.searchsorted(self.way_m, begins_m + 1.0)
        true_m = np.einsum("kji,kj->ki", self.rotation[begin], self.position_m[end] - self.position_m[begin])
        found_m = np.einsum("kbji,kbj->kbi", rotation[begin], position_m[end] - position_m[begin])
        squared = ((found_m - true_m[:, None]) ** 2).sum(axis=2)
        return np.sqrt(squared.mean(axis=0)) if len(begin) else np.full(position_m.shape[1], np.nan)


def _turn_rad(rotation: Vector) -> Vector:
    """Return the vectors of rotations by less than a quarter turn [rad], shape (..., 3)."""
    skew = rotation - rotation.swapaxes(-1, -2)
    twice = np.stack([skew[..., 2, 1], skew[..., 0, 2], skew[..., 1, 0]], axis=-1)
    sine = np.maximum(0.5 * np.linalg.norm(twice, axis=-1, keepdims=True), 1e-12)
    turn_rad: Vector = 0.5 * twice * np.arcsin(np.minimum(sine, 1.0)) / sine
    return turn_rad


def _drift(rng: np.random.Generator, rate: float, n: int) -> Vector:
    return np.asarray(rate * np.sqrt(STEP_S) * np.cumsum(rng.normal(size=(n, 3)), axis=0))
