"""One run of a walking robot in MuJoCo, and its log: what each foot feels, a thousand times a second.

Needs the extra `walkers`. The feet are rigid balls on a ground with a time constant; what rubber does to the readings
is the work of the foot's model, which gets these forces.
"""

from pathlib import Path
from typing import Any, NamedTuple

import mujoco
import numpy as np

from footsense.errors import ConfigError
from footsense.frames import Vector
from footsense.lab.walkers.gaits import GAITS, STAND_S, WalkerGait
from footsense.lab.walkers.robots import GRAVITY_M_S2, N_ROUGH, ROBOTS, ROUGH_SIZE_REL, GroundModel, Robot
from footsense.sim.loads.load_log import peak_n, read_log_arrays

#: Step of the physics and of a log [s].
STEP_S, LOG_STEP_S = 5e-4, 1e-3
#: Lean of a body that has fallen, cosine; height over that of a stance, from which it lies on the ground [1].
_FALLEN_COS, _FALLEN_HEIGHT_REL = 0.4, 0.3
#: Shortest swing before a touch that counts [s].
_LEAST_SWING_S = 0.03
#: From one fall of a landing robot to its next [s].
_LANDING_PERIOD_S = 1.2
#: Step of differences of the feet's places [m].
_DIFFERENCE_M = 1e-5
#: Share of a leg's load that its drives carry beforehand [1]: a controller does not know its robot exactly.
_GRAVITY_SHARE = (0.7, 1.0)
#: Correlation length of rough ground over the shank [1].
_ROUGH_LENGTH_REL = 0.5


#: Mass of the outer rubber half of a ball of 10 mm radius [kg], and that radius [mm].
_OUTER_HALF_KG, _OUTER_HALF_MM = 2.3e-3, 10.0


class FallError(ConfigError):
    """The robot falls."""


class WalkerLog(NamedTuple):
    """What the feet of one run feel, foot frame, at every `LOG_STEP_S`.

    Attributes:
        legs: Names of the legs.
        t_s: Times [s], shape (n,).
        force_n: Ground reaction on each foot [N], shape (n, legs, 3); zero in the air.
        normal: Inward unit normal of the ball at the contact, shape (n, legs, 3); up in the air. The contact point is
            that far from the ball's middle against it, by one radius.
        slip_m_s: Velocity of the contact point along the ground [m/s], shape (n, legs, 3); zero in the air.
        acceleration_m_s2: Acceleration of the foot, gravity included [m/s2], shape (n, legs, 3).
        friction: Coefficient of friction of the ground.
    """

    legs: tuple[str, ...]
    t_s: Vector
    force_n: Vector
    normal: Vector
    slip_m_s: Vector
    acceleration_m_s2: Vector
    friction: float

    def peak_n(self) -> float:
        """Return the force that one in a thousand loaded samples exceeds [N]."""
        return peak_n(self.force_n)

    def inertial_n(self, ball_radius_mm: float) -> Vector:
        """Return what the sensors feel of the foot's own mass in the air, tared hanging at rest [N], as `force_n`.

        Args:
            ball_radius_mm: Radius of the foot's ball [mm], for its mass.
        """
        kg = _OUTER_HALF_KG * (ball_radius_mm / _OUTER_HALF_MM) ** 3
        in_air = ~self.force_n.any(axis=2, keepdims=True)
        inertial_n: Vector = np.where(in_air, -kg * (self.acceleration_m_s2 - (0.0, 0.0, GRAVITY_M_S2)), 0.0)
        return inertial_n

    def n_touches(self) -> int:
        """Return how often a foot touches the ground, after some time in the air."""
        n_touches = 0
        for leg in range(len(self.legs)):
            loaded = np.concatenate([[True], self.force_n[:, leg].any(axis=1)])
            edges = np.diff(loaded.astype(int))
            left, touched = np.flatnonzero(edges < 0), np.flatnonzero(edges > 0)
            swings = touched - left[: len(touched)]
            n_touches += int((swings > _LEAST_SWING_S / LOG_STEP_S).sum())
        return n_touches

    def save(self, path: Path) -> None:
        """Write the log as a compressed file of numpy arrays, in single precision but for the times.

        Raises:
            OSError: It cannot be written.
        """
        arrays: dict[str, Any] = {
            name: part.astype(np.float32) if getattr(part, "ndim", 0) > 1 else np.array(part)
            for name, part in self._asdict().items()
        }
        with path.open("wb") as file:
            np.savez_compressed(file, **arrays)

    @classmethod
    def load(cls, path: Path) -> "WalkerLog":
        """Return the log of a file that `save` wrote.

        Raises:
            ConfigError: It is no such file.
        """
        arrays = read_log_arrays(path, cls._fields)
        legs, friction = arrays.pop("legs").tolist(), float(arrays.pop("friction"))
        parts = {name: part.astype(np.float64) for name, part in arrays.items()}
        return cls(**parts, legs=tuple(legs), friction=friction)


