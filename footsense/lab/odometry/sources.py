"""What a robot may know of its footholds: from the truth, from footsense, and from what robots have in its place.

Loads are in shares of a leg's load when the robot stands. The thresholds of the sensors are the best of a few on walks
of seed 300, of five of the page's eight kinds; that of the torques is the cheap sensor's.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from footsense.frames import Mask, Vector
from footsense.lab.odometry.walk import STEP_S, OdometryWalk, ReceivedForces, Senses
from footsense.lab.walkers.gaits import GAITS, STAND_S

#: Share of the peak load from which a touch is true [1].
_TOUCH_REL = 0.01
#: Loads from which a foot is taken as down: good and cheap one-axis sensor, joint torques [1].
_GOOD_DOWN, _CHEAP_DOWN, _TORQUE_DOWN = 0.5, 0.4, 0.4
#: Friction in the joints over the peak torque [1], speed at which it is full [rad/s], and noise over that torque [1].
_JOINT_FRICTION_REL, _JOINT_SPEED_RAD_S, _TORQUE_NOISE_REL = 0.05, 0.05, 0.02
#: Seeds of the sensors' errors.
_GOOD_SEED, _CHEAP_SEED, _TORQUE_SEED = 3, 4, 5
_DIFFERENCE_RAD = 1e-5


class Loads(NamedTuple):
    """Loads of the feet in each of n steps, and how close they are to sliding, for `foothold_noise`.

    Attributes:
        load_rel: Load in shares of that in a stand [1], shape (n, legs).
        ratio_rel: Tangential over normal force, over the friction [1], same shape.
    """

    load_rel: Vector
    ratio_rel: Vector


class VectorForces(NamedTuple):
    """Published forces, whose load and ratio are by the filter's own attitude.

    Attributes:
        force_n: Forces in the body's frame [N], shape (n, legs, 3), NaN where there is none.
        friction: Coefficient of friction that is assumed [1].
    """

    force_n: Vector
    friction: float


class Holds(NamedTuple):
    """Published probabilities that the feet stand still on the ground.

    Attributes:
        probability: The probabilities [1], shape (n, legs), NaN where there is none.
    """

    probability: Vector


class OneAxis(NamedTuple):
    """A force sensor along the leg.

    Attributes:
        gain: Standard deviation of its gain over the feet [1].
        offset: The same of its offset, in shares of a standing load; it drifts by as much in a minute [1].
        noise: Noise of a reading, in the same shares [1].
        lag_s: Time constant [s].
        seed: Seed of its errors.
    """

    gain: float
    offset: float
    noise: float
    lag_s: float
    seed: int


#: A load cell in the shank, calibrated; and a force-sensing resistor under the sole.
GOOD = OneAxis(0.02, 0.01, 0.01, 0.003, _GOOD_SEED)
CHEAP = OneAxis(0.35, 0.12, 0.05, 0.02, _CHEAP_SEED)

Source = Loads | VectorForces | Holds


def sources(walk: OdometryWalk, senses: Senses, published: Mapping[str, ReceivedForces]) -> dict[str, Source]:
    """Return what is known of the footholds, by where it comes from.

    Args:
        walk: The walk.
        senses: What the robot senses.
        published: What it is told of its feet, by board; the first is the default one.
    """
    true_n, normal = (part[walk.rows[1:]] for part in (walk.feet.force_n, walk.feet.normal))
    pressing_n = (true_n * normal).sum(axis=2)
    along_n = np.linalg.norm(true_n - pressing_n[..., None] * normal, axis=2)
    true_ratio = along_n / np.maximum(pressing_n, 1e-6) / walk.feet.friction
    good, cheap, torque = one_axis(walk, GOOD), one_axis(walk, CHEAP), _by_torques(walk)
    found: dict[str, Source] = {
        "truth, flag": _flag(pressing_n > _TOUCH_REL * walk.feet.peak_n()),
        "truth, weights": Loads(pressing_n / walk.standing_n, true_ratio),
    }
    for board, of_board in published.items():
        force_n = np.einsum("nlij,nlj->nli", senses.rotation, of_board.force_n)
        found[f"`{board}`, contact flag"] = _flag(of_board.contact)
        found[f"`{board}`, holds"] = Holds(of_board.holds)
        found[f"`{board}`, force vector"] = VectorForces(force_n, walk.feet.friction)
        found[f"`{board}`, force vector, friction assumed 0.6"] = VectorForces(force_n, 0.6)
    return found | {
        "good one-axis sensor, threshold": _flag(good > _GOOD_DOWN),
        "good one-axis sensor, weights": _weights(good),
        "cheap one-axis sensor, threshold": _flag(cheap > _CHEAP_DOWN),
        "cheap one-axis sensor, weights": _weights(np.where(cheap > _CHEAP_DOWN, cheap, 0.0)),
        "gait's schedule": _flag(_by_schedule(walk)),
        "joint torques, threshold": _flag(torque > _TORQUE_DOWN),
        "joint torques, weights": _weights(np.where(torque > _TORQUE_DOWN, torque, 0.0)),
    }


def _weights(load_rel: Vector) -> Loads:
    return Loads(load_rel, np.zeros_like(load_rel))


def _flag(down: Mask) -> Loads:
    """Return a flag as loads: a foot that is down is as firm as can be."""
    return _weights(np.where(down, np.inf, 0.0))


def _by_schedule(walk: OdometryWalk) -> Mask:
    """Return whether each foot should be on the ground by the gait's clock, shape (n, legs)."""
    gait, robot = GAITS[walk.run.gait], walk.robot
    moving_s = walk.body.clock_s[walk.rows[1:], None] - robot.time_rel * STAND_S
    phase = np.mod(moving_s / (robot.time_rel * gait.period_s) - gait.phases(robot), 1.0)
    return np.asarray((phase < gait.duty_rel) | (moving_s <= 0.0))


