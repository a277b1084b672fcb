"""Schema of the JSON files in a foot's calibration folder.

A calibration is the folder that a calibrated foot ships with, `foot-0007/`:

    manifest.json    foot, origin, accuracy, and the SHA-256 of every other file
    parameters.json  how this foot differs from its design
    network.onnx     network of the design that the parameters were fitted on, with its checksum
    card.md          the same for people

The last entry of the manifest is the SHA-256 of its other entries, encoded without spaces in the order of `Manifest`.
So a calibration has one hash, by which recordings name it, and every edit by hand is detected.
"""

import hashlib
from datetime import datetime
from typing import Annotated

import msgspec
from msgspec import Meta

from footsense.foot.force_errors import ForceErrors
from footsense.foot.temperature import COLDEST_C, WARMEST_C
from footsense.frames import ELEMENTS

FORMAT = 3

MANIFEST, PARAMETERS, NETWORK, CARD = "manifest.json", "parameters.json", "network.onnx", "card.md"
#: Files whose hashes are in the manifest.
HASHED_FILES = (PARAMETERS, NETWORK, CARD)

FootId = Annotated[str, Meta(pattern=r"^foot-[0-9]{4}$", description="such as foot-0007")]
Sha256 = Annotated[str, Meta(pattern=r"^[0-9a-f]{64}$")]
PerElement = Annotated[list[float], Meta(min_length=ELEMENTS, max_length=ELEMENTS)]
Three = Annotated[list[float], Meta(min_length=3, max_length=3)]


class Format(msgspec.Struct, frozen=True):
    """Format number of a file, which every version has; read before the other fields."""

    format: int


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
        return hashlib.sha256(msgspec.json.encode(msgspec.structs.replace(self, sha256=""))).hexdigest()

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
    temperature_c: Annotated[float, Meta(ge=COLDEST_C, le=WARMEST_C)] | None
