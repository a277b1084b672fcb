"""Requirements of a foot design: forces, errors, sizes, materials, process, board."""

from typing import NamedTuple

from footsense.lab.design.inputs.boards import Converter
from footsense.lab.design.inputs.materials import Materials
from footsense.lab.design.inputs.processes import Process

#: Standard gravity [m/s2].
GRAVITY_M_S2 = 9.80665
#: Closure over the gap up to which a load is read [1]: beyond, different loads have nearly the same closures
#: (docs/report/force-range.md).
MAX_READABLE_CLOSURE_REL = 0.8


class Requirements(NamedTuple):
    """Requirements of a design: forces [N], lean [deg], error [deg], ball sizes, materials, process, board.

    Attributes:
        max_n: Largest force on a foot [N].
        min_evaluated_force_n: Smallest force whose direction matters [N].
        max_force_to_leg_axis_deg: Largest angle between a force and the leg's axis [deg].
        max_noise_direction_error_deg: Largest error of the direction that the converter's noise may cause, mean over
            the range [deg].
        ball_diameter_range_mm: Least and largest diameter of the ball [mm].
        materials: At hand.
        process: How the sheet is made.
        board: The converter.
    """

    max_n: float
    min_evaluated_force_n: float
    max_force_to_leg_axis_deg: float
    max_noise_direction_error_deg: float
    ball_diameter_range_mm: tuple[float, float]
    materials: Materials
    process: Process
    board: Converter


def largest_force_n(mass_kg: float, legs: int, load_factor: float) -> float:
    """Return the largest force on a foot [N]: weight shared by half of the legs, times a load factor.

    Args:
        mass_kg: Mass of the robot [kg].
        legs: Number of legs; of an odd number the smaller half carries.
        load_factor: Largest force of a gait over its share of the weight [1].

    Example:
        >>> round(largest_force_n(2.0, 6, 1.8), 1), round(largest_force_n(12.0, 4, 2.5), 0)
        (11.8, 147.0)
    """
    return load_factor * mass_kg * GRAVITY_M_S2 / max(1, legs // 2)
