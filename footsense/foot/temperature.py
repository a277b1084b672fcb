"""Temperature compensation of a calibrated foot's forces, and the uncertainty where no temperature is measured.

The shear modulus of PDMS grows by 1.1 kPa/K of 250 kPa. The same load then makes smaller closures, and the estimated
force is too small by the same share, on every axis. The converter measures the temperature of its board, which has to
be that of the foot. The gaps' own change, -1.5 fF/K per element, moves only the baseline, which the baseline tracker
follows: closures are computed from the elastance, in which the unloaded gap cancels.

Source:
    Lotters et al., Journal of Micromechanics and Microengineering 7, 145, 1997, for the shear modulus of PDMS.
"""

import math
from typing import NamedTuple

__all__ = [
    "COLDEST_C",
    "STIFFNESS_PER_K",
    "WARMEST_C",
    "CalibratedAt",
    "effect",
    "force_gain",
    "unknown_temperature_rel",
]

#: Relative increase of the stiffness of PDMS [1/K].
STIFFNESS_PER_K = 4.4e-3
#: Range of a converter's sensor [degC].
COLDEST_C, WARMEST_C = -40.0, 125.0
#: Half range of an unmeasured foot's temperature about that of its test stand [K]: from an unheated hall, 12 degC, to a
#: summer's day, 32 degC.
_RANGE_K = 10.0


class CalibratedAt(NamedTuple):
    """Temperature of a foot on the test stand.

    Attributes:
        temperature_c: The temperature [degC]; None if not measured.
        stiffness_per_k: Increase of its stiffness over that at `temperature_c` [1/K].
    """

    temperature_c: float | None
    stiffness_per_k: float = STIFFNESS_PER_K


def effect(temperature_c: float, then: CalibratedAt | None) -> tuple[float, float]:
    """Return the factor for the force of a foot, and the standard deviation over the force that remains [1].

    If either temperature is unknown or outside of a converter's range, the factor is 1.

    Args:
        temperature_c: Present temperature of the foot [degC], NaN if not measured.
        then: Its temperature on the test stand; None for an uncalibrated foot, which is not corrected.

    Example:
        >>> effect(23.0, CalibratedAt(23.0)), effect(23.0, CalibratedAt(None))[0]
        ((1.0, 0.0), 1.0)
    """
    if then is None:
        return 1.0, 0.0
    if then.temperature_c is not None and COLDEST_C <= temperature_c <= WARMEST_C:
        return force_gain(temperature_c, then.temperature_c, then.stiffness_per_k), 0.0
    return 1.0, unknown_temperature_rel(_RANGE_K, then.stiffness_per_k)


def force_gain(
    temperature_c: float, calibrated_at_c: float, stiffness_per_k: float = STIFFNESS_PER_K
) -> float:
    """Return the factor for a force that was estimated as if the foot had the temperature of its calibration.

    Args:
        temperature_c: Temperature of the foot [degC], -40 to 125.
        calibrated_at_c: Temperature at which it was calibrated [degC], -40 to 125.
        stiffness_per_k: Increase of its stiffness over that at `calibrated_at_c` [1/K].

    Raises:
        ValueError: A temperature is NaN or outside of a converter's range, or the stiffness would not be positive.

    Example:
        >>> round(force_gain(43.0, 23.0), 3), force_gain(23.0, 23.0)
        (1.088, 1.0)
    """
    for name, value_c in (("temperature_c", temperature_c), ("calibrated_at_c", calibrated_at_c)):
        if not COLDEST_C <= value_c <= WARMEST_C:
            raise ValueError(
                f"{name} is {value_c:g}, a converter measures {COLDEST_C:g} to {WARMEST_C:g} degC"
            )
    gain = 1.0 + stiffness_per_k * (temperature_c - calibrated_at_c)
    if not gain > 0.0:
        raise ValueError(
            f"at {temperature_c:g} degC a foot that stiffens by {stiffness_per_k:g} per K has no stiffness"
        )
    return gain


def unknown_temperature_rel(range_k: float, stiffness_per_k: float = STIFFNESS_PER_K) -> float:
    """Return the standard deviation over the force that an unmeasured temperature causes [1].

    The temperature is taken as uniform within the range, whose standard deviation is 1 / sqrt(3) of its half width.

    Args:
        range_k: Half width of the range about the temperature of the calibration [K], at least 0.
        stiffness_per_k: As for `force_gain`.

    Raises:
        ValueError: The range is negative or NaN.

    Example:
        >>> round(unknown_temperature_rel(20.0), 3)
        0.051
    """
    if not range_k >= 0.0:
        raise ValueError(f"range_k is {range_k:g}, a range has 0 K at least")
    return abs(stiffness_per_k) * range_k / math.sqrt(3.0)
