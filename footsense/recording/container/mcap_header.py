"""Header of a recording: a metadata record of the MCAP file, with a checksum."""

import json
import zlib
from collections.abc import Mapping
from pathlib import Path

from mcap.records import Header as McapHeader
from mcap.records import Metadata
from mcap.stream_reader import StreamReader

from footsense.errors import RecordingError
from footsense.recording.container.bounded_file import DAMAGE_ERRORS, BoundedFile
from footsense.ring.records import legs_in_header

#: Profile of the container, which identifies footsense's files.
MCAP_PROFILE = "footsense"

#: Name of the metadata record with the header.
METADATA_NAME = "footsense"

#: Key of the header's checksum.
HEADER_CRC_KEY = "crc32"


def header_crc(header: Mapping[str, str]) -> str:
    """Return the CRC-32 of a header's entries, except that of the checksum itself."""
    entries = sorted((key, value) for key, value in header.items() if key != HEADER_CRC_KEY)
    return f"{zlib.crc32(json.dumps(entries).encode()):08x}"


def read_header(path: Path) -> dict[str, str]:
    """Return the header entries of a recording file, after checking checksum and legs.

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
            _check_legs(path, header)
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {error.strerror}") from None
    except (*DAMAGE_ERRORS, StopIteration):
        raise RecordingError(f"{path}: is not a recording, or was cut off in its first bytes") from None
    return {key: value for key, value in header.items() if key != HEADER_CRC_KEY}


def _check_legs(path: Path, header: Mapping[str, str]) -> None:
    try:
        legs_in_header(header)
    except ValueError as error:
        raise RecordingError(f"{path}: {error}") from None
