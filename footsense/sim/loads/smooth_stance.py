"""The ground reaction of a stance with rounded flanks."""

import math

import numpy as np

from footsense.frames import Vector
from footsense.sim.loads.walk import Reaction


def smooth_stance(duty_rel: float, peak_force_n: float, friction_rel: float) -> Reaction:
    """Return a stance with rounded flanks: braking first, propulsion later, and a small force to the left.

    Args:
        duty_rel: Share of the cycle in stance [1].
        peak_force_n: Largest vertical force [N].
        friction_rel: Largest horizontal over vertical force [1].
    """
    flank = 0.2  # share of the stance in which the force rises, and in which it falls

    def reaction(phase: float) -> Vector:
        stance = phase / duty_rel
        edge = min(stance, 1 - stance) / flank
        vertical = peak_force_n * (0.5 - 0.5 * math.cos(math.pi * min(edge, 1.0)))
        along = -friction_rel * math.cos(math.pi * stance)
        return np.array([along * vertical, 0.2 * friction_rel * vertical, vertical])

    return reaction
