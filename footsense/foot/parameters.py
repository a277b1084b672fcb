"""Calibration parameters by which one foot differs from its design, and what they make of a force.

Stray, unloaded reading, gap and gain belong to the electrodes and act before the network, the rest behind it. With p
the force that the network of the design estimates from the foot's own closures,

    f = M p,        M = (1 + stiffness) * mount^T

M is exact for a linear solid, even where gaps close at the design's closures. A layer that learnt the residual by
cross-validated ridge regression found nothing in most feet, and made leaning loads worse where rubber creeps: 2.0 deg
in place of 1.8.

**Temperature.** The shear modulus of PDMS grows by 1.1 kPa/K of 250 kPa. The same load then makes smaller closures, and
the estimated force is too small by the same share, on every axis. The gaps' own change, -1.5 fF/K per element, moves
only the baseline, which the baseline tracker follows: closures are computed from the elastance, in which the unloaded
gap cancels.

Source:
    Lotters et al., Journal of Micromechanics and Microengineering 7, 145, 1997, for the shear modulus of PDMS.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from footsense.foot.directions import UNIT_LENGTH_TOLERANCE
from footsense.frames import ELEMENTS, Vector


class ForceUncertainty(NamedTuple):
    """What nobody knows of a foot, as standard deviations.

    Attributes:
        along_rel: Of its force along the force, over the force's size [1].
        across_rel: Along each direction across it, likewise [1].
        gap_rel: Of the gap of an element over the design's [1]: it is closed at another closure than the design's.
    """

    along_rel: float
    across_rel: float
    gap_rel: float = 0.0

    def plus(self, other: "ForceUncertainty", share: float = 1.0) -> "ForceUncertainty":
        """Return this uncertainty with a share of an independent one."""
        return ForceUncertainty(
            *(math.hypot(own, share * more) for own, more in zip(self, other, strict=True))
        )


#: Of a foot that is known exactly, as that of a simulation.
KNOWN_EXACTLY = ForceUncertainty(0.0, 0.0, 0.0)
#: Sigma of what nobody knows of a foot, over its standard deviation [1]: a foot errs alike in all its forces, and 99 of
#: 100 feet shall have them within two sigma.
_ONE_FOOT = 1.3


def variance_factors(feet: Sequence[ForceUncertainty]) -> tuple[Vector, Vector]:
    """Return what the uncertainty of feet adds to the variance of their forces, as two factors a and b, shape (n, 1).

    The variance of component i of a force f grows by a |f|^2 + b f_i^2.
    """
    along_rel2, across_rel2, _ = np.square(_ONE_FOOT * np.array(feet)).T[:, :, None]
    return across_rel2, along_rel2 - across_rel2


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FootParameters:
    """Calibration parameters of one foot: stray, baseline, gaps, gains, stiffness, mounting, remaining error.

    Attributes:
        stray_pf: Capacitance of the wiring in parallel with each element [pF], shape (elements,).
        unloaded_pf: Reading of each element of the unloaded foot, stray included [pF], shape (elements,).
        gap_um: Air gap of each element [um], shape (elements,).
        gain_rel: Closure of each element by the design's electrodes over its real closure [1], shape (elements,).
        stiffness_rel: Stiffness of the whole foot over the design's, minus one [1].
        mount: Rotation from the leg's frame to the foot's, shape (3, 3).
        error_rel: Standard deviation of the remaining error over the force [1].
        size_sigma_rel: Standard deviation of the force's size by its robot's weight [1]; 0 where none did.
    """

    stray_pf: Vector
    unloaded_pf: Vector
    gap_um: Vector
    gain_rel: Vector = field(default_factory=lambda: np.ones(ELEMENTS))
    stiffness_rel: float = 0.0
    mount: Vector = field(default_factory=lambda: np.eye(3))
    error_rel: float = 0.0
    size_sigma_rel: float = 0.0

    def __post_init__(self) -> None:
        """Check the physical limits.

        Raises:
            ValueError: A value is impossible; the message names it.
        """
        for name, smallest in (("gap_um", self.gap_um.min()), ("gain_rel", self.gain_rel.min())):
            if smallest <= 0.0:
                raise ValueError(f"{name}: has to be above 0, got {smallest:g}")
        if (self.unloaded_pf <= self.stray_pf).any():
            raise ValueError("unloaded_pf: has to be above stray_pf at every element")
        if not self.stiffness_rel > -1.0:
            raise ValueError(f"stiffness_rel: has to be above -1, got {self.stiffness_rel:g}")
        mirrored = np.linalg.det(self.mount) < 0.0
        if mirrored or not np.allclose(self.mount @ self.mount.T, np.eye(3), atol=UNIT_LENGTH_TOLERANCE):
            raise ValueError("mount: is no rotation")
        for name in ("error_rel", "size_sigma_rel"):
            if not (sigma_rel := getattr(self, name)) >= 0.0:
                raise ValueError(f"{name}: is a standard deviation, not below 0, got {sigma_rel:g}")

    @property
    def force_matrix(self) -> Vector:
        """Matrix, shape (3, 3), from the force estimated by the design's network to the force in the leg's frame."""
        matrix: Vector = (1.0 + self.stiffness_rel) * self.mount.T
        return matrix

    def as_lists(self) -> dict[str, Any]:
        """Return all parameters as lists and floats by name, for a JSON file."""
        return {name: np.asarray(getattr(self, name)).tolist() for name in self.__slots__}


#: Relative increase of the stiffness of PDMS [1/K].
STIFFNESS_PER_K = 4.4e-3
#: Range of the temperature of a foot; beyond it a sensor is broken [degC].
COLDEST_C, WARMEST_C = -40.0, 125.0
#: Distance of an unknown temperature from the test stand's [K]: from an unheated hall, 12 degC, to a summer's day, 32.
_UNKNOWN_TEMPERATURE_K = 10.0
#: Relative standard deviation of a force at an unknown temperature [1]: uniform within that.
UNKNOWN_TEMPERATURE_SIGMA_REL = STIFFNESS_PER_K * _UNKNOWN_TEMPERATURE_K / math.sqrt(3.0)


def force_factor_and_uncertainty(temperature_c: float, calibrated_at_c: float | None) -> tuple[float, float]:
    """Return the factor by which to multiply a foot's force, and its remaining relative standard deviation [1].

    If either temperature is unknown or outside of what a foot may have, the factor is 1.

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