class BodyLog(NamedTuple):
    """How the body and the joints of one run move, at every `LOG_STEP_S`.

    Attributes:
        position_m: Place of the body on the ground [m], shape (n, 3).
        rotation: Rotation from the body's frame to the ground's, shape (n, 3, 3).
        velocity_m_s: Velocity of the body in the ground's frame [m/s], shape (n, 3).
        angles_rad: Angles of each leg's joints, as of `Robot.joint_angles_rad` [rad], shape (n, legs, 3).
        torque_n_m: Torques of their drives [N m], same shape.
        clock_s: Time of the gait's clock [s], shape (n,).
    """

    position_m: Vector
    rotation: Vector
    velocity_m_s: Vector
    angles_rad: Vector
    torque_n_m: Vector
    clock_s: Vector


def simulate_walker(
    robot_name: str, gait_name: str, ground: GroundModel, seed: int, duration_s: float
) -> WalkerLog:
    """Return what the feet of a robot feel that walks over a ground; arguments and errors as of `simulate_walk`."""
    return simulate_walk(robot_name, gait_name, ground, seed, duration_s)[0]


def simulate_walk(
    robot_name: str, gait_name: str, ground: GroundModel, seed: int, duration_s: float
) -> tuple[WalkerLog, BodyLog]:
    """Return the logs of a robot that walks over a ground: of its feet, and of its body.

    Args:
        robot_name: One of `ROBOTS`.
        gait_name: One of `GAITS`.
        ground: The ground.
        seed: Seed of rough ground, pushes and start.
        duration_s: Duration after the robot has stood for a moment [s].

    Raises:
        ConfigError: There is no such robot or gait.
        FallError: The robot falls.
    """
    for kind, name, known in (("robot", robot_name, ROBOTS), ("gait", gait_name, GAITS)):
        if name not in known:
            raise ConfigError(f"no {kind} {name!r}: there are {', '.join(known)}")
    robot, gait = ROBOTS[robot_name], GAITS[gait_name]
    rng = np.random.default_rng(seed)
    model = mujoco.MjModel.from_xml_string(robot.mjcf(ground, STEP_S))
    if ground.rough_rel:
        model.hfield_data[:] = _rough_heights(robot, rng).ravel()
    data = mujoco.MjData(model)
    n_settle = round(robot.time_rel * STAND_S / STEP_S)
    n = n_settle + round(duration_s / STEP_S)
    t_s: Vector = np.asarray(STEP_S * np.arange(n), np.float64)
    jitter = 1.0 + 0.03 * rng.normal()
    feet_m = gait.feet_m(robot, jitter * t_s)
    angles: Vector = np.concatenate(
        [robot.joint_angles_rad(leg, feet_m[:, k]) for k, leg in enumerate(robot.legs)], axis=1
    )
    angles = angles + _gravity_angles_rad(robot, gait, feet_m, jitter * t_s, rng.uniform(*_GRAVITY_SHARE))
    push_n = gait.push_n(robot, t_s, rng)
    data.qpos[2] += 1e-3
    data.qpos[7:] = angles[0]
    log, body_log = _Recorder(model, robot, ground.friction), _BodyRecorder()
    moved_m = np.zeros(3)
    every = round(LOG_STEP_S / STEP_S)
    falls = gait.drop_rel * robot.shank_m
    for k in range(n):
        data.ctrl[:] = angles[k]
        data.xfrc_applied[1, :3] = push_n[k]
        if falls and k % round(robot.time_rel * _LANDING_PERIOD_S / STEP_S) == n_settle // 2:
            _lift(data, falls * rng.uniform(0.3, 1.0), rng)
        mujoco.mj_step(model, data)
        stands = data.xmat[1, 8] > _FALLEN_COS and data.qpos[2] > _FALLEN_HEIGHT_REL * robot.height_m
        if not stands:  # nor does a place that is no number
            raise FallError(f"{robot_name} falls in gait {gait_name} after {t_s[k]:.2f} s on this ground")
        if ground.rough_rel:
            moved_m += _keep_on_field(model, data, _cell_m(robot))
        if k % every == 0 and k >= n_settle:
            log.add(data)
            body_log.add(data, moved_m, jitter * t_s[k])
    return log.log(), body_log.log()


