"""Build the estimation pipeline from configuration and models."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from firmware_interface.chips import ad7147, fdc1004
from footsense.daemon.models import Models
from footsense.errors import ConfigError
from footsense.estimation.drift import load_n_per_pf
from footsense.estimation.network import sensitivity
from footsense.estimation.pipeline import Pipeline, pipeline_of
from footsense.estimation.settings import SIGMAS, EstimationLimits, MountedFeet
from footsense.frames import ELEMENTS, Vector


def pipeline_for(models: Models, flags: int) -> Pipeline:
    """Return the estimation pipeline of a robot; `flags` are set in all its force frames.

    Args:
        models: The robot with its models.
        flags: Flags of every frame, as in `Flag`.

    Raises:
        ModelError: A calibration cannot be used for its foot.
        ConfigError: The limit of `contact` is below the noise of these feet.
    """
    config = models.config
    _check_contact_threshold(models)
    limits = EstimationLimits(
        scan_ns=round(config.shortest_scan_ms * 1e6),
        range_end_pf=ad7147.RANGE_END_PF if config.board == "ad7147" else fdc1004.RANGE_END_PF,
        tare=config.tare,
        contact=config.contact,
        max_age_ns=round(config.effective_max_age_ms * 1e6),
        track_baseline=config.baseline.track,
    )
    feet = replace(mounted_feet(models), uncertainty=models.uncertainties)
    return pipeline_of(models.network, feet, limits, models.response, flags=flags)


def mounted_feet(models: Models) -> MountedFeet:
    """Return the parameters of a robot's feet: calibrated, else configured, else those of the design.

    As if they were known exactly: `Models.uncertainties` has what nobody knows.
    """
    config, mounted = models.config, [models.calibrations_by_leg.get(leg) for leg in models.config.legs]

    def configured(values: Mapping[Any, Sequence[float]], default: float) -> Vector:
        none, calibrated = (default,) * ELEMENTS, models.calibrations_by_leg
        return np.array([none if leg in calibrated else values.get(leg, none) for leg in config.legs])

    return MountedFeet.of(
        models.network.card.trained_inputs.design,
        [foot.parameters if foot else None for foot in mounted],
        stray_pf=configured(config.stray_pf, 0.0),
        reading_pf=configured(config.unloaded_pf, np.nan),
        names=[foot.manifest.foot if foot else "" for foot in mounted],
        calibrated_at_c=[foot.calibrated_at_c if foot else None for foot in mounted],
    )


def contact_threshold_n(models: Models) -> float:
    """Return the contact threshold [N]: configured, or a fraction of the largest force that the network knows."""
    return models.config.contact.least_n(models.network.card.max_trained_force_n)


def unloaded_limit_n(models: Models) -> float:
    """Return the load along the leg from which a tare is refused, of feet as designed [N]."""
    unloaded_pf = models.network.card.trained_inputs.design.unloaded_pf
    return models.config.tare.mean_limit_rel * unloaded_pf * _n_per_pf(models)


def _n_per_pf(models: Models) -> float:
    trained = models.network.card.trained_inputs
    return load_n_per_pf(
        trained.design, sensitivity(models.network, len(models.config.legs), trained.moments)
    )


def _check_contact_threshold(models: Models) -> None:
    """Raise an error if the configured threshold is within the noise of these feet.

    Raises:
        ConfigError: It is.
    """
    threshold_n = contact_threshold_n(models)
    # With the noise of a reading on all elements.
    least_n = SIGMAS * models.config.conversion_rate.noise_ff * 1e-3 * _n_per_pf(models)
    if threshold_n < least_n:
        raise ConfigError(
            f"contact.threshold_n: {threshold_n:g} N are lost in the noise of these feet; "
            f"use at least {least_n:.2g}"
        )
