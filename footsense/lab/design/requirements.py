"""Requirements of a foot design: loads, errors, sizes, materials, process, and the converter board."""

from typing import NamedTuple

import numpy as np

from firmware_interface.chips import ad7147, fdc1004
from footsense.foot.directions import direction_grid
from footsense.foot.specimen import ContactLoads
from footsense.frames import ELEMENTS, ROWS
from footsense.lab.design.materials import Materials
from footsense.lab.design.processes import Process
from footsense.lab.evaluation.force_range import UPRIGHT, friction_loads
from footsense.lab.fabrication import dimensions
from footsense.lab.foot_file import MIN_UNLOADED_PF
from footsense.lab.training.load_cases import FULL_SCALE_PF, NOISE_PF

#: Standard gravity [m/s2].
GRAVITY_M_S2 = 9.80665
#: Contacts of the widest tail: of three lines a column between four guards, and of three lines between four.
_ELEMENT_CONTACTS, _LINE_CONTACTS = ROWS * (2 * ROWS + 1), 2 * ROWS + 1
#: Angle by which a leg pitches [deg], and the contact normal in the frame of its foot with it.
PITCH_DEG = 10.0
#: Normals of the loads of a design: upright, and pitched towards a corner, where the range ends first, shape (2, 3).
_NORMALS = np.concatenate([UPRIGHT, direction_grid([45.0], [90.0 - PITCH_DEG])])


class Converter(NamedTuple):
    """Converter board: noise [pF], input range [pF] and time of a scan [s].

    Attributes:
        name: Name, as `board` of a configuration.
        noise_pf: Noise of a conversion [pF, rms].
        min_unloaded_pf: Least capacitance of an unloaded element [pF]: above an open line.
        range_end_pf: Largest capacitance that it reads [pF].
        scan_s: Its nine conversions one after the other [s].
        min_bar_mm: Least bar between two columns, for the traces in it [mm].
        min_ball_mm: Least diameter of the ball, for the tail on its socket [mm].
    """

    name: str
    noise_pf: float
    min_unloaded_pf: float
    range_end_pf: float
    scan_s: float
    min_bar_mm: float
    min_ball_mm: float


def converter(name: str) -> Converter:
    """Return the constants of a converter board at its fastest conversion rate.

    Args:
        name: `ad7147` or `fdc1004`.
    """
    if name == "ad7147":
        return Converter(
            name,
            noise_pf=1e-3 * ad7147.NOISE_CODES * ad7147.FF_PER_CODE,
            min_unloaded_pf=ad7147.LEAST_OVER_RANGE_START * ad7147.RANGE_START_PF,
            range_end_pf=ad7147.RANGE_END_PF,
            scan_s=1e-9 * (ELEMENTS * ad7147.DECIMATIONS[64].stage_ns),
            min_bar_mm=dimensions.MIN_TRACED_BAR_MM,
            min_ball_mm=2.0 * dimensions.least_ball_radius_mm(_ELEMENT_CONTACTS),
        )
    return Converter(
        name,
        noise_pf=NOISE_PF,
        min_unloaded_pf=MIN_UNLOADED_PF,
        range_end_pf=FULL_SCALE_PF,
        scan_s=1e-9 * (ELEMENTS * fdc1004.RATES[400].conversion_ns),
        min_bar_mm=0.0,
        min_ball_mm=2.0 * dimensions.least_ball_radius_mm(_LINE_CONTACTS),
    )


class Requirements(NamedTuple):
    """Requirements of a design: loads [N], lean [deg], error [deg], ball sizes, materials, process, board.

    Attributes:
        max_load_n: Largest normal load of a foot [N].
        min_load_n: Smallest normal load at which the direction matters [N].
        lean_deg: Largest angle between force and contact normal [deg].
        max_noise_direction_error_deg: Largest error of the direction that the converter's noise may cause, mean over
            the range [deg].
        ball_diameter_range_mm: Least and largest diameter of the ball [mm].
        materials: At hand.
        process: How the sheet is made.
        board: The converter.
    """

    max_load_n: float
    min_load_n: float
    lean_deg: float
    max_noise_direction_error_deg: float
    ball_diameter_range_mm: tuple[float, float]
    materials: Materials
    process: Process
    board: Converter

    @property
    def loads(self) -> ContactLoads:
        """Loads of the design, each of 1 N along its normal: every normal, no lean, half and all of the lean."""
        kinds = [friction_loads(_NORMALS, share * self.lean_deg) for share in (0.0, 0.5, 1.0)]
        normal, force_n = (np.concatenate(parts) for parts in zip(*kinds, strict=True))
        return ContactLoads(normal, force_n)


def largest_normal_load_n(mass_kg: float, legs: int, load_factor: float) -> float:
    """Return the largest normal load of a foot [N]: weight shared by half of the legs, times a load factor.

    Args:
        mass_kg: Mass of the robot [kg].
        legs: Number of legs; of an odd number the smaller half carries.
        load_factor: Largest normal load of a gait over its share of the weight, below which it is for 99 % of the
            loaded time [1]. From robots in a physics engine, a hexapod of 2 kg and a quadruped of 12: tripod 1.6, fast
            2.0; trot 2.0, fast 2.2; walk 1.7 and 2.0, peaks of 3.8 and 3.3 apart. Hops have 3.4 to 5, landings 4 to 7.

    Example:
        >>> round(largest_normal_load_n(2.0, 6, 2.2), 1), round(largest_normal_load_n(12.0, 4, 2.2), 0)
        (14.4, 129.0)
    """
    return load_factor * mass_kg * GRAVITY_M_S2 / max(1, legs // 2)
