"""Feet of footsense in Isaac Lab: what its ContactSensor measures goes in, what footsense would publish comes out.

In Isaac Lab's environment, in the clone of footsense: pip install -e deploy/client -e '.[simulators]'; in your task:
    self.soft = SoftFeet(self.scene["contact_forces"], foot_ids, "hexapod-2kg", like=robot.data.body_quat_w)
    force_n, sigma_n, usable = self.soft.step(self.step_dt, robot.data.body_quat_w[:, body_ids])  # each policy step
    self.soft.reset(env_ids)  # in _reset_idx

Shapes are those of `isaaclab.sensors.ContactSensorData`: of N environments and B bodies the normal force, (N, B, 3),
`net_forces_w` in 2.3, `net_normal_forces_w` in 3.0; of M filters, with `track_friction_forces`, friction, (N, B, M, 3),
`friction_forces_w` in 2.3, `friction_force_matrix_w` in 3.0. A quaternion is (w, x, y, z) in 2.3, (x, y, z, w) in 3.0.
The axes of the bodies are taken for those of the feet: x forward, y left, z along the leg towards the robot's body.
"""

from typing import Any

try:
    import numpy as np
    from array_api_compat import array_namespace
except ImportError as error:
    raise ImportError(
        f"{error}; in the clone of footsense: pip install -e deploy/client -e '.[simulators]'"
    ) from None
from footsense.sim import Variation, VirtualFeet

Tensor = Any


class SoftFeet:
    """The feet of all environments; in each those bodies of the sensor that `foot_ids` has."""

    def __init__(self, sensor: Tensor, foot_ids: list[int], foot_type: str, like: Tensor) -> None:
        self.sensor, self.foot_ids, self.shape, self.t_s = sensor, foot_ids, (len(like), len(foot_ids)), 0.0
        varied = Variation(delay_s=(0.0, 3e-3), noise_rel=(0.8, 1.5), gain_rel=0.01)
        n_feet, seeds = len(like) * len(foot_ids), np.arange(len(like))
        self.feet = VirtualFeet(n_feet, foot_type, variation=varied, seed=seeds, like=like)

    def step(self, step_s: float, quat_w: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Return force and sigma, (N, feet, 3) in the frame of each foot, and whether it is usable, (N, feet).

        Raises:
            ValueError: The sensor has no friction.
        """
        xp, data, self.t_s = array_namespace(quat_w), self.sensor.data, self.t_s + step_s
        is_3 = hasattr(data, "net_normal_forces_w")
        normal_n = (data.net_normal_forces_w if is_3 else data.net_forces_w)[:, self.foot_ids]
        friction_n = getattr(data, "friction_force_matrix_w" if is_3 else "friction_forces_w", None)
        if friction_n is None:
            raise ValueError("no friction: set track_friction_forces of the ContactSensor, and its filters")
        w, axis = (quat_w[..., 3:], quat_w[..., :3]) if is_3 else (quat_w[..., :1], quat_w[..., 1:])
        size_n = xp.linalg.vector_norm(normal_n, axis=-1, keepdims=True)
        known_n = xp.where(xp.isnan(friction_n), 0.0, friction_n)  # NaN where nothing touches
        force_n = normal_n + xp.sum(known_n, axis=2)[:, self.foot_ids] * (size_n > 0.0)
        normal = normal_n / xp.where(size_n > 0.0, size_n, xp.ones_like(size_n))

        def in_foot(vector: Tensor) -> Tensor:
            twice = 2.0 * xp.linalg.cross(axis, vector)
            return xp.reshape(vector - w * twice + xp.linalg.cross(axis, twice), (-1, 3))

        forces = self.feet.step(self.t_s, in_foot(force_n), in_foot(normal))
        force_n, sigma_n = (xp.reshape(part, (*self.shape, 3)) for part in forces[:2])
        return force_n, sigma_n, xp.reshape(forces.usable, self.shape)

    def reset(self, env_ids: Tensor) -> None:
        """Give some environments other feet, in the air and tared."""
        feet = np.zeros(self.shape, bool)
        feet[np.asarray(env_ids.cpu() if hasattr(env_ids, "cpu") else env_ids)] = True
        self.feet.reset(feet.reshape(-1))
