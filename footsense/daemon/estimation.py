"""Build the estimation pipeline from configuration and models."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from firmware_interface.chips import ad7147
from footsense.acquisition.boards import fdc1004
from footsense.config import Config
from footsense.daemon.models import Models, load_response
from footsense.errors import ConfigError
from footsense.estimation.calibrated_feet import CalibratedFeet
from footsense.estimation.drift import load_n_per_pf, max_swing_rise_n_per_s
from footsense.estimation.network import sensitivity
from footsense.estimation.pipeline import Pipeline
from footsense.estimation.rest import RefinedAtRest
from footsense.estimation.settings import (
    CONVERTER_MAX_PF,
    DEFAULT_CONTACT_THRESHOLD_REL,
    UNCALIBRATED_GAIN_SIGMA_REL,
    EstimationLimits,
    MountedFeet,
    Sensitivity,
)
from footsense.frames import ELEMENTS, Vector
from footsense.ports import LoadEstimator

#: Least contact threshold over the standard deviation of an element's noise [1].
_MIN_CONTACT_THRESHOLD_TO_NOISE = 5.0


def pipeline_for(models: Models, flags: int) -> Pipeline:
    """Return the estimation pipeline of a robot; `flags` are set in all its force frames.

    Args:
        models: The robot with its models.
        flags: Flags of every frame, as in `Flag`.

    Raises:
        ModelError: A calibration cannot be used for its foot.
        ConfigError: The limit of `contact` is below the noise of these feet.
    """
    config, network = models.config, models.network
    trained = network.card.trained_inputs
    force_sensitivity = sensitivity(network, len(config.legs), trained.moments)
    limits = EstimationLimits(
        tare=config.tare,
        least_contact_n=contact_threshold_n(models),
        max_swing_rise_n_per_s=_max_swing_rise_n_per_s(models, force_sensitivity),
        scan_ns=round(config.shortest_scan_ms * 1e6),
        max_age_ns=round(config.effective_max_age_ms * 1e6),
        friction=math.nan if config.contact.friction is None else config.contact.friction,
        track_baseline=config.baseline.track,
        range_end_pf=_range_end_pf(config),
    )
    estimator, set_temperature = _estimator_and_temperature_setter(models)
    return Pipeline(
        estimator, trained, mounted_feet(models), limits, force_sensitivity, flags, set_temperature
    )


def _range_end_pf(config: Config) -> float:
    """Return the capacitance over the range of a robot's converters [pF]; of unknown ones the most of any."""
    if config.board == "ad7147":
        return ad7147.RANGE_END_PF
    return fdc1004.RANGE_END_PF if config.board == "fdc1004" else CONVERTER_MAX_PF


def mounted_feet(models: Models) -> MountedFeet:
    """Return the parameters of a robot's feet: calibrated, else configured, else those of the design."""
    config, calibrations = models.config, models.calibrations_by_leg
    design = models.network.card.trained_inputs.design

    def values(name: str, configured: Mapping[Any, Sequence[float]], default: float) -> Vector:
        calibrated = {leg: getattr(found.parameters, name) for leg, found in calibrations.items()}
        known: dict[str, Sequence[float]] = {**configured, **calibrated}
        return np.array([known.get(leg, (default,) * ELEMENTS) for leg in config.legs])

    # The design's capacitance excludes stray; a configured or calibrated reading of the foot includes it.
    stray_pf = values("stray_pf", config.stray_pf, 0.0)
    reading_pf = values("unloaded_pf", config.unloaded_pf, np.nan)
    return MountedFeet(
        stray_pf=stray_pf,
        unloaded_pf=np.where(np.isnan(reading_pf), design.unloaded_pf, reading_pf - stray_pf),
        gap_um=values("gap_um", {}, design.gap_um),
        gain_rel=values("gain_rel", {}, 1.0),
        gain_sigma_rel=np.array(
            [0.0 if leg in calibrations else UNCALIBRATED_GAIN_SIGMA_REL for leg in config.legs]
        ),
        names=tuple(calibrations[leg].manifest.foot if leg in calibrations else "" for leg in config.legs),
    )


def _estimator_and_temperature_setter(
    models: Models,
) -> tuple[LoadEstimator, Callable[[Vector], None] | None]:
    """Return the feet's estimator, and the function that takes their temperature (None uncalibrated)."""
    network: LoadEstimator = models.network
    if (response := load_response(models)) is not None:
        network = RefinedAtRest(
            network, response, models.network.card.trained_inputs, len(models.config.legs)
        )
    if not models.calibrations_by_leg:
        return network, None
    mounted = [models.calibrations_by_leg.get(leg) for leg in models.config.legs]
    feet = CalibratedFeet(
        network,
        [foot.parameters if foot else None for foot in mounted],
        [foot.calibrated_at_c if foot else None for foot in mounted],
    )
    feet.set_temperature(np.full(len(mounted), np.nan))
    return feet, feet.set_temperature


def contact_threshold_n(models: Models) -> float:
    """Return the contact threshold [N]: configured, or a fraction of the largest force that the network knows."""
    configured = models.config.contact.threshold_n
    default_n = round(DEFAULT_CONTACT_THRESHOLD_REL * models.network.card.max_trained_force_n, 6)
    return default_n if configured is None else configured


def unloaded_limit_n(models: Models) -> float:
    """Return the load along the leg from which a tare is refused, of feet as designed [N]."""
    trained = models.network.card.trained_inputs
    n_per_pf = load_n_per_pf(
        trained.design, sensitivity(models.network, len(models.config.legs), trained.moments)
    )
    return models.config.tare.mean_limit_rel * trained.design.unloaded_pf * n_per_pf


def _max_swing_rise_n_per_s(models: Models, force_sensitivity: Sensitivity) -> float:
    """Return the limit of the rise of the load in swing [N/s], above the force errors that drift causes.

    Raises:
        ConfigError: The configured threshold is within the noise of these feet.
    """
    n_per_pf = load_n_per_pf(models.network.card.trained_inputs.design, force_sensitivity)
    threshold_n = contact_threshold_n(models)
    least_n = _MIN_CONTACT_THRESHOLD_TO_NOISE * models.config.conversion_rate.noise_ff * 1e-3 * n_per_pf
    if threshold_n < least_n:
        raise ConfigError(
            f"contact.threshold_n: {threshold_n:g} N are lost in the noise of these feet; "
            f"use at least {least_n:.2g}"
        )
    return max_swing_rise_n_per_s(n_per_pf)
