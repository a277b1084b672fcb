"""What a temperature does to the forces of a calibrated foot, and what is left open where none is measured.

Rubber is stiffer when it is warm: its shear modulus grows by 1.1 kPa/K of 250 kPa (Lotters et al., J. Micromech.
Microeng. 7, 145, 1997). The same load then makes smaller closures, and the force read from them is too small by the
same share, on every axis. A converter tells the temperature of its board: mount it where the foot's is. What the gaps
do, -1.5 fF/K of an element, moves the zero alone, which the tracking of the zero takes away: closures are reckoned from
the elastance, so that the gap at rest drops out.
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

#: Growth of the stiffness of PDMS [1/K].
STIFFNESS_PER_K = 4.4e-3
#: What a converter measures [degC].
COLDEST_C, WARMEST_C = -40.0, 125.0
#: How far a foot that nothing measures may be from the temperature of its bench [K]: 12 to 32 degC about the 22 of a
#: workshop, an unheated hall and a summer's day.
_RANGE_K = 10.0


class CalibratedAt(NamedTuple):
    """At what temperature a foot was on the bench.

    Attributes:
        temperature_c: That [degC]; None if nothing there measured it.
        stiffness_per_k: Growth of its stiffness, over that at `temperature_c` [1/K].
    """

    temperature_c: float | None
    stiffness_per_k: float = STIFFNESS_PER_K


def effect(temperature_c: float, then: CalibratedAt | None) -> tuple[float, float]:
    """Return by what the force of a foot is to be multiplied, and the share of it that remains unknown [1].

    Where either temperature is not known, or is none that a converter measures, nothing is corrected.

    Args:
        temperature_c: Temperature of the foot now [degC], NaN where nothing measures it.
        then: That of the bench; None for a foot that was never on one, which is read as its design.

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
