"""Temperature compensation of a calibrated foot's forces, and the uncertainty without a measured temperature.

The shear modulus of PDMS grows by 1.1 kPa/K of 250 kPa. The same load then makes smaller closures, and the estimated
force is too small by the same share, on every axis. The converter measures the temperature of its board, which has to
be that of the foot. The gaps' own change, -1.5 fF/K per element, moves only the baseline, which the baseline tracker
follows: closures are computed from the elastance, in which the unloaded gap cancels.

Source:
    Lotters et al., Journal of Micromechanics and Microengineering 7, 145, 1997, for the shear modulus of PDMS.
"""

import math
from typing import NamedTuple

#: Relative increase of the stiffness of PDMS [1/K].
STIFFNESS_PER_K = 4.4e-3
#: Range of a converter's sensor [degC].
COLDEST_C, WARMEST_C = -40.0, 125.0
#: Half range of an unmeasured foot's temperature about that of its test stand [K]: from an unheated hall, 12 degC, to a
#: summer's day, 32 degC.
_UNMEASURED_HALF_RANGE_K = 10.0


class CalibrationTemperature(NamedTuple):
    """Temperature of a foot during its calibration, and stiffening per kelvin.

    Attributes:
        temperature_c: The temperature [degC]; None if not measured.
        stiffness_per_k: Increase of its stiffness over that at `temperature_c` [1/K].
    """

    temperature_c: float | None
    stiffness_per_k: float = STIFFNESS_PER_K


def force_factor_and_uncertainty(
    temperature_c: float, then: CalibrationTemperature | None
) -> tuple[float, float]:
    """Return the factor by which to multiply a foot's force, and its remaining relative standard deviation [1].

    If either temperature is unknown or outside of a converter's range, the factor is 1.

    Args:
        temperature_c: Present temperature of the foot [degC], NaN if not measured.
        then: Its temperature on the test stand; None for an uncalibrated foot, which is not corrected.

    Example:
        >>> force_factor_and_uncertainty(23.0, CalibrationTemperature(23.0))
        (1.0, 0.0)
        >>> force_factor_and_uncertainty(23.0, CalibrationTemperature(None))[0]
        1.0
        >>> round(force_factor_and_uncertainty(43.0, CalibrationTemperature(23.0))[0], 3)
        1.088
    """
    if then is None:
        return 1.0, 0.0
    if then.temperature_c is not None and COLDEST_C <= temperature_c <= WARMEST_C:
        return 1.0 + then.stiffness_per_k * (temperature_c - then.temperature_c), 0.0
    return 1.0, unknown_temperature_sigma_rel(_UNMEASURED_HALF_RANGE_K, then.stiffness_per_k)


def unknown_temperature_sigma_rel(range_k: float, stiffness_per_k: float = STIFFNESS_PER_K) -> float:
    """Return the relative standard deviation of the force that an unmeasured temperature causes [1].

    The temperature is taken as uniform within the range, whose standard deviation is 1 / sqrt(3) of its half width.

    Args:
        range_k: Half width of the range about the temperature of the calibration [K], at least 0.
        stiffness_per_k: Increase of the stiffness over that at the calibration [1/K].

    Example:
        >>> round(unknown_temperature_sigma_rel(20.0), 3)
        0.051
    """
    return abs(stiffness_per_k) * range_k / math.sqrt(3.0)
