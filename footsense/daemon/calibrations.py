"""The calibrations of the feet that are mounted on a robot."""

import logging
from collections.abc import Mapping
from pathlib import Path

from footsense.config import Config
from footsense.errors import ModelError
from footsense.foot.calibration_reader import FootCalibration, read_calibration

__all__ = ["calibrations_difference", "calibrations_entry", "calibrations_of"]

_log = logging.getLogger(__name__)

#: Entry of a recording's header.
_KEY = "calibrations"


def calibrations_of(config: Config, foot_type: str) -> dict[str, FootCalibration]:
    """Return the calibration of every leg whose foot is named; empty if the configuration names no folder of them.

    Args:
        config: The robot.
        foot_type: Type of its feet.

    Raises:
        ModelError: A calibration is missing, damaged, or for another foot or foot type; or two were fitted on different
            networks, which would cost a second network call per cycle.
    """
    if config.calibrations is None:
        return {}
    feet: Mapping[str, str] = dict(config.feet.items())
    found: dict[str, FootCalibration] = {}
    for leg in config.legs:
        foot = feet.get(leg)
        if foot is None:
            _log.warning("%s: no foot is named under feet: the mounted one is read as designed", leg)
            continue
        found[leg] = calibration = read_calibration(Path(config.calibrations) / foot, foot_type, foot)
        manifest, first = calibration.manifest, next(iter(found.values()))
        if calibration.network_sha256 != first.network_sha256:
            raise ModelError(
                f"{calibration.folder}: fitted on network {calibration.network_sha256[:12]}, {first.manifest.foot} on "
                f"{first.network_sha256[:12]}; a robot has one network, calibrate one of the two again on the other's"
            )
        _log.info("%s: %s by its calibration of %s, %s", leg, foot, manifest.made, manifest.sha256[:12])
    return found


def calibrations_entry(calibrations: Mapping[str, FootCalibration]) -> dict[str, str]:
    """Return the entry of a recording's header: the hash of each leg's calibration."""
    hashes = (f"{leg}={calibration.manifest.sha256}" for leg, calibration in calibrations.items())
    return {_KEY: ",".join(hashes)}


def calibrations_difference(
    header: Mapping[str, str], calibrations: Mapping[str, FootCalibration]
) -> str | None:
    """Return which leg's calibration is not the recorded one, in words; None if all are.

    Args:
        header: Header of the recording; without an entry it was made without calibrations.
        calibrations: Those used now, by leg.
    """
    entries = [entry.partition("=") for entry in header.get(_KEY, "").split(",") if entry]
    then = {leg: sha256 for leg, _, sha256 in entries}
    here = {leg: calibration.manifest.sha256 for leg, calibration in calibrations.items()}
    for leg in sorted(then.keys() | here.keys()):
        if then.get(leg) != here.get(leg):
            return (
                f"{leg} was recorded with {_named(then.get(leg))}, here is {_named(here.get(leg))}; "
                "only the same calibrations give the same forces, --calibrations names their folder"
            )
    return None


def _named(sha256: str | None) -> str:
    return "no calibration" if sha256 is None else f"the calibration {sha256[:12]}"
