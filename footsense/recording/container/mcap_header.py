"""The header of a recording within its MCAP container."""

import json
import zlib
from collections.abc import Mapping
from pathlib import Path

from mcap.records import Header as McapHeader
from mcap.records import Metadata
from mcap.stream_reader import StreamReader

from footsense.errors import RecordingError
from footsense.frames import ALL_LEGS
from footsense.recording.container.bounded_file import DAMAGE_ERRORS, BoundedFile

#: Profile of the container, which identifies footsense's files.
MCAP_PROFILE = "footsense"

#: Name of the metadata record with the header.
METADATA_NAME = "footsense"

#: Key of the header's checksum.
HEADER_CRC_KEY = "crc32"


def header_crc(header: Mapping[str, str]) -> str:
    """Return the checksum of a header, without the checksum entry."""
    entries = sorted((key, value) for key, value in header.items() if key != HEADER_CRC_KEY)
    return f"{zlib.crc32(json.dumps(entries).encode()):08x}"


def read_header(path: Path) -> dict[str, str]:
    """Return the header entries of a recording file, checked.

    Args:
        path: The recording.

    Returns:
        The header; its entry `legs` names the rows of the frames.

    Raises:
        RecordingError: The file is missing, or not a recording, or its header is damaged.
    """
    try:
        with path.open("rb") as file:
            records = StreamReader(BoundedFile(file), emit_chunks=True).records
            container = next(records)
            if not isinstance(container, McapHeader) or container.profile != MCAP_PROFILE:
                raise RecordingError(f"{path}: is an MCAP file, but not a recording of footsense")
            metadata = next(records)
            header = metadata.metadata if isinstance(metadata, Metadata) else {}
            if header.get(HEADER_CRC_KEY) != header_crc(header) or metadata.name != METADATA_NAME:
                raise RecordingError(f"{path}: the header of the recording is damaged; nothing can be read")
            _check_leg_names(path, header.get("legs", ""))
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {error.strerror}") from None
    except (*DAMAGE_ERRORS, StopIteration):
        raise RecordingError(f"{path}: is not a recording, or was cut off in its first bytes") from None
    return {key: value for key, value in header.items() if key != HEADER_CRC_KEY}


def _check_leg_names(path: Path, legs: str) -> None:
    """Check that a header names the rows of the frames.

    Raises:
        RecordingError: It does not.
    """
    names = legs.split(",")
    if len(set(names)) < len(names) or not set(names) <= set(ALL_LEGS):
        raise RecordingError(
            f"{path}: the recording names its legs {legs[:40]!r}, not some of {', '.join(ALL_LEGS)}"
        )