def one_axis(walk: OdometryWalk, sensor: OneAxis) -> Vector:
    """Return what a sensor along each leg reads [1], shape (n, legs): in swing it feels the foot's own mass too."""
    rng = np.random.default_rng((sensor.seed, walk.run.seed))
    felt_n = walk.feet.force_n + walk.feet.inertial_n(1e3 * walk.robot.foot_radius_m)
    felt_rel = felt_n[walk.rows, :, 2] / walk.standing_n
    lagged, share = felt_rel.copy(), 1.0 - np.exp(-STEP_S / sensor.lag_s)
    for row in range(1, len(lagged)):
        lagged[row] = lagged[row - 1] + share * (felt_rel[row] - lagged[row - 1])
    n_legs = lagged.shape[1]
    walks_off = np.cumsum(np.sqrt(STEP_S / 60.0) * rng.normal(size=lagged.shape), axis=0)
    offset = sensor.offset * (rng.normal(size=n_legs) + walks_off)
    gain = 1.0 + sensor.gain * rng.normal(size=n_legs)
    return np.asarray(gain * lagged + offset + sensor.noise * rng.normal(size=lagged.shape))[1:]


def _by_torques(walk: OdometryWalk) -> Vector:
    """Return the vertical loads by the drives' torques [1], shape (n, legs), of legs without mass."""
    rng, rows = np.random.default_rng((_TORQUE_SEED, walk.run.seed)), walk.rows[1:]
    torque, angles_rad = walk.body.torque_n_m[rows], walk.body.angles_rad[rows]
    peak = np.percentile(np.abs(torque), 99)
    rubs = np.tanh(np.gradient(angles_rad, STEP_S, axis=0) / _JOINT_SPEED_RAD_S)
    torque = torque + peak * (_JOINT_FRICTION_REL * rubs + _TORQUE_NOISE_REL * rng.normal(size=torque.shape))
    up = walk.rotation[1:, 2]
    load_n = []
    for leg, name in enumerate(walk.robot.legs):
        moved = [
            walk.robot.foot_poses(name, angles_rad[:, leg] + sign * _DIFFERENCE_RAD * axis)[0]
            for axis in np.eye(3)
            for sign in (1.0, -1.0)
        ]
        per_rad = np.stack([moved[k] - moved[k + 1] for k in (0, 2, 4)], axis=2) / (2.0 * _DIFFERENCE_RAD)
        # A force on the foot makes the torques of the transposed Jacobian; the drives hold against them.
        force_n = np.linalg.solve(per_rad.transpose(0, 2, 1), -torque[:, leg, :, None])[..., 0]
        load_n.append((force_n * up).sum(axis=1))
    return np.asarray(np.stack(load_n, axis=1) / walk.standing_n)
