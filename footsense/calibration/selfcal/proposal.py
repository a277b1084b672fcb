"""Calibrations that are proposed, written beside the states; taken into use only by a person's command."""

import shutil
from pathlib import Path

import footsense
from footsense.calibration.selfcal.state import state_path
from footsense.calibration.selfcal.walking_foot import WalkingFoot
from footsense.calibration.writer import file_sha256, write_calibration
from footsense.errors import CalibrationError
from footsense.foot.calibration_files import FootCalibration, Manifest, read_calibration

#: Folder of the proposals, beside the states.
_PROPOSED = "proposed"


def propose(folder: Path, foot: WalkingFoot, network: Path, calibrated_at_c: float, made: str) -> None:
    """Write the calibration that a foot's walking makes, in place of an older proposal.

    Args:
        folder: Folder of the states, which has that of the foot.
        foot: The foot, which has a name.
        network: File of the network in use.
        calibrated_at_c: Temperature of the calibration in use [degC]; NaN if it is not known.
        made: When it walked, UTC, ISO 8601.

    Raises:
        CalibrationError: It cannot be written.
    """
    withdraw(folder, foot.of.foot)
    state = state_path(folder, foot.of.leg)
    manifest = Manifest(
        foot=foot.of.foot,
        foot_type=foot.of.foot_type,
        footsense=footsense.__version__,
        made=made,
        n_loads=max(foot.n_instants, 1),
        n_sessions=1,
        held_out=None,
        recordings={state.name: file_sha256(state)},
        by_walking=True,
    )
    write_calibration(folder / _PROPOSED, manifest, foot.parameters(), network, temperature_c=calibrated_at_c)


def withdraw(folder: Path, foot: str) -> None:
    """Remove what is proposed for a foot, if there is anything."""
    if foot:
        shutil.rmtree(folder / _PROPOSED / foot, ignore_errors=True)


def proposed_feet(folder: Path) -> list[str]:
    """Return the feet for which there is a proposal in the folder of the states."""
    return sorted(path.name for path in (folder / _PROPOSED).glob("foot-*"))


def accept(folder: Path, foot: str, calibrations: Path) -> FootCalibration:
    """Take a proposal into use; the former calibration is kept.

    Args:
        folder: Folder of the states.
        foot: The foot.
        calibrations: Folder of all calibrations.

    Raises:
        CalibrationError: There is none, or it cannot be written.
        ModelError: It is damaged.
    """
    if foot not in proposed_feet(folder):
        raise CalibrationError(f"{foot}: nothing is proposed in {folder}")
    proposed = read_calibration(folder / _PROPOSED / foot)
    taken = write_calibration(
        calibrations,
        proposed.manifest,
        proposed.parameters,
        proposed.network,
        temperature_c=proposed.calibrated_at_c,
        replace=True,
    )
    withdraw(folder, foot)
    return taken
