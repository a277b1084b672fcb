"""Ground friction model in which a foot sticks, creeps and slides.

The leg holds the foot against the ground through a spring: leg, drives and rubber. Without any sliding the ground would
react with the demanded tangential force D(t): the share of the weight that a slope or a stone asks for, and the spring
times the leg's way against the body. Sliding relaxes the spring:

    f(t) = D(t) - k x(t),    |f| <= mu s(t),    s the normal force, x the slid way

While it sticks, the contact creeps in the direction of the force, the faster the nearer the force is to the cone. It
breaks loose at the coefficient of static friction and slides at that of kinetic friction until it rests.
"""

import math
from dataclasses import dataclass

import numpy as np

from footsense.frames import Vector

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