def _gravity_angles_rad(robot: Robot, gait: WalkerGait, feet_m: Vector, t_s: Vector, share: float) -> Vector:
    """Return by how much the drives' angles lead for their torques to carry the robot [rad], shape (n, joints)."""
    load_rel = gait.load_shares(robot, t_s)
    leads = []
    for k, leg in enumerate(robot.legs):
        angle = robot.joint_angles_rad(leg, feet_m[:, k])
        moved = [robot.joint_angles_rad(leg, feet_m[:, k] + _DIFFERENCE_M * axis) for axis in np.eye(3)]
        per_m = np.stack([(one - angle) / _DIFFERENCE_M for one in moved], axis=2)
        load_n = share * robot.mass_kg * GRAVITY_M_S2 * load_rel[:, k]
        # Torques of a force at the foot: the transposed inverse of the joints' way per way of the foot.
        torque = np.linalg.solve(per_m.transpose(0, 2, 1), -load_n[:, None, None] * np.eye(3)[2][:, None])[
            ..., 0
        ]
        leads.append(torque / robot.joint_stiffness_n_m)
    return np.concatenate(leads, axis=1)


def _lift(data: Any, height_m: float, rng: np.random.Generator) -> None:
    """Set the body above where it stands, somewhat tilted and moving, to fall."""
    data.qpos[2] += height_m
    data.qvel[:] = 0.0
    data.qvel[:2] = 0.3 * np.sqrt(height_m) * rng.normal(size=2)
    data.qvel[3:6] = 0.3 * rng.normal(size=3)


def _cell_m(robot: Robot) -> float:
    """Return the distance of two points of a rough ground [m]."""
    return 2.0 * ROUGH_SIZE_REL * robot.shank_m / (N_ROUGH - 1)


def _keep_on_field(model: Any, data: Any, cell_m: float) -> Vector:
    """Set robot and ground back together before the robot comes to the field's edge: its heights are periodic.

    Returns:
        The way by which they were set back [m], shape (3,).
    """
    cells = np.rint(data.qpos[:2] / cell_m).astype(int)
    if np.abs(cells).max() < N_ROUGH // 4:
        return np.zeros(3)
    data.qpos[:2] -= cell_m * cells
    heights = model.hfield_data.reshape(N_ROUGH, N_ROUGH)
    model.hfield_data[:] = np.roll(heights, (-cells[1], -cells[0]), (0, 1)).ravel()
    return cell_m * np.array([*cells, 0.0])


def _rough_heights(robot: Robot, rng: np.random.Generator) -> Vector:
    """Return the heights of rough ground over twice its half height, flat where the robot starts, 0 to 1."""
    n, cell_m = N_ROUGH, _cell_m(robot)
    frequency = np.hypot(np.fft.fftfreq(n, cell_m)[:, None], np.fft.rfftfreq(n, cell_m))
    smooth = np.exp(-0.5 * (2.0 * np.pi * frequency * _ROUGH_LENGTH_REL * robot.shank_m / 2.0) ** 2)
    heights = np.fft.irfft2(np.fft.rfft2(rng.normal(size=(n, n))) * smooth, s=(n, n))
    heights /= 3.0 * heights.std()
    place = cell_m * (np.arange(n) - n / 2.0)
    apart = np.hypot(place[:, None], place) / (1.5 * robot.body_half_m[0])
    heights *= np.clip(apart - 1.0, 0.0, 1.0)
    return np.asarray(np.clip(0.5 + 0.5 * heights, 0.0, 1.0))


