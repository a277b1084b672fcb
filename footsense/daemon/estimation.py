"""Build the estimation pipeline from configuration and models."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from footsense.acquisition.scan_plan import BOARDS
from footsense.daemon.models import Models
from footsense.errors import ConfigError
from footsense.estimation.baseline.contact import ContactLimits
from footsense.estimation.baseline.drift import MAX_DRIFT_PF_PER_S
from footsense.estimation.baseline.tare import TareLimits
from footsense.estimation.calibrated_feet import CalibratedFeet
from footsense.estimation.faults.status import CONVERTER_MAX_PF
from footsense.estimation.pipeline import Pipeline
from footsense.estimation.sensitivity import Sensitivity, sensitivity
from footsense.foot.capacitor import CapacitorDesign
from footsense.frames import ELEMENTS, Vector
from footsense.ports import Estimator

#: Smallest limit of the rise of the load in swing, over the fastest drift [1].
_SWING_RISE_LIMIT_TO_DRIFT_RATIO = 5.0
#: Contact threshold over the feet's largest force, where none is configured [1].
_DEFAULT_CONTACT_THRESHOLD_REL = 0.015
#: Least contact threshold over the standard deviation of an element's noise [1].
_MIN_CONTACT_THRESHOLD_TO_NOISE = 5.0
#: Scans after which a step of the load has passed through all readings that the network sees.
_N_SETTLING_SCANS = 4


def pipeline_for(models: Models, flags: int) -> Pipeline:
    """Return the estimation pipeline of a robot; `flags` are set in all its force frames.

    Args:
        models: The robot with its models.
        flags: Flags of every frame, as in `Flag`.

    Raises:
        ModelError: A calibration cannot be used for its foot.
        ConfigError: A limit of `contact` is below the noise of these feet.
    """
    config, network, calibrations = models.config, models.network, models.calibrations_by_leg
    trained_inputs = network.card.trained_inputs
    design = trained_inputs.design
    stray_pf, unloaded_pf = stray_and_unloaded_pf(models)
    force_sensitivity = sensitivity(network, len(config.legs), trained_inputs.moments)
    estimator, set_temperature = _estimator_and_temperature_setter(models)
    scan_ns = round(config.shortest_scan_ms * 1e6)
    return Pipeline(
        estimator=estimator,
        trained=trained_inputs,
        stray_pf=stray_pf,
        unloaded_pf=unloaded_pf,
        sensitivity=force_sensitivity,
        tare=TareLimits(
            window_scans=config.tare.window_scans,
            noise_limit_ff=config.tare.noise_limit_ff,
            unloaded_limit_rel=config.tare.unloaded_limit_rel,
        ),
        contact=_contact_limits(models, force_sensitivity),
        track_baseline=config.baseline.track,
        scan_ns=scan_ns,
        max_age_ns=round(config.effective_max_age_ms * 1e6),
        settling_time_ns=_N_SETTLING_SCANS * scan_ns,
        flags=flags,
        gap_um=_element_parameter(models, "gap_um", {}, design.gap_um),
        gain_rel=_element_parameter(models, "gain_rel", {}, 1.0),
        feet=[calibrations[leg].manifest.foot if leg in calibrations else "" for leg in config.legs],
        set_temperature=set_temperature,
        range_end_pf=BOARDS[config.board].range_end_pf if config.board in BOARDS else CONVERTER_MAX_PF,
    )


def stray_and_unloaded_pf(models: Models) -> tuple[Vector, Vector]:
    """Return stray, and unloaded capacitance without stray, of each element [pF], shape (legs, elements) each."""
    # The design's capacitance excludes stray; a configured or calibrated reading of the foot includes it.
    stray_pf = _element_parameter(models, "stray_pf", models.config.stray_pf, 0.0)
    reading_pf = _element_parameter(models, "unloaded_pf", models.config.unloaded_pf, np.nan)
    designed_pf = models.network.card.trained_inputs.design.unloaded_pf
    return stray_pf, np.where(np.isnan(reading_pf), designed_pf, reading_pf - stray_pf)


def distance_times_capacitance_pf(models: Models) -> Vector:
    """Return relative plate distance times capacitance of each element (constant) [pF], shape (legs, elements)."""
    design = models.network.card.trained_inputs.design
    gain_rel = _element_parameter(models, "gain_rel", {}, 1.0)
    return design.plate_distance_um(np.ones(1)) / design.gap_um / gain_rel


def _estimator_and_temperature_setter(models: Models) -> tuple[Estimator, Callable[[Vector], None] | None]:
    """Return the feet's estimator, and the function that takes their temperature (None uncalibrated)."""
    if not models.calibrations_by_leg:
        return models.network, None
    mounted = [models.calibrations_by_leg.get(leg) for leg in models.config.legs]
    feet = CalibratedFeet(
        models.network, [foot.parameters if foot else None for foot in mounted], len(mounted)
    )
    set_temperature = partial(
        feet.set_temperature,
        calibrated_at=[foot.calibrated_at_c if foot else None for foot in mounted],
    )
    set_temperature(np.full(len(mounted), np.nan))
    return feet, set_temperature


def _element_parameter(
    models: Models, name: str, configured: Mapping[Any, Sequence[float]], default: float
) -> Vector:
    """Return a parameter of each element, shape (legs, elements): calibrated, else configured, else default."""
    values: dict[str, Sequence[float] | Vector] = dict(configured)
    values |= {leg: getattr(found.parameters, name) for leg, found in models.calibrations_by_leg.items()}
    return np.array([values.get(leg, (default,) * ELEMENTS) for leg in models.config.legs])


def _closure_rel_per_pf(design: CapacitorDesign) -> float:
    """Return the derivative of relative gap closure by capacitance of an unloaded element [1/pF]."""
    # dC / C = -d(distance) / distance.
    distance_um = float(design.plate_distance_um(np.array([design.unloaded_pf]))[0])
    return distance_um / design.unloaded_pf / design.gap_um


def contact_threshold_n(models: Models) -> float:
    """Return the contact threshold [N]: configured, or a fraction of the largest force that the network knows."""
    configured = models.config.contact.threshold_n
    default_n = round(_DEFAULT_CONTACT_THRESHOLD_REL * models.network.card.max_trained_force_n, 6)
    return default_n if configured is None else configured


def _contact_limits(models: Models, force_sensitivity: Sensitivity) -> ContactLimits:
    """Return the contact thresholds of a foot type, above the force errors that drift and noise cause.

    Args:
        models: The robot and its feet.
        force_sensitivity: Forces per closure.

    Raises:
        ConfigError: The configured threshold is within the noise of these feet.
    """
    n_per_pf = force_sensitivity.load_n_per_mean_closure * _closure_rel_per_pf(
        models.network.card.trained_inputs.design
    )
    threshold_n = contact_threshold_n(models)
    least_n = _MIN_CONTACT_THRESHOLD_TO_NOISE * models.config.conversion_rate.noise_ff * 1e-3 * n_per_pf
    if threshold_n < least_n:
        raise ConfigError(
            f"contact.threshold_n: {threshold_n:g} N are lost in the noise of these feet; "
            f"use at least {least_n:.2g}"
        )
    drift_n_per_s = _SWING_RISE_LIMIT_TO_DRIFT_RATIO * MAX_DRIFT_PF_PER_S * n_per_pf
    limits = ContactLimits(min_threshold_n=threshold_n)
    return replace(limits, max_swing_rise_n_per_s=max(limits.max_swing_rise_n_per_s, drift_n_per_s))
