"""Load the network and the calibrations of the feet mounted on a robot."""

import logging
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

from footsense.clock import wall_time_iso
from footsense.config import Config
from footsense.daemon.foot_types import check_foot_type, foot_type_of
from footsense.daemon.setup.expected_error import UNKNOWN, uncertainty_since
from footsense.errors import ModelError
from footsense.estimation.network import Network
from footsense.estimation.rest import trained_response
from footsense.foot.calibration_files import FootCalibration, read_calibration
from footsense.foot.network_card import NETWORK_FILE
from footsense.foot.parameters import KNOWN_EXACTLY, ForceUncertainty
from footsense.foot.response_table import FootResponse
from footsense.foot.type_folders import foot_type_folder
from footsense.sim.uncalibrated import uncertainty_by_wear, uncertainty_of_uncalibrated

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Models:
    """Network and calibrations of the feet mounted on a robot.

    Attributes:
        config: The robot.
        network: Network of the calibrations, of the configuration, or of the foot type.
        calibrations_by_leg: Calibrations of the feet by leg.
        at: Time at which they are read, UTC, ISO 8601: gains of elements wander after a calibration.
    """

    config: Config
    network: Network
    calibrations_by_leg: dict[str, FootCalibration]
    at: str = field(default_factory=wall_time_iso)

    @cached_property
    def response(self) -> FootResponse | None:
        """Response table of the feet; None, and a line why, where there is none or another."""
        try:
            return trained_response(foot_type_folder(self.config.foot_type), self.network)
        except ModelError as error:
            _log.warning("loads at rest are not refined: %s", error)
            return None

    @cached_property
    def uncertainties(self) -> tuple[ForceUncertainty, ...]:
        """What nobody knows of the foot of each leg, in the order of the configuration's legs."""
        found = [self.calibrations_by_leg.get(leg) for leg in self.config.legs]
        uncalibrated, wear = UNKNOWN, KNOWN_EXACTLY
        if not all(found) and self.response is not None:
            uncalibrated = uncertainty_of_uncalibrated(self.network, self.response, len(found))
        if any(found):
            wear = uncertainty_by_wear(self.network, self.response, len(found))
        return tuple(
            uncalibrated if each is None else uncertainty_since(each, self.at, wear) for each in found
        )


def load_models(config: Config, at: str | None = None) -> Models:
    """Load the network and the calibrations of a robot.

    Args:
        config: The robot.
        at: Time of its readings, UTC, ISO 8601; None for now.

    Raises:
        ModelError: One is missing, damaged, or made for another foot type.
    """
    calibrations = load_calibrations(config)
    path = Path(config.model) if config.model else foot_type_folder(config.foot_type) / NETWORK_FILE
    path = next((calibration.network for calibration in calibrations.values()), path)
    network = Network(path, n_rows=len(config.legs))
    check_foot_type(path, network.card.foot_type, config)
    return Models(config, network, calibrations, at or wall_time_iso())


def load_calibrations(config: Config) -> dict[str, FootCalibration]:
    """Load the calibration of every leg whose foot is named; empty without a configured folder.

    A foot that has none yet is read as designed, if the configuration says what it reads unloaded.

    Raises:
        ModelError: A calibration is missing, damaged, or for another foot or foot type; or two were fitted on different
            networks, which would cost a second network call per cycle.
    """
    if config.calibrations is None:
        return {}
    feet: dict[str, str] = dict(config.feet.items())
    foot_type = foot_type_of(config)
    calibrations_by_leg: dict[str, FootCalibration] = {}
    for leg in config.legs:
        foot = feet.get(leg)
        if foot is None:
            _log.warning("%s: no foot is named under feet: the mounted one is read as designed", leg)
            continue
        folder = Path(config.calibrations) / foot
        if leg in config.unloaded_pf and not folder.exists():
            _log.warning(
                "%s: %s has no calibration in %s: it is read as designed", leg, foot, config.calibrations
            )
            continue
        calibrations_by_leg[leg] = calibration = read_calibration(folder, foot_type, foot)
        manifest, first = calibration.manifest, next(iter(calibrations_by_leg.values()))
        if calibration.network_sha256 != first.network_sha256:
            raise ModelError(
                f"{calibration.folder}: fitted on network {calibration.network_sha256[:12]}, {first.manifest.foot} on "
                f"{first.network_sha256[:12]}; a robot has one network, calibrate one of the two again on the other's"
            )
        _log.info("%s: %s by its calibration of %s, %s", leg, foot, manifest.made, manifest.sha256[:12])
    return calibrations_by_leg
