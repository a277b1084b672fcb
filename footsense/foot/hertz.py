"""Hertz contact of the ball with a rigid ground."""

import numpy as np

from footsense.frames import Vector


def contact_radius_mm(
    pressing_n: Vector | float, ball_radius_mm: float, contact_modulus_mpa: float
) -> Vector:
    """Return the radius a of the Hertz contact patch [mm], same shape as the force: a^3 = 3 F R / (4 E*).

    Args:
        pressing_n: Force along the contact normal [N], at least 0.
        ball_radius_mm: Radius R of the ball [mm].
        contact_modulus_mpa: E* = E / (1 - nu^2) of the ball's rubber [MPa].

    Source:
        K. L. Johnson, Contact Mechanics, 1985, equation (4.22).
    """
    radius_mm: Vector = np.cbrt(0.75 * ball_radius_mm / contact_modulus_mpa * pressing_n)
    return radius_mm
