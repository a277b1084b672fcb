"""Walking robots for MuJoCo, from a few lengths and a mass: quadrupeds and hexapods in the sizes of the released feet.

A quadruped has the legs of a dog (abduction, hip, knee), a hexapod those of an insect (yaw, hip, knee). A foot is
mounted so that its axis is upright in the middle of a stance. Lengths grow with the cube root of the mass.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from footsense.frames import Vector

#: Standard gravity [m/s2].
GRAVITY_M_S2 = 9.80665
#: Share of a robot's mass in each part of a leg: hip, thigh, shank with foot.
_LEG_MASS_REL = {"quadruped": (0.05, 0.055, 0.012), "hexapod": (0.025, 0.03, 0.008)}
#: Stiffness of a joint over weight times shank [1/rad], and its damping over that stiffness [s], for a shank of 0.2 m.
_JOINT_STIFFNESS_REL, _JOINT_DAMPING_S = {"quadruped": 5.0, "hexapod": 7.5}, 0.022
#: Inertia of a drive at its joint, over mass times shank squared [1].
_ARMATURE_REL = 0.01
#: Damping of a contact over the critical one [1], and depth over which a ball's rubber hardens, over its radius [1]: a
#: contact that is hard from the first touch chatters where a foot slides.
_CONTACT_DAMPING_REL, _SOFT_DEPTH_REL = 1.0, 0.25
#: Half the side of a rough ground over a robot's shank [1], and points along a side.
ROUGH_SIZE_REL, N_ROUGH = 20.0, 160


class LegPlace(NamedTuple):
    """Place of a hip in the body's frame [m], and side (1 left, -1 right)."""

    hip_m: tuple[float, float, float]
    side: int


