"""Load and check a foot's calibration folder; missing or damaged files, or another foot's, are errors."""

import hashlib
import math
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import msgspec
import numpy as np

from footsense.errors import ModelError
from footsense.foot.files.calibration_format import (
    FORMAT,
    HASHED_FILES,
    MANIFEST,
    NETWORK,
    PARAMETERS,
    Format,
    Manifest,
    Parameters,
)
from footsense.foot.files.checksum_trailer import verified_sha256
from footsense.foot.parameters import FootParameters

#: Largest file that is read [bytes]; a network has 18 thousand.
MAX_FILE_BYTES = 1 << 24

_Struct = TypeVar("_Struct", Manifest, Parameters)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FootCalibration:
    """Loaded calibration of one foot: manifest, parameters, network.

    Attributes:
        folder: Its folder.
        manifest: Its identity and origin.
        parameters: How the foot differs from its design.
        network: File of the network that the parameters were fitted on.
        network_sha256: Hash of that file without its checksum trailer.
        calibrated_at_c: Temperature on the test stand [degC], NaN if not measured.
    """

    folder: Path
    manifest: Manifest
    parameters: FootParameters
    network: Path
    network_sha256: str
    calibrated_at_c: float


def read_calibration(folder: Path, foot_type: str, foot: str | None = None) -> FootCalibration:
    """Load the calibration in a folder, and check it for completeness, checksums and the foot.

    Args:
        folder: The folder.
        foot_type: Type that the foot has to be of.
        foot: The foot that it has to be for; None for the one that the folder is named after, without the number of a
            replaced calibration: `foot-0007`, `foot-0007.1`.

    Raises:
        ModelError: A file is missing, edited, unreadable or of another format, or the calibration is for another foot
            or foot type, or its parameters are impossible.
    """
    if not folder.is_dir():
        raise ModelError(
            f"{folder}: no such calibration; `footsense calibrate` makes one from recordings of the foot"
        )
    path = folder / MANIFEST
    manifest = _decode_json(path, _read_file(path), Manifest)
    foot = foot or folder.absolute().name.partition(".")[0]
    if manifest.sha256 != manifest.computed_sha256:
        raise ModelError(_hash_mismatch_message(path, "its own hash"))
    if manifest.foot != foot:
        raise ModelError(
            f"{folder}: the calibration of {manifest.foot}, not of {foot}; it stays in the folder of its foot"
        )
    if manifest.foot_type != foot_type:
        raise ModelError(
            f"{folder}: for foot type {manifest.foot_type!r}, this robot's feet are {foot_type!r}; "
            f"take the calibration of a {foot_type} foot"
        )
    if set(manifest.files) != set(HASHED_FILES):
        raise ModelError(
            f"{path}: lists {', '.join(sorted(manifest.files))}; a calibration has {', '.join(HASHED_FILES)}"
        )
    contents = {name: _read_file(folder / name) for name in HASHED_FILES}
    for name, content in contents.items():
        if hashlib.sha256(content).hexdigest() != manifest.files[name]:
            raise ModelError(_hash_mismatch_message(folder / name, f"its hash in {MANIFEST}"))
    found = _decode_json(folder / PARAMETERS, contents[PARAMETERS], Parameters)
    network_sha256 = verified_sha256(contents[NETWORK], str(folder / NETWORK))
    if network_sha256 != found.network_sha256:
        raise ModelError(
            f"{folder / NETWORK}: network {network_sha256[:12]}, but the parameters were fitted on "
            f"{found.network_sha256[:12]}; calibrate the foot on this one"
        )
    try:
        parameters = msgspec.convert(
            found, FootParameters, from_attributes=True, dec_hook=lambda _, values: np.array(values)
        )
    except msgspec.ValidationError as error:
        raise ModelError(f"{folder / PARAMETERS}: {error}") from None
    return FootCalibration(
        folder=folder,
        manifest=manifest,
        parameters=parameters,
        network=folder / NETWORK,
        network_sha256=network_sha256,
        calibrated_at_c=math.nan if found.temperature_c is None else found.temperature_c,
    )


def _hash_mismatch_message(path: Path, expected: str) -> str:
    """Return the error message about a file whose content does not match its hash."""
    return (
        f"{path}: does not match {expected}: edited by hand, or damaged; copy the calibration again, or calibrate the "
        "foot again"
    )


def _read_file(path: Path) -> bytes:
    """Return the content of a file of a calibration folder.

    Raises:
        ModelError: It is missing, cannot be read, or is too large.
    """
    try:
        with path.open("rb") as file:
            content = file.read(MAX_FILE_BYTES + 1)
    except FileNotFoundError:
        raise ModelError(
            f"{path}: missing; a calibration is used whole or not at all, copy it again"
        ) from None
    except OSError as error:
        raise ModelError(f"{path}: cannot be read: {error.strerror}") from None
    if len(content) > MAX_FILE_BYTES:
        raise ModelError(f"{path}: has more than the {MAX_FILE_BYTES} bytes that are read")
    return content


def _decode_json(path: Path, content: bytes, kind: type[_Struct]) -> _Struct:
    """Return the content of a JSON file as a struct.

    Raises:
        ModelError: It is of another format, or does not fit.
    """
    try:
        found = msgspec.json.decode(content, type=Format).format
        if found == FORMAT:
            return msgspec.json.decode(content, type=kind)
    except (msgspec.DecodeError, RecursionError) as error:
        raise ModelError(f"{path}: does not fit: {error}") from None
    raise ModelError(
        f"{path}: calibration format {found}, this version reads format {FORMAT}; calibrate the foot again"
    )
