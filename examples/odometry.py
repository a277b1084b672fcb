"""Joint angles, IMU and the forces on the feet in, pose out: how far a robot drifts, by what its feet can sense.

pip install -e deploy/client -e '.[lab]', then: python examples/odometry.py

A right-invariant Kalman filter: R. Hartley, M. Ghaffari, R. M. Eustice, J. W. Grizzle, "Contact-aided invariant
extended Kalman filtering for robot state estimation", Int. J. Robotics Research 39 (2020). All arrays have an axis of n
filters in front, or get it: filters of one robot with n sensors run together.
"""

import argparse
import sys

try:
    import numpy as np
    from numpy.typing import NDArray
except ImportError as error:
    sys.exit(
        f"odometry.py needs {error.name}; in the clone of footsense: pip install -e deploy/client -e '.[lab]'"
    )

Array = NDArray[np.float64]

GRAVITY_M_S2 = np.array([0.0, 0.0, -9.80665])
#: Bosch BMI088, data sheet: noise of gyro [rad/s/sqrt(Hz)] and accelerometer [m/s2/sqrt(Hz)]; drift of their biases.
IMU_NOISE, BIAS_DRIFT = np.repeat((2.44e-4, 1.72e-3), 3), np.repeat((2e-5, 1e-4), 3)
#: Sigma of a foot's place by the joint angles [m]; of the biases, of tilt [rad] and speed at the start [m/s].
FOOT_SIGMA_M, BIAS_SIGMA, TILT_SIGMA, SPEED_SIGMA_M_S = 5e-4, np.repeat((9e-4, 0.1), 3), 0.1, 0.02
#: Noise of a firm foothold, and of a foot in the air [m/s/sqrt(Hz)]; sigma of a foothold that is set down anew [m].
FIRM, IN_AIR, ANYWHERE_M = 0.003, 10.0, 1.0
#: Matrices of the cross products with x, y and z.
CROSS = -np.cross(np.eye(3)[:, None], np.eye(3))


def rotations(turn_rad: Array) -> tuple[Array, Array]:
    """Return the rotations by vectors [rad], shape (..., 3, 3), and their left Jacobians."""
    angle = np.maximum(np.linalg.norm(turn_rad, axis=-1), 1e-9)[..., None, None]
    once = np.tensordot(turn_rad, CROSS, 1)
    twice, halved = once @ once, (1.0 - np.cos(angle)) / angle**2
    rotation = np.eye(3) + np.sin(angle) / angle * once + halved * twice
    return rotation, np.eye(3) + halved * once + (angle - np.sin(angle)) / angle**3 * twice


def foothold_noise(load_rel: Array, ratio_rel: Array | float = 0.0) -> Array:
    """Return how firm footholds are [m/s/sqrt(Hz)]: a foot with little load, or near its friction cone, may slide.

    Args:
        load_rel: Load over the load of a leg when the robot stands [1].
        ratio_rel: Tangential over normal force, over the coefficient of friction [1].
    """
    # Not the contact flag: it is set as soon as a foot grazes the ground, and while it slides; drift grows tenfold.
    noise = (1.0 + (0.5 / np.maximum(load_rel, 1e-3)) ** 2) * (1.0 + 10.0 * np.minimum(ratio_rel, 5.0) ** 8)
    return np.where(load_rel > 0.1, np.minimum(FIRM * noise, IN_AIR), IN_AIR)


def load_and_ratio(force_n: Array, rotation: Array) -> tuple[Array, Array]:
    """Return the vertical parts of forces [N], and horizontal over vertical part [1], both of shape (n, legs).

    Args:
        force_n: Forces in the body's frame [N], shape (n, legs, 3); NaN where there is none.
        rotation: Rotation from that frame to the world's, shape (n, 3, 3).
    """
    x, y, z = np.moveaxis(np.nan_to_num(force_n) @ rotation.swapaxes(-1, -2), -1, 0)
    return z, np.hypot(x, y) / np.maximum(z, 1e-6)