@dataclass(frozen=True, slots=False, kw_only=True)
class Robot:
    """A robot's description.

    Attributes:
        name: Kind and mass, as `quadruped-12kg`.
        kind: `quadruped` or `hexapod`.
        mass_kg: Mass of the whole robot [kg].
        thigh_m: Hip to knee [m].
        shank_m: Knee to the middle of the foot's ball [m].
        hip_m: From the first joint to the hip: sideways of a quadruped, outward of a hexapod [m].
        height_m: Hip over the middle of the ball in a stance [m].
        reach_m: Of a hexapod, from the first joint outward to the foot [m].
        foot_radius_m: Radius of the ball [m].
        body_half_m: Half of length, width and height of the body [m].
    """

    name: str
    kind: str
    mass_kg: float
    thigh_m: float
    shank_m: float
    hip_m: float
    height_m: float
    reach_m: float
    foot_radius_m: float
    body_half_m: tuple[float, float, float]

    @cached_property
    def legs(self) -> dict[str, LegPlace]:
        """The legs by name, in the order of the arrays."""
        x, y, _ = self.body_half_m
        if self.kind == "quadruped":
            places = {"lf": (x, y, 1), "lr": (-x, y, 1), "rf": (x, -y, -1), "rr": (-x, -y, -1)}
        else:
            wide = 1.2 * y
            places = {
                "lf": (x, y, 1),
                "lm": (0.0, wide, 1),
                "lr": (-x, y, 1),
                "rf": (x, -y, -1),
                "rm": (0.0, -wide, -1),
                "rr": (-x, -y, -1),
            }
        return {name: LegPlace((px, py, 0.0), side) for name, (px, py, side) in places.items()}

    @property
    def time_rel(self) -> float:
        """Time of a movement over that of a robot with a shank of 0.21 m: the root of the length (Froude)."""
        return float(np.sqrt(self.shank_m / 0.21))

    @property
    def joint_stiffness_n_m(self) -> float:
        """Stiffness of a joint's drive [N m/rad]."""
        return _JOINT_STIFFNESS_REL[self.kind] * self.mass_kg * GRAVITY_M_S2 * self.shank_m

    def neutral_m(self, leg: str) -> Vector:
        """Return the place of a foot in the middle of a stance, in the body's frame [m], shape (3,)."""
        x, y, z = self.legs[leg].hip_m
        if self.kind == "quadruped":
            return np.array([x, y + self.legs[leg].side * self.hip_m, z - self.height_m])
        out = self._outward_rad(leg)
        return np.array([x + self.reach_m * np.cos(out), y + self.reach_m * np.sin(out), z - self.height_m])

    def _outward_rad(self, leg: str) -> float:
        """Return the angle about z at which a hexapod's leg points outward [rad]."""
        x, _, _ = self.legs[leg].hip_m
        return float(self.legs[leg].side * (np.pi / 2.0 - np.radians(35.0) * np.sign(x)))

    def joint_angles_rad(self, leg: str, foot_m: Vector) -> Vector:
        """Return the angles of a leg's joints with the foot at places in the body's frame [rad], shape (n, 3).

        Args:
            leg: Name of the leg.
            foot_m: Places of the ball's middle [m], shape (n, 3); brought into reach.
        """
        place = self.legs[leg]
        x, y, z = (np.atleast_2d(foot_m) - np.array(place.hip_m)).T
        if self.kind == "quadruped":
            # In the plane across: the offset to the side, and the leg's length below it.
            below = np.sqrt(np.maximum(y * y + z * z - self.hip_m**2, (0.2 * self.shank_m) ** 2))
            first = np.arctan2(z, y) - np.arctan2(-below, place.side * self.hip_m)
            along, down = x, below
        else:
            first = np.arctan2(y, x) - self._outward_rad(leg)
            along, down = np.hypot(x, y) - self.hip_m, -z
        reach = np.clip(
            np.hypot(along, down),
            1.05 * abs(self.thigh_m - self.shank_m) + 1e-4,
            0.995 * (self.thigh_m + self.shank_m),
        )
        inner = (self.thigh_m**2 + reach**2 - self.shank_m**2) / (2.0 * self.thigh_m * reach)
        knee = (self.thigh_m**2 + self.shank_m**2 - reach**2) / (2.0 * self.thigh_m * self.shank_m)
        # The thigh's angle from straight down towards `along`; the knee points backward, or up and outward.
        towards = np.arctan2(along, down)
        bend = np.arccos(np.clip(inner, -1.0, 1.0))
        fold = np.pi - np.arccos(np.clip(knee, -1.0, 1.0))
        if self.kind == "quadruped":
            thigh, shank = towards - bend, fold
        else:
            thigh, shank = towards + bend, -fold
        return np.stack([_wrapped(first), thigh, shank], axis=1)

    def foot_poses(self, leg: str, angles_rad: Vector) -> tuple[Vector, Vector]:
        """Return where a leg's foot is, the inverse of `joint_angles_rad`, and how it is turned.

        Args:
            leg: Name of the leg.
            angles_rad: Angles of its joints [rad], shape (n, 3).

        Returns:
            Places of the ball's middle in the body's frame [m], shape (n, 3), and rotations from the foot's frame to
            the body's, shape (n, 3, 3).
        """
        place, neutral = self.legs[leg], self.joint_angles_rad(leg, self.neutral_m(leg))[0]
        first, thigh, shank = angles_rad.T
        if self.kind == "quadruped":
            turn, turned = 0.0, _turns(0, first)
            offset_m = np.array([0.0, place.side * self.hip_m, 0.0])
        else:
            turn = self._outward_rad(leg)
            turned, offset_m = _turns(2, first + turn), np.array([self.hip_m, 0.0, 0.0])
        at_m = place.hip_m + turned @ offset_m
        # The axes of thigh and shank point to the right.
        turned = turned @ _turns(1, -thigh)
        at_m = at_m + turned @ np.array([0.0, 0.0, -self.thigh_m])
        turned = turned @ _turns(1, -shank)
        at_m = at_m + turned @ np.array([0.0, 0.0, -self.shank_m])
        # The foot is mounted upright, and forward along the body, in the middle of a stance.
        mounted = _turns(1, neutral[1:].sum()) @ _turns(2, np.array(-turn))
        return at_m, turned @ mounted

    def mjcf(self, ground: "GroundModel", step_s: float) -> str:
        """Return the model: this robot above a ground, with a position drive at each joint."""
        radius, gravity = self.foot_radius_m, ground.gravity_m_s2()
        hip_kg, thigh_kg, shank_kg = (self.mass_kg * share for share in _LEG_MASS_REL[self.kind])
        body_kg = self.mass_kg - len(self.legs) * (hip_kg + thigh_kg + shank_kg)
        stiffness = self.joint_stiffness_n_m
        damping = _JOINT_DAMPING_S * self.time_rel * stiffness
        armature = _ARMATURE_REL * self.mass_kg * self.shank_m**2
        legs, drives = [], []
        for leg in self.legs:
            legs.append(self._leg_mjcf(leg, ground.friction, (hip_kg, thigh_kg, shank_kg), armature))
            drives += [
                f'<position joint="{leg}_{joint}" kp="{stiffness:.6g}" kv="{damping:.6g}"/>'
                for joint in "012"
            ]
        half = " ".join(f"{one:.6g}" for one in self.body_half_m)
        start = self.height_m + radius
        return f"""<mujoco><compiler angle="radian" autolimits="false"/>
<option timestep="{step_s:g}" integrator="implicitfast" cone="elliptic" impratio="5" gravity="{gravity}"/>
<asset>{ground.asset_mjcf(self.shank_m)}</asset>
<default><geom contype="0" conaffinity="0" solref="{ground.time_constant_s * self.time_rel:.6g} {_CONTACT_DAMPING_REL}"
 solimp="0 0.95 {_SOFT_DEPTH_REL * radius:.6g}"/></default>
<worldbody>{ground.geom_mjcf(self.shank_m)}
<body name="body" pos="0 0 {start:.6g}"><freejoint/><geom type="box" size="{half}" mass="{body_kg:.6g}"/>
{"".join(legs)}</body></worldbody>
<actuator>{"".join(drives)}</actuator></mujoco>"""

    def _leg_mjcf(
        self, leg: str, friction: float, masses_kg: tuple[float, float, float], armature: float
    ) -> str:
        """Return a leg; its angles are zero with thigh and shank straight down, and grow as `joint_angles_rad` says."""
        place, (hip_kg, thigh_kg, shank_kg) = self.legs[leg], masses_kg
        hip, arm = " ".join(f"{one:.6g}" for one in place.hip_m), f'armature="{armature:.6g}"'
        neutral = self.joint_angles_rad(leg, self.neutral_m(leg))[0]
        if self.kind == "quadruped":
            first_axis, turn, offset = "1 0 0", 0.0, f"0 {place.side * self.hip_m:.6g} 0"
        else:
            first_axis, turn, offset = "0 0 1", self._outward_rad(leg), f"{self.hip_m:.6g} 0 0"
        # The foot's own frame: upright, and forward along the body, in the middle of a stance.
        foot = _quaternion_text(_about_z(-turn), _about_y(float(neutral[1] + neutral[2])))
        first = _quaternion_text(_about_z(turn))
        thin, radius = 0.15 * self.shank_m, self.foot_radius_m
        return f"""<body pos="{hip}" quat="{first}"><joint name="{leg}_0" axis="{first_axis}" {arm}/>
<geom size="{thin:.6g}" mass="{hip_kg:.6g}"/>
<body pos="{offset}"><joint name="{leg}_1" axis="0 -1 0" {arm}/>
<geom type="capsule" fromto="0 0 0 0 0 {-self.thigh_m:.6g}" size="{0.5 * thin:.6g}" mass="{thigh_kg:.6g}"/>
<body pos="0 0 {-self.thigh_m:.6g}"><joint name="{leg}_2" axis="0 -1 0" {arm}/>
<geom type="capsule" fromto="0 0 0 0 0 {-self.shank_m:.6g}" size="{0.3 * thin:.6g}" mass="{0.7 * shank_kg:.6g}"/>
<body name="{leg}" pos="0 0 {-self.shank_m:.6g}" quat="{foot}">
<geom name="{leg}" size="{radius:.6g}" mass="{0.3 * shank_kg:.6g}" contype="1" friction="{friction:g}"/>
</body></body></body></body>"""


