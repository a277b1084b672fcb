"""A calibration, read and checked: it is used whole and for its own foot, or not at all."""

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import msgspec
import numpy as np

from footsense.errors import ModelError
from footsense.foot.calibration_format import (
    FILES,
    FORMAT,
    MANIFEST,
    NETWORK,
    PARAMETERS,
    Format,
    Manifest,
    Parameters,
)
from footsense.foot.checksum_trailer import unsealed_sha256
from footsense.foot.parameters import FootParameters
from footsense.foot.temperature import STIFFNESS_PER_K, CalibratedAt

__all__ = ["FootCalibration", "read_calibration"]

#: Largest file that is read [bytes]; a network has 18 thousand.
MAX_BYTES = 1 << 24

_Struct = TypeVar("_Struct", Manifest, Parameters)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FootCalibration:
    """All that is known of one foot.

    Attributes:
        folder: Where it was read.
        manifest: What it says of itself.
        parameters: How the foot differs from its design.
        network: File of the network that they were fitted on.
        network_sha256: Hash of that file without its seal.
        calibrated_at: At which temperature the foot was on the bench.
    """

    folder: Path
    manifest: Manifest
    parameters: FootParameters
    network: Path
    network_sha256: str
    calibrated_at: CalibratedAt


def read_calibration(folder: Path, foot_type: str, foot: str | None = None) -> FootCalibration:
    """Return the calibration in a directory.

    Args:
        folder: The directory.
        foot_type: Of which type the foot has to be.
        foot: Which foot it has to be for; None for the one that the directory is named after, where the calibrations that
            were replaced end in a number: `foot-0007`, `foot-0007.1`.

    Raises:
        ModelError: A file is missing, was edited, is of another format or not readable, or the calibration is for another
            foot or foot type, or its parameters are none.
    """
    if not folder.is_dir():
        raise ModelError(
            f"{folder}: no such calibration; `footsense calibrate` makes one from recordings of the foot"
        )
    path = folder / MANIFEST
    manifest = _decoded(path, _content(path), Manifest)
    foot = foot or folder.absolute().name.partition(".")[0]
    if manifest.sha256 != manifest.own_sha256:
        raise ModelError(_edited(path, "what it says"))
    if manifest.foot != foot:
        raise ModelError(
            f"{folder}: the calibration of {manifest.foot}, not of {foot}; a calibration stays in the directory of its foot"
        )
    if manifest.foot_type != foot_type:
        raise ModelError(
            f"{folder}: for foot type {manifest.foot_type!r}, this robot's feet are {foot_type!r}; "
            f"take the calibration of a {foot_type} foot"
        )
    if set(manifest.files) != set(FILES):
        raise ModelError(
            f"{path}: lists {', '.join(sorted(manifest.files))}; a calibration has {', '.join(FILES)}"
        )
    contents = {name: _content(folder / name) for name in FILES}
    for name, content in contents.items():
        if hashlib.sha256(content).hexdigest() != manifest.files[name]:
            raise ModelError(_edited(folder / name, f"what {MANIFEST} has the hash of"))
    found = _decoded(folder / PARAMETERS, contents[PARAMETERS], Parameters)
    network_sha256 = unsealed_sha256(contents[NETWORK], str(folder / NETWORK))
    if network_sha256 != found.network_sha256:
        raise ModelError(
            f"{folder / NETWORK}: network {network_sha256[:12]}, but the parameters were fitted on "
            f"{found.network_sha256[:12]}; calibrate the foot on this one"
        )
    return FootCalibration(
        folder=folder,
        manifest=manifest,
        parameters=_parameters(folder / PARAMETERS, found),
        network=folder / NETWORK,
        network_sha256=network_sha256,
        calibrated_at=CalibratedAt(
            found.temperature_c,
            STIFFNESS_PER_K if found.stiffness_per_k is None else found.stiffness_per_k,
        ),
    )


def _edited(path: Path, than: str) -> str:
    return f"{path}: is not {than}: edited by hand, or damaged; copy the calibration again, or calibrate the foot again"


def _content(path: Path) -> bytes:
    """Return the bytes of a file of a calibration.

    Raises:
        ModelError: It is missing, cannot be read, or is larger than any such file.
    """
    try:
        if path.is_file() and path.stat().st_size > MAX_BYTES:
            raise ModelError(f"{path}: has {path.stat().st_size} bytes, at most {MAX_BYTES} are read")
        return path.read_bytes()
    except FileNotFoundError:
        raise ModelError(f"{path}: missing; a calibration is whole or of no use, copy it again") from None
    except OSError as error:
        raise ModelError(f"{path}: cannot be read: {error.strerror}") from None


def _decoded(path: Path, content: bytes, kind: type[_Struct]) -> _Struct:
    """Return what a file of JSON holds.

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


def _parameters(path: Path, found: Parameters) -> FootParameters:
    """Return the parameters as the daemon computes with them.

    Raises:
        ModelError: A value is not finite, or no foot can have it.
    """
    try:
        return FootParameters(
            stray_pf=np.array(found.stray_pf),
            unloaded_pf=np.array(found.unloaded_pf),
            gap_um=np.array(found.gap_um),
            gain_rel=np.array(found.gain_rel),
            stiffness_rel=found.stiffness_rel,
            mount=np.array(found.mount),
            correction=np.array(found.correction),
            error_rel=found.error_rel,
        )
    except ValueError as error:
        raise ModelError(f"{path}: {error}") from None
