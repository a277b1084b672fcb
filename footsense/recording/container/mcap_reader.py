"""Cycles out of an MCAP container, in file order, up to the first damage.

The library's indexed readers return nothing of a file without its end, and its stream reader accepts short reads,
missing checksums and lost chunks; so everything is counted and checked here, and reading stops at the first doubtful
byte.
"""

import os
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO

import msgspec
from mcap.exceptions import McapError
from mcap.records import Chunk, DataEnd, Metadata
from mcap.records import Header as McapHeader
from mcap.stream_reader import StreamReader, breakup_chunk
from zstandard import ZstdError, frame_content_size

from footsense.errors import RecordingError
from footsense.frames import LEGS
from footsense.recording.container.cycle_assembly import CycleAssembly
from footsense.recording.container.mcap_writer import HEADER_CRC, METADATA, PROFILE, header_crc
from footsense.recording.cycle_records import LostCycles, NumberedCycle, require

#: Largest chunk that is unpacked [bytes]; footsense's have 64 KiB.
MAX_CHUNK_BYTES = 1 << 24

#: Errors of the libraries below on damaged bytes.
_DAMAGE = (
    *(McapError, ZstdError, msgspec.MsgspecError, ValueError, LookupError, TypeError, AttributeError),
    *(OverflowError, MemoryError, RecursionError, EOFError, struct.error),
)

_Record = Any  # the library is not typed


class _Bounded:
    """File wrapper that limits each read to the end of the file, even for a damaged length."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self.size = os.fstat(file.fileno()).st_size

    def read(self, n: int) -> bytes:
        """Return `n` bytes, fewer at the end.

        Raises:
            ValueError: No written record is so large.
        """
        if n > MAX_CHUNK_BYTES:
            raise ValueError("a record is larger than any that is written")
        return self._file.read(min(n, self.size - self._file.tell()))


def read_header(path: Path) -> dict[str, str]:
    """Return the header of a recording.

    Args:
        path: The recording.

    Returns:
        The header; its entry `legs` names the rows of the frames.

    Raises:
        RecordingError: The file is missing, or not a recording, or its header is damaged.
    """
    try:
        with path.open("rb") as file:
            records = StreamReader(_Bounded(file), emit_chunks=True).records
            container = next(records)
            if not isinstance(container, McapHeader) or container.profile != PROFILE:
                raise RecordingError(f"{path}: is an MCAP file, but not a recording of footsense")
            metadata = next(records)
            header = metadata.metadata if isinstance(metadata, Metadata) else {}
            if header.get(HEADER_CRC) != header_crc(header) or metadata.name != METADATA:
                raise RecordingError(f"{path}: the header of the recording is damaged; nothing can be read")
            _check_legs(path, header.get("legs", ""))
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {error.strerror}") from None
    except (*_DAMAGE, StopIteration):
        raise RecordingError(f"{path}: is not a recording, or was cut off in its first bytes") from None
    return {key: value for key, value in header.items() if key != HEADER_CRC}


def _check_legs(path: Path, legs: str) -> None:
    """Check that a header names the rows of the frames.

    Raises:
        RecordingError: It does not.
    """
    names = legs.split(",")
    if len(set(names)) < len(names) or not set(names) <= set(LEGS):
        raise RecordingError(
            f"{path}: the recording names its legs {legs[:40]!r}, not some of {', '.join(LEGS)}"
        )


def read_entries(path: Path, legs: tuple[str, ...]) -> Iterator[NumberedCycle | LostCycles]:
    """Yield every complete cycle and every recorded loss, in file order.

    Args:
        path: The recording.
        legs: Name of each row of the frames.

    Yields:
        Cycles and losses up to the end of the file or its first damage.

    Raises:
        RecordingError: The file ends before its end mark, or is damaged; the message names the byte.
    """
    with path.open("rb") as file:
        bounded = _Bounded(file)
        assembly = CycleAssembly(legs)
        good = 0
        try:
            for record in StreamReader(bounded, emit_chunks=True, validate_crcs=True).records:
                if isinstance(record, Chunk):
                    for content in _contents(record):
                        entry = assembly.take(content)
                        if entry is not None:
                            yield entry
                elif isinstance(record, DataEnd):
                    require(record.data_section_crc != 0, "the checksum of the file is missing")
                    return
                good = file.tell()
        except _DAMAGE as error:
            raise RecordingError(f"{path}: {_damage_text(assembly, good, bounded.size, error)}") from None
        raise RecordingError(
            f"{path}: {_damage_text(assembly, good, bounded.size, ValueError('no end mark'))}"
        )


def _damage_text(assembly: CycleAssembly, good: int, size: int, error: Exception) -> str:
    """Return a message about the damage."""
    why = " ".join(str(error).split())[:80] or "the file ends there"
    return (
        f"cut short or damaged at byte {good} of {size} ({why}): {assembly.n_cycles} cycles are whole, up to "
        f"{assembly.span_ns * 1e-9:.3f} s after the first; what follows is lost"
    )


def _contents(chunk: _Record) -> list[_Record]:
    require(chunk.uncompressed_crc != 0, "a chunk has no checksum")
    require(chunk.uncompressed_size <= MAX_CHUNK_BYTES, "a chunk is larger than any that is written")
    # The library would allocate the size that the compressed data claim.
    require(
        chunk.compression == "zstd" and frame_content_size(chunk.data) == chunk.uncompressed_size,
        "a chunk is not packed as it says",
    )
    return list(breakup_chunk(chunk, validate_crc=True))