@dataclass(frozen=True, slots=True, kw_only=True)
class GroundModel:
    """The ground of one run.

    Attributes:
        friction: Coefficient of friction.
        time_constant_s: Time constant of a contact of a robot with a shank of 0.21 m: small is hard [s].
        slope_deg: Slope [deg], and the direction in which it rises, from forward to the left [deg].
        rough_rel: Half the height between its lowest and highest point over the robot's shank [1]; 0 for a plane.
    """

    friction: float
    time_constant_s: float
    slope_deg: tuple[float, float] = (0.0, 0.0)
    rough_rel: float = 0.0

    def gravity_m_s2(self) -> str:
        """Return gravity in the ground's frame, as text: a slope is a plane under tilted gravity."""
        slope, around = np.radians(self.slope_deg)
        down = -np.array([np.sin(slope) * np.cos(around), np.sin(slope) * np.sin(around), np.cos(slope)])
        return " ".join(f"{GRAVITY_M_S2 * one:.6g}" for one in down)

    def asset_mjcf(self, shank_m: float) -> str:
        """Return the height field for a robot, if the ground is rough."""
        if not self.rough_rel:
            return ""
        size, rough = f"{ROUGH_SIZE_REL * shank_m:.6g}", f"{2.0 * self.rough_rel * shank_m:.6g}"
        return (
            f'<hfield name="ground" nrow="{N_ROUGH}" ncol="{N_ROUGH}" size="{size} {size} {rough} {rough}"/>'
        )

    def geom_mjcf(self, shank_m: float) -> str:
        """Return the ground's geom for a robot; it touches feet alone."""
        form = 'type="plane" size="50 50 1"'
        if self.rough_rel:
            form = f'type="hfield" hfield="ground" pos="0 0 {-self.rough_rel * shank_m:.6g}"'
        return f'<geom name="ground" {form} conaffinity="1" friction="0.01"/>'