class Odometry:
    """Pose of a robot that stood still at first.

    Args:
        accel_m_s2: What its accelerometer reads then [m/s2], shape (n, 3).
        n_legs: Number of legs.
        foot_radius_m: Radius of the balls under its feet, which roll [m].
        gate: Largest squared innovation of a foothold; beyond, it is set down anew. 16.3 is 1 in 1000.

    Attributes:
        rotation: Rotation from the body's frame to the world's, shape (n, 3, 3).
        columns: Velocity [m/s], position and footholds [m] in the world, shape (n, 2 + legs, 3).
        bias: Of gyro [rad/s] and accelerometer [m/s2], shape (n, 6).
        covariance: Of their errors: turn, columns, bias.
    """

    def __init__(
        self, accel_m_s2: Array, n_legs: int, foot_radius_m: float, gate: Array | float = np.inf
    ) -> None:
        n, up = len(accel_m_s2), accel_m_s2 / np.linalg.norm(accel_m_s2, axis=1, keepdims=True)
        x = np.array([1.0, 0.0, 0.0]) - up[:, :1] * up
        x /= np.linalg.norm(x, axis=1, keepdims=True)
        self.rotation = np.stack([x, np.cross(up, x), up], axis=1)
        self.columns, self.bias = np.zeros((n, 2 + n_legs, 3)), np.zeros((n, 6))
        at_first = [TILT_SIGMA] * 2 + [1e-4] + [SPEED_SIGMA_M_S] * 3 + [1e-4] * 3
        sigma = np.concatenate([at_first, np.full(3 * n_legs, ANYWHERE_M), BIAS_SIGMA])
        self.covariance = np.tile(np.diag(sigma**2), (n, 1, 1))
        self._radius_m, self._gate = foot_radius_m, np.broadcast_to(gate, n)[:, None]

    def step(
        self, dt_s: float, gyro: Array, accel: Array, foot_m: Array, turn_rad: Array, noise: Array
    ) -> None:
        """Go on by a step.

        Args:
            dt_s: Its duration [s].
            gyro: Rate of turning [rad/s], shape (n, 3).
            accel: What the accelerometer reads [m/s2], same shape.
            foot_m: Where the balls' middles are then, in the body's frame, by the joint angles [m], shape (n, legs, 3).
            turn_rad: By how much each foot turned in the body's frame [rad], same shape.
            noise: As of `foothold_noise`, shape (n, legs).
        """
        n, size = len(noise), self.covariance.shape[1]
        gyro, accel = gyro - self.bias[:, :3], accel - self.bias[:, 3:]
        # How errors grow: in the world's frame they do so in the same way at every pose, but for those of the biases.
        input_ = np.zeros((n, size, 6))
        turned = -dt_s * np.tensordot(self.columns, CROSS, 1) @ self.rotation[:, None]
        input_[:, :3, :3] = input_[:, 3:6, 3:] = -dt_s * self.rotation
        input_[:, 3:-6, :3], input_[:, 6:9, 3:] = turned.reshape(n, -1, 3), -0.5 * dt_s**2 * self.rotation
        falls = dt_s * np.tensordot(GRAVITY_M_S2, CROSS, 1)

        def grown(rows: Array) -> Array:
            found = rows + input_ @ rows[:, -6:]
            found[:, 3:6] += falls @ rows[:, :3]
            found[:, 6:9] += dt_s * (rows[:, 3:6] + 0.5 * falls @ rows[:, :3])
            return found

        noisy = input_ * IMU_NOISE / np.sqrt(dt_s)
        self.covariance = grown(grown(self.covariance).swapaxes(1, 2)) + noisy @ noisy.swapaxes(1, 2)
        feet = np.arange(9, size - 6)
        self.covariance[:, feet, feet] += dt_s * np.repeat(noise, 3, axis=1) ** 2
        self.covariance[:, -6:, -6:] += np.diag(dt_s * BIAS_DRIFT**2)
        # The state; a ball's middle moves as the ball rolls on the ground.
        before = self.rotation
        self.rotation = before @ rotations(dt_s * gyro)[0]
        accel_m_s2 = np.einsum("nij,nj->ni", 0.5 * (before + self.rotation), accel) + GRAVITY_M_S2
        self.columns[:, 1] += dt_s * self.columns[:, 0] + 0.5 * dt_s**2 * accel_m_s2
        self.columns[:, 0] += dt_s * accel_m_s2
        rolls = (turn_rad + dt_s * gyro[:, None]) @ self.rotation.transpose(0, 2, 1)
        self.columns[:, 2:] += self._radius_m * np.cross(rolls, (0.0, 0.0, 1.0))
        self._correct(foot_m)

    def _correct(self, foot_m: Array) -> None:
        n, n_legs = len(self.rotation), self.columns.shape[1] - 2
        feet, legs = 9 + np.arange(3 * n_legs), np.arange(n_legs)
        off_m = foot_m @ self.rotation.transpose(0, 2, 1) + self.columns[:, 1:2] - self.columns[:, 2:]
        with_feet = self.covariance[:, :, 9:-6] - np.tile(self.covariance[:, :, 6:9], n_legs)
        innovation = with_feet[:, 9:-6] - np.tile(with_feet[:, 6:9], (1, n_legs, 1))
        innovation[:, feet - 9, feet - 9] += FOOT_SIGMA_M**2
        of_legs = innovation.reshape(n, n_legs, 3, n_legs, 3)[:, legs, :, legs].transpose(1, 0, 2, 3)
        squared = np.einsum("nli,nlij,nlj->nl", off_m, np.linalg.inv(of_legs), off_m)
        anew = np.repeat(np.where(squared > self._gate, ANYWHERE_M**2, 0.0), 3, axis=1)
        self.covariance[:, feet, feet] += anew
        with_feet[:, feet, feet - 9] += anew
        innovation[:, feet - 9, feet - 9] += anew
        gain = with_feet @ np.linalg.inv(innovation)
        error = (gain @ off_m.reshape(n, -1, 1))[..., 0]
        covariance = self.covariance - gain @ with_feet.transpose(0, 2, 1)
        self.covariance = 0.5 * (covariance + covariance.transpose(0, 2, 1))
        turn, jacobian = rotations(error[:, :3])
        self.rotation = turn @ self.rotation
        moved = error[:, 3:-6].reshape(n, -1, 3) @ jacobian.transpose(0, 2, 1)
        self.columns, self.bias = self.columns @ turn.transpose(0, 2, 1) + moved, self.bias + error[:, -6:]