def _cross(one: Vector, other: Vector) -> Vector:
    """Return the cross product of two vectors; numpy's would take a third of the time of a run."""
    (a, b, c), (x, y, z) = one.tolist(), other.tolist()
    return np.array([b * z - c * y, c * x - a * z, a * y - b * x])


class _Recorder:
    """Collects what the feet feel."""

    def __init__(self, model: Any, robot: Robot, friction: float) -> None:
        self._model, self._friction = model, friction
        self._names = tuple(robot.legs)
        self._bodies = [model.body(leg).id for leg in robot.legs]
        self._row = {model.geom(leg).id: row for row, leg in enumerate(robot.legs)}
        self._rows: list[tuple[float, Vector]] = []
        self._wrench, self._velocity = np.zeros(6), np.zeros(6)

    def add(self, data: Any) -> None:
        """Add the present step."""
        model, n_legs = self._model, len(self._names)
        felt = np.zeros((4, n_legs, 3))
        mujoco.mj_rnePostConstraint(model, data)
        for row, body in enumerate(self._bodies):
            mujoco.mj_objectAcceleration(model, data, mujoco.mjtObj.mjOBJ_BODY, body, self._velocity, 1)
            felt[3, row] = self._velocity[3:]
        for number in range(data.ncon):
            contact = data.contact[number]
            if contact.geom2 not in self._row:
                continue
            row = self._row[contact.geom2]
            mujoco.mj_contactForce(model, data, number, self._wrench)
            if self._wrench[0] <= 0.0:
                continue
            frame, body = contact.frame.reshape(3, 3), self._bodies[row]
            to_foot = data.xmat[body].reshape(3, 3).T
            force_n = to_foot @ frame.T @ self._wrench[:3]
            felt[0, row] += force_n
            felt[1, row] += self._wrench[0] * (to_foot @ frame[0])
            mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_BODY, body, self._velocity, 0)
            at = self._velocity[3:] + _cross(self._velocity[:3], contact.pos - data.xpos[body])
            at -= (at @ frame[0]) * frame[0]
            felt[2, row] += self._wrench[0] * (to_foot @ at)
        pressing_n = np.linalg.norm(felt[1], axis=1, keepdims=True)
        loaded = pressing_n > 0.0
        felt[2] = np.where(loaded, felt[2] / np.maximum(pressing_n, 1e-12), 0.0)
        felt[1] = np.where(loaded, felt[1] / np.maximum(pressing_n, 1e-12), (0.0, 0.0, 1.0))
        self._rows.append((data.time, felt))

    def log(self) -> WalkerLog:
        """Return the log."""
        felt = np.stack([felt for _, felt in self._rows])
        t_s = np.array([time for time, _ in self._rows])
        return WalkerLog(
            self._names, t_s - t_s[0], felt[:, 0], felt[:, 1], felt[:, 2], felt[:, 3], self._friction
        )


class _BodyRecorder:
    """Collects how the body moves."""

    def __init__(self) -> None:
        self._rows: list[tuple[Vector, ...]] = []

    def add(self, data: Any, moved_m: Vector, clock_s: float) -> None:
        """Add the present step of a robot that was set back by a way [m], at a time of the gait's clock [s]."""
        rotation = np.zeros(9)
        mujoco.mju_quat2Mat(rotation, data.qpos[3:7])
        n_legs = (data.qpos.size - 7) // 3
        angles_rad, torque_n_m = (part.reshape(n_legs, 3) for part in (data.qpos[7:], data.actuator_force))
        velocity_m_s = data.qvel[:3]
        moves = (
            data.qpos[:3] + moved_m,
            rotation.reshape(3, 3),
            velocity_m_s,
            angles_rad,
            torque_n_m,
        )
        self._rows.append((*(np.array(part) for part in moves), np.array(clock_s)))

    def log(self) -> BodyLog:
        """Return the log."""
        return BodyLog(*(np.stack(part) for part in zip(*self._rows, strict=True)))
