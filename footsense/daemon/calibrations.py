"""Which foot is mounted where, and the calibration that it was calibrated into."""

import logging
from collections.abc import Mapping
from pathlib import Path

from footsense.config import Config
from footsense.errors import ModelError
from footsense.foot.calibration_reader import FootCalibration, read_calibration

__all__ = ["calibrations_difference", "calibrations_entry", "calibrations_of"]

_log = logging.getLogger(__name__)

#: Entry of a recording's header.
CALIBRATIONS_KEY = "calibrations"


def calibrations_of(config: Config, foot_type: str) -> dict[str, FootCalibration]:
    """Return the calibration of every leg whose foot is named; none if the configuration names no calibrations.

    Args:
        config: The robot.
        foot_type: Of its feet.

    Raises:
        ModelError: A calibration is missing, not whole, or for another foot or foot type; or two were fitted on different
            networks, which would cost a second call of the network in every cycle.
    """
    if config.calibrations is None:
        return {}
    feet: Mapping[str, str] = dict(config.feet.items())
    found: dict[str, FootCalibration] = {}
    for leg in config.legs:
        foot = feet.get(leg)
        if foot is None:
            _log.warning(
                "%s: no foot is named under feet: what is mounted is taken for the designed one", leg
            )
            continue
        found[leg] = calibration = read_calibration(Path(config.calibrations) / foot, foot_type, foot)
        first = next(iter(found.values()))
        if calibration.network_sha256 != first.network_sha256:
            raise ModelError(
                f"{calibration.folder}: fitted on network {calibration.network_sha256[:12]}, {first.manifest.foot} on "
                f"{first.network_sha256[:12]}; a robot has one network, calibrate one of the two again on the other's"
            )
        _log.info(
            "%s: %s by its calibration of %s, %s",
            leg,
            foot,
            calibration.manifest.made,
            calibration.manifest.sha256[:12],
        )
    return found


def calibrations_entry(calibrations: Mapping[str, FootCalibration]) -> dict[str, str]:
    """Return what a recording's header says of the calibrations: the hash of each leg's."""
    return {
        CALIBRATIONS_KEY: ",".join(
            f"{leg}={calibration.manifest.sha256}" for leg, calibration in calibrations.items()
        )
    }


def calibrations_difference(
    header: Mapping[str, str], calibrations: Mapping[str, FootCalibration]
) -> str | None:
    """Return which leg's calibration is not the one that was recorded, in words; None if all are.

    Args:
        header: What the recording says of itself; without an entry it was made without calibrations.
        calibrations: Those that are here, by leg.
    """
    entries = [entry.partition("=") for entry in header.get(CALIBRATIONS_KEY, "").split(",") if entry]
    then = {leg: sha256 for leg, _, sha256 in entries}
    here = {leg: calibration.manifest.sha256 for leg, calibration in calibrations.items()}
    for leg in sorted(then.keys() | here.keys()):
        if then.get(leg) != here.get(leg):
            return (
                f"{leg} was recorded with {_named(then.get(leg))}, here is {_named(here.get(leg))}; "
                "only the same calibrations can give the same forces, --calibrations says where they are"
            )
    return None


def _named(sha256: str | None) -> str:
    return "no calibration" if sha256 is None else f"the calibration {sha256[:12]}"
