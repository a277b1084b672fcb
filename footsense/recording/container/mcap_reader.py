"""Reader of the cycles in an MCAP file, in file order, up to the first damage.

The library's indexed readers return nothing of a file without its end, and its stream reader accepts short reads,
missing checksums and lost chunks; so everything is counted and checked here, and reading stops at the first doubtful
byte.
"""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from mcap.records import Chunk, DataEnd
from mcap.stream_reader import StreamReader, breakup_chunk
from zstandard import frame_content_size

from footsense.errors import RecordingError
from footsense.recording.container.bounded_file import DAMAGE_ERRORS, MAX_CHUNK_BYTES, BoundedFile
from footsense.recording.container.cycle_assembly import CycleAssembly
from footsense.ring.records import LostCycles, NumberedCycle, require_valid

_Record = Any  # the library is not typed


def read_entries(
    path: Path, legs: tuple[str, ...], on_bytes_read: Callable[[int], None]
) -> Iterator[NumberedCycle | LostCycles]:
    """Yield every complete cycle and every recorded loss of cycles, in file order.

    Args:
        path: The recording.
        legs: Name of each row of the frames.
        on_bytes_read: Receives the number of bytes read so far, after each chunk.

    Yields:
        Cycles and losses up to the end of the file or its first damage.

    Raises:
        RecordingError: The file ends before its end mark, or is damaged; the message names the byte.
    """
    with path.open("rb") as file:
        bounded = BoundedFile(file)
        assembly = CycleAssembly(legs)
        good = 0
        try:
            for record in StreamReader(bounded, emit_chunks=True, validate_crcs=True).records:
                if isinstance(record, Chunk):
                    for content in _chunk_records(record):
                        entry = assembly.add_record(content)
                        if entry is not None:
                            yield entry
                elif isinstance(record, DataEnd):
                    require_valid(record.data_section_crc != 0, "the checksum of the file is missing")
                    return
                good = file.tell()
                on_bytes_read(good)
        except DAMAGE_ERRORS as error:
            raise RecordingError(f"{path}: {_damage_text(assembly, good, bounded.size, error)}") from None
        raise RecordingError(
            f"{path}: {_damage_text(assembly, good, bounded.size, ValueError('no end mark'))}"
        )


def _damage_text(assembly: CycleAssembly, good: int, size: int, error: Exception) -> str:
    """Return the error message of a damaged recording: where the damage is, and how much is intact."""
    why = " ".join(str(error).split())[:80] or "the file ends there"
    return (
        f"cut short or damaged at byte {good} of {size} ({why}): {assembly.n_cycles} cycles are whole, up to "
        f"{assembly.span_ns * 1e-9:.3f} s after the first; what follows is lost"
    )


def _chunk_records(chunk: _Record) -> list[_Record]:
    require_valid(chunk.uncompressed_crc != 0, "a chunk has no checksum")
    require_valid(chunk.uncompressed_size <= MAX_CHUNK_BYTES, "a chunk is larger than any that is written")
    # The library would allocate the size that the compressed data claim.
    require_valid(
        chunk.compression == "zstd" and frame_content_size(chunk.data) == chunk.uncompressed_size,
        "a chunk is not packed as it says",
    )
    return list(breakup_chunk(chunk, validate_crc=True))
