"""What a temperature does to the forces of a calibrated foot, and what is left open where none is measured.

Rubber is stiffer when it is warm: its shear modulus grows by 1.1 kPa/K of 250 kPa (Lotters et al., J. Micromech.
Microeng. 7, 145, 1997). The same load then makes smaller closures, and the force read from them is too small by the
same share, on every axis. A converter tells the temperature of its board: mount it where the foot's is. What the gaps
do, -1.5 fF/K of an element, moves the zero alone, which the tracking of the zero takes away: closures are reckoned from
the elastance, so that the gap at rest drops out.
"""

import math

__all__ = ["STIFFNESS_PER_K", "force_gain", "unknown_temperature_rel"]

#: Growth of the stiffness of PDMS [1/K].
STIFFNESS_PER_K = 4.4e-3


def force_gain(
    temperature_c: float, calibrated_at_c: float, stiffness_per_k: float = STIFFNESS_PER_K
) -> float:
    """Return by what a force is to be multiplied that was read as if the foot were as warm as when it was calibrated.

    Args:
        temperature_c: Temperature of the foot [degC], -40 to 125.
        calibrated_at_c: Temperature at which it was calibrated [degC], -40 to 125.
        stiffness_per_k: Growth of its stiffness, over that at `calibrated_at_c` [1/K].

    Raises:
        ValueError: A temperature is no number or lies outside what a converter measures, or the foot would have no
            stiffness left.

    Example:
        >>> round(force_gain(43.0, 23.0), 3), force_gain(23.0, 23.0)
        (1.088, 1.0)
    """
    for name, value_c in (("temperature_c", temperature_c), ("calibrated_at_c", calibrated_at_c)):
        if not -40.0 <= value_c <= 125.0:
            raise ValueError(f"{name} is {value_c:g}, a converter measures -40 to 125 degC")
    gain = 1.0 + stiffness_per_k * (temperature_c - calibrated_at_c)
    if not gain > 0.0:
        raise ValueError(
            f"at {temperature_c:g} degC a foot that stiffens by {stiffness_per_k:g} per K has no stiffness"
        )
    return gain


def unknown_temperature_rel(range_k: float, stiffness_per_k: float = STIFFNESS_PER_K) -> float:
    """Return the share of a force by which its sigma is to be widened where no temperature is measured [1].

    Any temperature within the range is as likely as any other: the root mean square of that is 1 / sqrt(3) of its end.

    Args:
        range_k: How far the temperature may be from that of the calibration, either way [K], at least 0.
        stiffness_per_k: As for `force_gain`.

    Raises:
        ValueError: The range is below 0, or no number.

    Example:
        >>> round(unknown_temperature_rel(20.0), 3)
        0.051
    """
    if not range_k >= 0.0:
        raise ValueError(f"range_k is {range_k:g}, a range has 0 K at least")
    return abs(stiffness_per_k) * range_k / math.sqrt(3.0)
