"""A calibration, written: whole under its name, or not there.

The files are made in a directory beside, read back with the eyes of the robot, and only then take the name. A calibration
that stands there already is kept under the first free number, `foot-0007.1`, and only if that was asked for.
"""

import hashlib
import os
import shutil
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import msgspec

import footsense
from footsense.calibration.card import card_text
from footsense.errors import CalibrationError
from footsense.foot.calibration_format import (
    CARD,
    FORMAT,
    MANIFEST,
    NETWORK,
    PARAMETERS,
    FootId,
    HeldOut,
    Manifest,
    Parameters,
)
from footsense.foot.calibration_reader import FootCalibration, read_calibration
from footsense.foot.checksum_trailer import unsealed_sha256
from footsense.foot.parameters import FootParameters

__all__ = ["CalibrationContent", "check_calibration_target", "file_sha256", "write_calibration"]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CalibrationContent:
    """What goes into a calibration.

    Attributes:
        foot: Which foot it is for, such as `foot-0007`.
        foot_type: Of which type that is.
        parameters: How the foot differs from its design.
        network: File of the network that they were fitted on, sealed.
        made: Now, UTC, ISO 8601.
        n_loads: On how many loads it rests.
        n_sessions: In how many sessions they were made.
        held_out: How good it is; None if no load was kept to tell.
        recordings: SHA-256 of every recording with those loads, by file name.
        temperature_c: At which the foot was on the bench [degC]; None if nothing there measured it.
        stiffness_per_k: By how much the foot grows stiffer with each kelvin [1/K]; None if nobody measured it.
    """

    foot: str
    foot_type: str
    parameters: FootParameters
    network: Path
    made: str
    n_loads: int
    n_sessions: int
    held_out: HeldOut | None
    recordings: Mapping[str, str]
    temperature_c: float | None = None
    stiffness_per_k: float | None = None


def file_sha256(path: Path) -> str:
    """Return the hash of a file, however long it is.

    Raises:
        CalibrationError: It cannot be read.
    """
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise CalibrationError(f"{path}: cannot be read: {error.strerror}") from None


def check_calibration_target(folder: Path, *, replace: bool) -> None:
    """Check that a calibration may be written to `folder`; to be called before the work is done. Nothing is made yet.

    Raises:
        CalibrationError: Its name is not that of a foot; one is there, and it was not asked to replace it; or nothing
            can be written there.
    """
    try:
        msgspec.convert(folder.name, FootId)
    except msgspec.ValidationError:
        raise CalibrationError(f"{folder.name}: is no identity of a foot, such as foot-0007") from None
    if folder.exists() and not replace:
        raise CalibrationError(
            f"{folder}: exists and is not overwritten; with --replace the old one is kept as {_kept(folder).name}"
        )
    there = next(parent for parent in folder.parents if parent.exists())
    try:
        tempfile.TemporaryDirectory(dir=there, prefix=f".{folder.name}.").cleanup()
    except OSError as error:
        raise CalibrationError(f"{there}: cannot be written to: {error.strerror}") from None


def write_calibration(feet: Path, content: CalibrationContent, *, replace: bool = False) -> FootCalibration:
    """Write a calibration and return it as the robot will read it.

    Args:
        feet: Directory of all calibrations, made if missing.
        content: What goes into it.
        replace: Whether a calibration of this foot that is there already makes room.

    Raises:
        CalibrationError: It is there and may not be replaced, or cannot be written.
        ModelError: The network is none, or what was written is not what a robot would take.
    """
    folder = feet / content.foot
    check_calibration_target(folder, replace=replace)
    try:
        feet.mkdir(parents=True, exist_ok=True)
        draft = Path(tempfile.mkdtemp(dir=feet, prefix=f".{content.foot}."))
        try:
            _write_files(draft, content)
            read_calibration(draft, content.foot_type, content.foot)
            if folder.exists():
                folder.rename(_kept(folder))
            draft.rename(folder)
        finally:
            shutil.rmtree(draft, ignore_errors=True)
        _to_disk(feet)
    except OSError as error:
        raise CalibrationError(f"{folder}: cannot be written: {error.strerror}") from None
    return read_calibration(folder, content.foot_type)


def _kept(folder: Path) -> Path:
    """Return the first free name for the calibration that is replaced."""
    number = 1
    while (kept := folder.with_name(f"{folder.name}.{number}")).exists():
        number += 1
    return kept


def _write_files(draft: Path, content: CalibrationContent) -> None:
    draft.chmod(0o755)  # the service that reads it is another user
    network = content.network.read_bytes()
    own = content.parameters
    parameters = Parameters(
        format=FORMAT,
        network_sha256=unsealed_sha256(network, str(content.network)),
        stray_pf=own.stray_pf.tolist(),
        unloaded_pf=own.unloaded_pf.tolist(),
        gap_um=own.gap_um.tolist(),
        gain_rel=own.gain_rel.tolist(),
        stiffness_rel=own.stiffness_rel,
        mount=own.mount.tolist(),
        correction=own.correction.tolist(),
        error_rel=own.error_rel,
        temperature_c=content.temperature_c,
        stiffness_per_k=content.stiffness_per_k,
    )
    manifest = Manifest(
        format=FORMAT,
        foot=content.foot,
        foot_type=content.foot_type,
        footsense=footsense.__version__,
        made=content.made,
        n_loads=content.n_loads,
        n_sessions=content.n_sessions,
        held_out=content.held_out,
        recordings=dict(content.recordings),
        files={},
    )
    files = {
        PARAMETERS: _json(parameters),
        NETWORK: network,
        CARD: card_text(manifest, parameters).encode(),
    }
    hashes = {name: hashlib.sha256(data).hexdigest() for name, data in files.items()}
    manifest = msgspec.structs.replace(manifest, files=hashes)
    manifest = msgspec.structs.replace(manifest, sha256=manifest.own_sha256)
    for name, data in {**files, MANIFEST: _json(manifest)}.items():
        (draft / name).write_bytes(data)
        _to_disk(draft / name)
    _to_disk(draft)


def _json(value: msgspec.Struct) -> bytes:
    return msgspec.json.format(msgspec.json.encode(value), indent=2) + b"\n"


def _to_disk(path: Path) -> None:
    """Wait until a file or directory is on the disk: a power cut must not leave a name without its content."""
    fd = os.open(path, os.O_RDONLY)
    try:
        os.fsync(fd)
    finally:
        os.close(fd)