def _wrapped(angle_rad: Vector) -> Vector:
    wrapped: Vector = (angle_rad + np.pi) % (2.0 * np.pi) - np.pi
    return wrapped


def _turns(axis: int, angle_rad: Vector) -> Vector:
    """Return the rotations about one of the axes x, y, z by angles of shape (...) [rad], shape (..., 3, 3)."""
    second, third = (axis + 1) % 3, (axis + 2) % 3
    turns = np.zeros((*np.shape(angle_rad), 3, 3))
    turns[..., axis, axis] = 1.0
    turns[..., second, second] = turns[..., third, third] = np.cos(angle_rad)
    turns[..., third, second] = np.sin(angle_rad)
    turns[..., second, third] = -turns[..., third, second]
    return turns


def _about_z(angle_rad: float) -> Vector:
    return np.array([np.cos(angle_rad / 2.0), 0.0, 0.0, np.sin(angle_rad / 2.0)])


def _about_y(angle_rad: float) -> Vector:
    return np.array([np.cos(angle_rad / 2.0), 0.0, np.sin(angle_rad / 2.0), 0.0])


def _quaternion_text(*turns: Vector) -> str:
    """Return the product of quaternions, the last one first, as text."""
    product = np.array([1.0, 0.0, 0.0, 0.0])
    for w, x, y, z in reversed(turns):
        a, b, c, d = product
        product = np.array(
            [
                a * w - b * x - c * y - d * z,
                a * x + b * w + c * z - d * y,
                a * y - b * z + c * w + d * x,
                a * z + b * y - c * x + d * w,
            ]
        )
    return " ".join(f"{one:.8g}" for one in product)


_QUADRUPED = Robot(
    name="quadruped-12kg",
    kind="quadruped",
    mass_kg=12.0,
    thigh_m=0.21,
    shank_m=0.21,
    hip_m=0.08,
    height_m=0.30,
    reach_m=0.0,
    foot_radius_m=0.02,
    body_half_m=(0.19, 0.06, 0.05),
)
_HEXAPOD = Robot(
    name="hexapod-2kg",
    kind="hexapod",
    mass_kg=2.0,
    thigh_m=0.075,
    shank_m=0.11,
    hip_m=0.035,
    height_m=0.09,
    reach_m=0.13,
    foot_radius_m=0.013,
    body_half_m=(0.10, 0.05, 0.025),
)


def _scaled(robot: Robot, mass_kg: float, name: str, *, slenderness: float = 1.0) -> Robot:
    """Return a robot of another mass, its lengths scaled by the cube root; slender ones have longer legs."""
    scale = (mass_kg / robot.mass_kg) ** (1.0 / 3.0)
    leg = scale * slenderness
    return replace(
        robot,
        name=name,
        mass_kg=mass_kg,
        thigh_m=leg * robot.thigh_m,
        shank_m=leg * robot.shank_m,
        hip_m=scale * robot.hip_m,
        height_m=leg * robot.height_m,
        reach_m=leg * robot.reach_m,
        foot_radius_m=scale * robot.foot_radius_m,
        body_half_m=tuple(scale * one for one in robot.body_half_m),
    )


#: The robots by name.
ROBOTS: dict[str, Robot] = {
    robot.name: robot
    for robot in (
        _HEXAPOD,
        _QUADRUPED,
        _scaled(_HEXAPOD, 0.3, "hexapod-300g"),
        _scaled(_HEXAPOD, 12.0, "hexapod-12kg", slenderness=0.9),
        _scaled(_QUADRUPED, 0.3, "quadruped-300g", slenderness=1.1),
        _scaled(_QUADRUPED, 2.0, "quadruped-2kg", slenderness=0.95),
    )
}
