"""Temperature compensation of a calibrated foot's forces, and the uncertainty without a measured temperature.

The shear modulus of PDMS grows by 1.1 kPa/K of 250 kPa. The same load then makes smaller closures, and the estimated
force is too small by the same share, on every axis. The converter measures the temperature of its board, which has to
be that of the foot. The gaps' own change, -1.5 fF/K per element, moves only the baseline, which the baseline tracker
follows: closures are computed from the elastance, in which the unloaded gap cancels.

Source:
    Lotters et al., Journal of Micromechanics and Microengineering 7, 145, 1997, for the shear modulus of PDMS.
"""

import math

#: Relative increase of the stiffness of PDMS [1/K].
STIFFNESS_PER_K = 4.4e-3
#: Range of a converter's sensor [degC].
COLDEST_C, WARMEST_C = -40.0, 125.0
#: Relative standard deviation of a force at an unknown temperature [1]: uniform within 10 K of the test stand's, from
#: an unheated hall, 12 degC, to a summer's day, 32 degC.
UNKNOWN_TEMPERATURE_SIGMA_REL = STIFFNESS_PER_K * 10.0 / math.sqrt(3.0)


def force_factor_and_uncertainty(temperature_c: float, calibrated_at_c: float | None) -> tuple[float, float]:
    """Return the factor by which to multiply a foot's force, and its remaining relative standard deviation [1].

    If either temperature is unknown or outside of a converter's range, the factor is 1.

    Args:
        temperature_c: Present temperature of the foot [degC], NaN if not measured.
        calibrated_at_c: Its temperature on the test stand [degC], NaN if not measured; None for an uncalibrated foot,
            which is not corrected.

    Example:
        >>> force_factor_and_uncertainty(23.0, 23.0), force_factor_and_uncertainty(23.0, math.nan)[0]
        ((1.0, 0.0), 1.0)
        >>> round(force_factor_and_uncertainty(43.0, 23.0)[0], 3)
        1.088
    """
    if calibrated_at_c is None:
        return 1.0, 0.0
    if not math.isnan(calibrated_at_c) and COLDEST_C <= temperature_c <= WARMEST_C:
        return 1.0 + STIFFNESS_PER_K * (temperature_c - calibrated_at_c), 0.0
    return 1.0, UNKNOWN_TEMPERATURE_SIGMA_REL
