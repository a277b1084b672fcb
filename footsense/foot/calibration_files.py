"""Schema of the files in a foot's calibration folder, and how they are read: missing, damaged or foreign is an error.

A calibration is the folder that a calibrated foot ships with, `foot-0007/`:

    manifest.json    foot, origin, accuracy, and the SHA-256 of every other file
    parameters.json  how this foot differs from its design
    network.onnx     network of the design that the parameters were fitted on, with its checksum
    card.md          the same for people

The last entry of the manifest is the SHA-256 of its other entries, encoded without spaces in the order of `Manifest`.
So a calibration has one hash, by which recordings name it, and every edit by hand is detected.
"""

import hashlib
import math
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Annotated, TypeVar

import msgspec
import numpy as np
from msgspec import Meta

from footsense.errors import ModelError
from footsense.foot.force_errors import ForceErrors
from footsense.foot.network_card import Format, PerElement, verified_sha256
from footsense.foot.parameters import COLDEST_C, WARMEST_C, FootParameters
from footsense.regular_file import read_regular

FORMAT = 3

MANIFEST, PARAMETERS, NETWORK, CARD = "manifest.json", "parameters.json", "network.onnx", "card.md"
#: Files whose hashes are in the manifest.
HASHED_FILES = (PARAMETERS, NETWORK, CARD)

FootId = Annotated[str, Meta(pattern=r"^foot-[0-9]{4}$", description="such as foot-0007")]
Sha256 = Annotated[str, Meta(pattern=r"^[0-9a-f]{64}$")]
Three = Annotated[list[float], Meta(min_length=3, max_length=3)]


class HeldOutErrors(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Force errors on loads that were not used in the fit, without and with the calibration.

    Attributes:
        protocol: Which loads, in words.
        design_only: Errors of the network alone.
        calibrated: Errors with the parameters of a fit without these loads.
    """

    protocol: Annotated[str, Meta(min_length=1)]
    design_only: ForceErrors
    calibrated: ForceErrors


class Manifest(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Identity and origin of a calibration: foot, date, recordings, checksums.

    Attributes:
        format: Format of these files.
        foot: The foot; also the name of the folder.
        foot_type: Its type.
        footsense: Version that made the calibration.
        made: Time, UTC, ISO 8601.
        n_loads: Number of loads used.
        n_sessions: Number of sessions they are from.
        held_out: Accuracy; None if no load was held out.
        recordings: SHA-256 of every recording used, by file name.
        by_standing: Whether the newest of its loads are of a robot that stands, whose forces nobody measured.
        by_walking: Whether they are of a robot that walks.
        files: SHA-256 of every other file, by name.
        sha256: Hash of all entries above.
    """

    format: int = FORMAT
    foot: FootId
    foot_type: Annotated[str, Meta(min_length=1)]
    footsense: str
    made: Annotated[str, Meta(pattern=r"^\d{4}-\d\d-\d\dT\d\d:\d\d:\d\dZ$")]
    n_loads: Annotated[int, Meta(ge=1)]
    n_sessions: Annotated[int, Meta(ge=1)]
    held_out: HeldOutErrors | None
    recordings: Annotated[dict[str, Sha256], Meta(min_length=1)]
    by_standing: bool = False
    by_walking: bool = False
    files: dict[str, Sha256] = {}
    sha256: str = ""

    def __post_init__(self) -> None:
        """Check that the date exists.

        Raises:
            ValueError: It does not.
        """
        datetime.fromisoformat(self.made)

    @property
    def computed_sha256(self) -> str:
        """SHA-256 of the manifest's entries except `sha256`."""
        entries = msgspec.to_builtins(msgspec.structs.replace(self, sha256=""))
        for name in ("by_standing", "by_walking"):
            if not entries[name]:
                del entries[name]  # calibrations from before it have their hash without it
        return hashlib.sha256(msgspec.json.encode(entries)).hexdigest()

    @property
    def recordings_sha256(self) -> str:
        """One SHA-256 over all recordings, independent of their names."""
        return hashlib.sha256("".join(sorted(self.recordings.values())).encode()).hexdigest()


class Parameters(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """JSON form of `footsense.foot.parameters.FootParameters`, with network checksum and temperature.

    Attributes:
        format: Format of these files.
        network_sha256: Hash of the network that they were fitted on, without its checksum trailer.
        temperature_c: Temperature of the foot on the test stand [degC]; None if not measured.
    """

    format: int
    network_sha256: Sha256
    stray_pf: PerElement
    unloaded_pf: PerElement
    gap_um: PerElement
    gain_rel: PerElement
    stiffness_rel: float
    mount: Annotated[list[Three], Meta(min_length=3, max_length=3)]
    error_rel: float
    size_sigma_rel: float = 0.0
    temperature_c: Annotated[float, Meta(ge=COLDEST_C, le=WARMEST_C)] | None


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


def read_calibration(folder: Path, foot_type: str | None = None, foot: str | None = None) -> FootCalibration:
    """Load the calibration in a folder, and check it for completeness, checksums and the foot.

    Args:
        folder: The folder.
        foot_type: Type that the foot has to be of; None for any.
        foot: The foot that it has to be for; None for the one that the folder is named after, without the number of a
            replaced calibration: `foot-0007`, `foot-0007.1`.

    Raises:
        ModelError: A file is missing, edited, unreadable or of another format, or the calibration is for another foot
            or foot type, or its parameters are impossible.
    """
    if not folder.is_dir():
        raise ModelError(
            f"{folder}: no such calibration; `footsense test-stand calibrate` makes one from recordings of the foot"
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
    if foot_type not in {None, manifest.foot_type}:
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
        return read_regular(path)
    except FileNotFoundError:
        raise ModelError(
            f"{path}: missing; a calibration is used whole or not at all, copy it again"
        ) from None
    except OSError as error:
        raise ModelError(f"{path}: cannot be read: {error.strerror}") from None


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