def main() -> None:
    """Follow a quadruped that walks in MuJoCo, with its footholds weighted in three ways; print the drifts."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    try:
        from footsense.lab.odometry.sources import GOOD, one_axis
        from footsense.lab.odometry.walk import STEP_S, OdometryWalk
        from footsense.lab.walkers.split import WalkerRun
    except ImportError as error:
        sys.exit(
            f"odometry.py needs {error.name}; in the clone of footsense: pip install -e deploy/client -e '.[lab]'"
        )

    walk = OdometryWalk(WalkerRun("quadruped-12kg", "trot-slow", "flat", seed=1, duration_s=8.0))
    senses, feet, along_leg = walk.senses(), walk.published("ad7147"), one_axis(walk, GOOD)
    force_n = np.einsum("nlij,nlj->nli", senses.rotation, feet.force_n)
    odometry = Odometry(np.tile(senses.accel_at_rest, (3, 1)), len(walk.robot.legs), walk.robot.foot_radius_m)
    position_m, rotation = [odometry.columns[:, 1].copy()], [odometry.rotation]
    for k, (gyro, accel, foot_m, turn_rad) in enumerate(zip(*senses[:4], strict=True)):
        load_n, ratio = load_and_ratio(force_n[k], odometry.rotation[0])
        by_vector = foothold_noise(load_n / walk.standing_n, ratio / walk.feet.friction)
        by_flag = np.where(feet.contact[k], FIRM, IN_AIR)
        noise = np.stack([by_vector, foothold_noise(along_leg[k]), by_flag])
        odometry.step(STEP_S, gyro, accel, foot_m, turn_rad, noise)
        position_m.append(odometry.columns[:, 1].copy())
        rotation.append(odometry.rotation)
    drifts = walk.drift_rel(np.stack(position_m), np.stack(rotation))
    print(f"walked {walk.way_m[-1]:.1f} m; drift per metre of way, with the footholds by")
    for name, drift in zip(("force vectors", "one-axis sensors", "contact flags"), drifts, strict=True):
        print(f"{name}: {drift:.2%}")
    print("one walk; docs/report/odometry.md has 40")


if __name__ == "__main__":
    main()
