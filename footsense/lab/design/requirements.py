"""Requirements of a foot design: forces, errors, sizes, materials, process, and the converter board."""

from typing import NamedTuple

from firmware_interface.chips import ad7746, fdc1004
from footsense.frames import ELEMENTS
from footsense.lab.design.materials import Materials
from footsense.lab.design.processes import Process
from footsense.lab.foot_file import MIN_UNLOADED_PF
from footsense.lab.training.load_cases import BASELINE_NOISE_PF, FULL_SCALE_PF, NOISE_PF

#: Standard gravity [m/s2].
GRAVITY_M_S2 = 9.80665
#: Least unloaded and largest capacitance that board `ad7746` reads with any chip [pF]: its CAPDAC is fixed
#: (docs/adr/0012-ad7746-fixed-capdac-measured-step.md).
_AD7746_RANGE_PF = (4.0, 9.3)
#: Noise of a baseline over that of a conversion [1], as with board `fdc1004`.
_BASELINE_NOISE_REL = 0.4


class Converter(NamedTuple):
    """Converter board: noise [pF], input range [pF] and time of a scan [s].

    Attributes:
        name: Name, as `board` of a configuration.
        noise_pf: Noise of a conversion [pF, rms].
        baseline_noise_pf: Noise of the baseline [pF, rms].
        min_unloaded_pf: Least capacitance of an unloaded element [pF]: above an open line and the CAPDAC's offset.
        range_end_pf: Largest capacitance that it reads [pF].
        scan_s: Nine conversions [s].
    """

    name: str
    noise_pf: float
    baseline_noise_pf: float
    min_unloaded_pf: float
    range_end_pf: float
    scan_s: float


def converter(name: str) -> Converter:
    """Return the constants of a converter board at its fastest conversion rate.

    Args:
        name: `fdc1004` or `ad7746`.
    """
    if name == "fdc1004":
        scan_s = 1e-9 * ELEMENTS * fdc1004.RATES[max(fdc1004.RATES)].conversion_ns
        return Converter(name, NOISE_PF, BASELINE_NOISE_PF, MIN_UNLOADED_PF, FULL_SCALE_PF, scan_s)
    quick = ad7746.RATES[max(ad7746.RATES)]
    noise_pf, scan_s = 1e-3 * quick.noise_ff, 1e-9 * ELEMENTS * quick.conversion_ns
    return Converter(name, noise_pf, _BASELINE_NOISE_REL * noise_pf, *_AD7746_RANGE_PF, scan_s)


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
