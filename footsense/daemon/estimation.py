"""From configuration to pipeline: which network, and what its card says about these feet."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray

from footsense.acquisition.scan_plan import BOARDS, ORDERS
from footsense.config import Can, Config
from footsense.config.former_keys import with_present_keys
from footsense.daemon.calibrations import calibrations_of
from footsense.daemon.contact_limits import closure_rel_per_pf, contact_limits
from footsense.daemon.foot_types import artefact, foot_type_of, require_foot_type
from footsense.errors import RecordingError
from footsense.estimation.alignment.element_by_element import ElementByElement
from footsense.estimation.alignment.scan_by_scan import ScanByScan
from footsense.estimation.baseline.tare import TareLimits
from footsense.estimation.calibrated_feet import CalibratedFeet
from footsense.estimation.faults.status import RANGE_END_PF
from footsense.estimation.network import Network
from footsense.estimation.pipeline import Alignment, Pipeline
from footsense.estimation.sensitivity import sensitivity
from footsense.foot.calibration_reader import FootCalibration
from footsense.foot.network_card import TrainedInputs
from footsense.frames import ELEMENTS
from footsense.ports import Estimator
from footsense.recording.replay import Replay

#: Calibrations by leg.
Calibrations = Mapping[str, FootCalibration]
PerElement = Sequence[float] | NDArray[np.float64]

#: Scans in which a step of the load has passed through all elements, and what was made of them.
_SETTLED_SCANS = 4


def load_calibrations(config: Config) -> dict[str, FootCalibration]:
    """Return the calibration of every leg whose foot is named; none if the configuration names no calibrations.

    Raises:
        ModelError: One is missing, or cannot be used for that foot.
    """
    return calibrations_of(config, foot_type_of(config))


def load_network(config: Config, calibrations: Calibrations | None = None) -> Network:
    """Return the network that the configuration names, or that of its foot type.

    Args:
        config: The robot.
        calibrations: Those of its feet, which bring their network; None to read them.

    Raises:
        ModelError: There is none, or it is made for another foot.
    """
    path = Path(config.model) if config.model else artefact(config, "network.onnx")
    for calibration in (load_calibrations(config) if calibrations is None else calibrations).values():
        path = calibration.network
    network = Network(path, n_rows=_n_rows(config))
    require_foot_type(path, network.card.foot_type, config)
    return network


def pipeline_for(
    config: Config, network: Network, flags: int, calibrations: Calibrations | None = None
) -> Pipeline:
    """Return the pipeline of a robot whose frames carry these flags.

    Args:
        config: The robot.
        network: Its network.
        flags: The flags.
        calibrations: Those of its feet; None to read them.

    Raises:
        ModelError: A calibration is missing, or cannot be used for its foot.
        ConfigError: A limit of `contact` is below the noise of these feet.
    """
    calibrations = load_calibrations(config) if calibrations is None else calibrations
    feet = {leg: calibration.parameters for leg, calibration in calibrations.items()}
    trained_inputs = network.card.trained_inputs
    # A leg has these from its foot's calibration or from the configuration, never from both.
    strays_pf: dict[str, PerElement] = dict(config.stray_pf.items())
    strays_pf |= {leg: foot.stray_pf for leg, foot in feet.items()}
    stray_pf = _per_leg(config, strays_pf, 0.0)
    # The design's capacitance knows of no stray; a foot's own reading, as either has it, includes it.
    readings_pf: dict[str, PerElement] = dict(config.unloaded_pf.items())
    readings_pf |= {leg: foot.unloaded_pf for leg, foot in feet.items()}
    expected_pf = _per_leg(config, readings_pf, np.nan)
    unloaded_pf = np.where(np.isnan(expected_pf), trained_inputs.design.rest_pf, expected_pf - stray_pf)
    force_sensitivity = sensitivity(network, _n_rows(config), trained_inputs.moments)
    estimator, set_temperature = _estimator(config, network, calibrations)
    return Pipeline(
        alignment=_alignment(config, trained_inputs, estimator),
        trained=trained_inputs,
        stray_pf=stray_pf,
        unloaded_pf=unloaded_pf,
        sensitivity=force_sensitivity,
        tare=TareLimits(
            window_frames=config.tare.window_scans,
            noise_limit_ff=config.tare.noise_limit_ff,
            unloaded_limit_rel=config.tare.unloaded_limit_rel,
        ),
        contact=contact_limits(config, trained_inputs.design, force_sensitivity),
        track_baseline=config.baseline.track,
        max_age_ns=round(config.stale_after_ms * 1e6),
        settled_ns=round(_SETTLED_SCANS * config.shortest_scan_ms * 1e6),
        flags=flags,
        gap_um=_per_leg(
            config, {leg: foot.gap_um for leg, foot in feet.items()}, trained_inputs.design.gap_um
        ),
        gain_rel=_per_leg(config, {leg: foot.gain_rel for leg, foot in feet.items()}, 1.0),
        feet=[calibrations[leg].manifest.foot if leg in calibrations else "" for leg in config.legs],
        body_weight_n=config.body_weight_n,
        set_temperature=set_temperature,
        range_end_pf=BOARDS[config.board].range_end_pf if config.board in BOARDS else RANGE_END_PF,
    )


def _step_ns(config: Config) -> int:
    """Return the time from one element to the next [ns]: a slow chip, its start, and now and then a row."""
    return round(config.rate.conversion_ns * (1 + 1 / 12))


def _n_rows(config: Config) -> int:
    """Return how many feet the network estimates at once: of a whole scan, each leg two ways."""
    return len(config.legs) * (1 if config.publish == "element" else 2)


def _alignment(config: Config, trained_inputs: TrainedInputs, estimator: Estimator) -> Alignment:
    """Return the alignment of whole scans, or of single elements."""
    if config.publish == "frame":
        return ScanByScan(estimator, len(config.legs), trained_inputs.moments, config.average_scans)
    noise_rel = config.rate.noise_ff * 1e-3 * closure_rel_per_pf(trained_inputs.design)
    order = ORDERS[config.order]
    return ElementByElement(
        estimator, len(config.legs), trained_inputs.moments, order, _step_ns(config), noise_rel
    )


def _estimator(
    config: Config, network: Network, calibrations: Calibrations
) -> tuple[Estimator, Callable[[NDArray[np.float64]], None] | None]:
    """Return the estimator of these feet, and what takes their temperature: None for feet without calibrations."""
    if not calibrations:
        return network, None
    mounted = [calibrations.get(leg) for leg in config.legs]
    feet = CalibratedFeet(
        network,
        [None if calibration is None else calibration.parameters for calibration in mounted],
        _n_rows(config),
    )
    set_temperature = partial(
        feet.set_temperature,
        calibrated_at=[None if calibration is None else calibration.calibrated_at for calibration in mounted],
    )
    set_temperature(np.full(len(mounted), np.nan))
    return feet, set_temperature


def _per_leg(config: Config, values: Mapping[str, PerElement], default: float) -> NDArray[np.float64]:
    return np.array([values.get(leg, (default,) * ELEMENTS) for leg in config.legs])


def recorded_flags(recording: Replay) -> int:
    """Return the flags that every frame of a recording carries; without them in the header, none.

    Raises:
        RecordingError: The header holds something else under their name.
    """
    text = recording.header.get("flags", "0")
    if text not in map(str, range(256)):
        raise RecordingError(f"{recording.path}: the flags of its header are {text[:20]!r}, not 0 to 255")
    return int(text)


def recorded_config(recording: Replay) -> Config:
    """Return the configuration that a recording was made with, its CAN kept inside the process.

    Raises:
        RecordingError: The header holds none that this version reads.
    """
    try:
        data = msgspec.json.decode(recording.header["config"])
        config = msgspec.convert(with_present_keys(data), Config)
    except (KeyError, msgspec.DecodeError, RecursionError) as error:
        raise RecordingError(
            f"{recording.path}: no configuration that this version reads: {error}"
        ) from error
    return msgspec.structs.replace(config, can=Can(interface="virtual"))
