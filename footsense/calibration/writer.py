"""Write a calibration folder atomically: complete under its final name, or not at all.

The files are made in a folder beside, read back as the robot reads them, and only then get the name. An existing
calibration is kept under the first free number, `foot-0007.1`, and only replaced on request.
"""

import hashlib
import os
import shutil
import tempfile
from pathlib import Path

import msgspec

from footsense.calibration.card import card_text
from footsense.errors import CalibrationError
from footsense.foot.files import calibration_format
from footsense.foot.files.calibration_reader import FootCalibration, read_calibration
from footsense.foot.files.checksum_trailer import verified_sha256
from footsense.foot.parameters import FootParameters


def file_sha256(path: Path) -> str:
    """Return the SHA-256 of a file as hexadecimal digits; reads it in blocks.

    Raises:
        CalibrationError: It cannot be read.
    """
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise CalibrationError(f"{path}: cannot be read: {error.strerror}") from None


def check_calibration_target(folder: Path, *, replace: bool) -> None:
    """Raise an error if a calibration cannot be written to `folder`; creates nothing.

    Raises:
        CalibrationError: Its name is not that of a foot; it exists and is not to be replaced; or its parent cannot be
            written to.
    """
    try:
        msgspec.convert(folder.name, calibration_format.FootId)
    except msgspec.ValidationError:
        raise CalibrationError(f"{folder.name}: is no identity of a foot, such as foot-0007") from None
    if folder.exists() and not replace:
        raise CalibrationError(
            f"{folder}: exists and is not overwritten; with --replace the old one is kept as "
            f"{_free_backup_path(folder).name}"
        )
    parent = next(parent for parent in folder.parents if parent.exists())
    try:
        tempfile.TemporaryDirectory(dir=parent, prefix=f".{folder.name}.").cleanup()
    except OSError as error:
        raise CalibrationError(f"{parent}: cannot be written to: {error.strerror}") from None


def write_calibration(
    calibrations: Path,
    manifest: calibration_format.Manifest,
    parameters: FootParameters,
    network: Path,
    *,
    temperature_c: float | None = None,
    replace: bool = False,
) -> FootCalibration:
    """Write a calibration folder, and return the calibration as loaded back from it.

    Args:
        calibrations: Folder of all calibrations, created if missing.
        manifest: Its manifest; the hashes of its files are filled in.
        parameters: Parameters of the foot.
        network: File of the network that they were fitted on, with its checksum.
        temperature_c: Temperature of the foot on the test stand [degC]; None if not measured.
        replace: Whether an existing calibration of this foot is replaced.

    Raises:
        CalibrationError: It exists and must not be replaced, or cannot be written.
        ModelError: The network is none, or the robot would refuse the result.
    """
    folder = calibrations / manifest.foot
    check_calibration_target(folder, replace=replace)
    try:
        content = network.read_bytes()
        described = calibration_format.Parameters(
            format=calibration_format.FORMAT,
            network_sha256=verified_sha256(content, str(network)),
            temperature_c=temperature_c,
            **parameters.as_lists(),
        )
        files = {
            calibration_format.PARAMETERS: _to_json(described),
            calibration_format.NETWORK: content,
            calibration_format.CARD: card_text(manifest, described).encode(),
        }
        hashes = {name: hashlib.sha256(data).hexdigest() for name, data in files.items()}
        manifest = msgspec.structs.replace(manifest, files=hashes)
        manifest = msgspec.structs.replace(manifest, sha256=manifest.computed_sha256)
        calibrations.mkdir(parents=True, exist_ok=True)
        draft = Path(tempfile.mkdtemp(dir=calibrations, prefix=f".{manifest.foot}."))
        try:
            draft.chmod(0o755)  # the service runs as another user
            for name, data in {**files, calibration_format.MANIFEST: _to_json(manifest)}.items():
                (draft / name).write_bytes(data)
                _fsync(draft / name)
            _fsync(draft)
            read_calibration(draft, manifest.foot_type, manifest.foot)
            if folder.exists():
                folder.rename(_free_backup_path(folder))
            draft.rename(folder)
        finally:
            shutil.rmtree(draft, ignore_errors=True)
        _fsync(calibrations)
    except OSError as error:
        raise CalibrationError(f"{folder}: cannot be written: {error.strerror}") from None
    return read_calibration(folder, manifest.foot_type)


def _free_backup_path(folder: Path) -> Path:
    """Return the first unused path to which the replaced calibration can be renamed."""
    number = 1
    while (kept := folder.with_name(f"{folder.name}.{number}")).exists():
        number += 1
    return kept


def _to_json(value: msgspec.Struct) -> bytes:
    """Return a struct as indented JSON."""
    return msgspec.json.format(msgspec.json.encode(value), indent=2) + b"\n"


def _fsync(path: Path) -> None:
    """Flush a file or folder to disk, so that a power cut leaves no name without content."""
    fd = os.open(path, os.O_RDONLY)
    try:
        os.fsync(fd)
    finally:
        os.close(fd)
