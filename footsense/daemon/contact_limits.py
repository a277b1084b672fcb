"""Limits of contact detection: the configured threshold, checked against noise and drift of the foot type."""

from dataclasses import replace

import numpy as np

from footsense.config import Config
from footsense.errors import ConfigError
from footsense.estimation.baseline.contact import ContactLimits
from footsense.estimation.baseline.drift import FASTEST_PF_PER_S
from footsense.estimation.sensitivity import Sensitivity
from footsense.foot.capacitor import CapacitorDesign

#: Least rise of a load over the fastest drift [1].
_OVER_DRIFT_REL = 5.0
#: Least contact threshold over the standard deviation of an element's noise [1].
_OVER_NOISE_REL = 5.0


def closure_rel_per_pf(design: CapacitorDesign) -> float:
    """Return the change of closure over gap per picofarad on an unloaded element [1/pF]."""
    # dC / C = -d(distance) / distance.
    distance_um = float(design.plate_distance_um(np.array([design.unloaded_pf]))[0])
    return distance_um / design.unloaded_pf / design.gap_um


def contact_limits(config: Config, design: CapacitorDesign, force_sensitivity: Sensitivity) -> ContactLimits:
    """Return the limits for one foot type: the stiffer the foot, the more force its drift and noise amount to.

    Args:
        config: The robot.
        design: Capacitors of its feet.
        force_sensitivity: Forces per closure.

    Raises:
        ConfigError: The configured threshold is within the noise of these feet.
    """
    n_per_pf = force_sensitivity.load_n * closure_rel_per_pf(design)
    least_n = _OVER_NOISE_REL * config.rate.noise_ff * 1e-3 * n_per_pf
    if config.contact.threshold_n < least_n:
        raise ConfigError(
            f"contact.threshold_n: {config.contact.threshold_n:g} N are lost in the noise of these feet; "
            f"use at least {least_n:.2g}"
        )
    drift_n_per_s = _OVER_DRIFT_REL * FASTEST_PF_PER_S * n_per_pf
    limits = ContactLimits(threshold_n=config.contact.threshold_n)
    return replace(limits, floor_n_per_s=max(limits.floor_n_per_s, drift_n_per_s))
