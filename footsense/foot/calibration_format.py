"""The files of a calibration, as they stand on disk.

A calibration is the directory that a calibrated foot ships with, `foot-0007/`:

    manifest.json    what it is, of what it was made, how good it is, and the SHA-256 of every other file
    parameters.json  how this foot differs from its design
    network.onnx     the network of the design that the parameters were fitted on, sealed (foot/checksum_trailer.py)
    card.md          the same for people

The manifest seals itself too: its last entry is the SHA-256 of the others, written without space and in the order of
`Manifest`. So a calibration has one hash, by which recordings name it, and whatever is edited in it by hand shows.
"""

import hashlib
from typing import Annotated

import msgspec
from msgspec import Meta

from footsense.foot.force_errors import Errors
from footsense.foot.parameters import FEATURES
from footsense.foot.temperature import COLDEST_C, WARMEST_C

FORMAT = 1

MANIFEST, PARAMETERS, NETWORK, CARD = "manifest.json", "parameters.json", "network.onnx", "card.md"
#: What a manifest has the hashes of.
FILES = (PARAMETERS, NETWORK, CARD)

FootId = Annotated[str, Meta(pattern=r"^foot-[0-9]{4}$")]
Sha256 = Annotated[str, Meta(pattern=r"^[0-9a-f]{64}$")]
Nine = Annotated[list[float], Meta(min_length=9, max_length=9)]
Three = Annotated[list[float], Meta(min_length=3, max_length=3)]
Rows = Annotated[
    list[Annotated[list[float], Meta(min_length=FEATURES, max_length=FEATURES)]], Meta(min_length=3)
]


class Format(msgspec.Struct, frozen=True):
    """The one field that every format has; it is looked at first, as another one may lack what this one has."""

    format: int


class HeldOut(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """How good a calibration is, by loads that were kept from the fit.

    Attributes:
        protocol: Which loads those were, in words.
        design_only: Errors of the network alone on them.
        calibrated: Errors with the parameters of a fit without them.
    """

    protocol: Annotated[str, Meta(min_length=1)]
    design_only: Errors
    calibrated: Errors


class Manifest(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What a calibration says of itself.

    Attributes:
        format: Of these files.
        foot: Which foot it is for; also the name of its directory.
        foot_type: Of which type that is.
        footsense: Version that made it.
        made: When, UTC, ISO 8601.
        n_loads: On how many loads it rests.
        n_sessions: In how many sessions they were made.
        held_out: How good it is; None if no load was kept to tell.
        recordings: SHA-256 of every recording with those loads, by file name.
        files: SHA-256 of every other file, by name.
        sha256: Of all entries above.
    """

    format: int
    foot: FootId
    foot_type: Annotated[str, Meta(min_length=1)]
    footsense: str
    made: Annotated[str, Meta(pattern=r"^\d{4}-\d\d-\d\dT\d\d:\d\d:\d\dZ$")]
    n_loads: Annotated[int, Meta(ge=1)]
    n_sessions: Annotated[int, Meta(ge=1)]
    held_out: HeldOut | None
    recordings: Annotated[dict[str, Sha256], Meta(min_length=1)]
    files: dict[str, Sha256]
    sha256: str = ""

    @property
    def own_sha256(self) -> str:
        """The hash of all but the hash."""
        return hashlib.sha256(msgspec.json.encode(msgspec.structs.replace(self, sha256=""))).hexdigest()

    @property
    def training_sha256(self) -> str:
        """One hash for the recordings, whatever they are called."""
        return hashlib.sha256("".join(sorted(self.recordings.values())).encode()).hexdigest()


class Parameters(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """`footsense.foot.parameters.FootParameters` as lists, and what they hold for.

    Attributes:
        format: Of these files.
        network_sha256: The network that they were fitted on: its file without the seal.
        temperature_c: At which the foot was on the bench [degC]; None if nothing there measured it.
        stiffness_per_k: By how much the foot grows stiffer with each kelvin [1/K]; None if nobody measured it.
    """

    format: int
    network_sha256: Sha256
    stray_pf: Nine
    unloaded_pf: Nine
    gap_um: Nine
    gain_rel: Nine
    stiffness_rel: float
    mount: Annotated[list[Three], Meta(min_length=3, max_length=3)]
    correction: Annotated[Rows, Meta(max_length=3)]
    error_rel: float
    temperature_c: Annotated[float, Meta(ge=COLDEST_C, le=WARMEST_C)] | None
    # More would leave no stiffness at the other end of what a converter measures.
    stiffness_per_k: Annotated[float, Meta(ge=-0.006, le=0.006)] | None
