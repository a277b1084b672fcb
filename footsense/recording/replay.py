"""A recording as an iterable of its cycles, in file order, up to the first damage.

The library's indexed readers return nothing of a file without its end, and its stream reader accepts short reads,
missing checksums and lost chunks; so everything is counted and checked here, and reading stops at the first doubtful
byte.
"""

import os
import struct
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any, BinaryIO

import msgspec
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, DataEnd, Header, Message, Metadata
from mcap.stream_reader import StreamReader, get_chunk_data_stream
from zstandard import ZstdError, frame_content_size

from footsense.errors import RecordingError
from footsense.frames import Cycle
from footsense.recording import messages
from footsense.recording.mcap_writer import HEADER_CRC_KEY, MCAP_PROFILE, METADATA_NAME, header_crc
from footsense.regular_file import open_regular
from footsense.ring.records import LostCycles, NumberedCycle, legs_in_header, require_valid

#: Largest record that is read, and chunk that is unpacked [bytes]; footsense's chunks have 64 KiB.
MAX_CHUNK_BYTES = 1 << 20
#: Largest size of a chunk over that of its packed bytes [1]: those of quiet simulated robots have 22.
MAX_UNPACKED_REL = 64
#: Most records of a chunk that are read [1]; footsense's smallest messages fill one with a thousand.
MAX_CHUNK_RECORDS = 4096
#: Largest cycle that is read: its messages' bytes, and their number [1]. A record of the ring has room for 16 000
#: samples of a reference.
MAX_CYCLE_BYTES, MAX_CYCLE_MESSAGES = 1 << 22, 20_000
#: Longest time from one cycle to the next [ns]: a day.
MAX_GAP_NS = 86_400_000_000_000

#: Errors of the libraries below on damaged bytes.
_DAMAGE_ERRORS = (
    *(McapError, ZstdError, msgspec.MsgspecError, ValueError, LookupError, TypeError, AttributeError),
    *(OverflowError, MemoryError, RecursionError, EOFError, struct.error),
)


class _BoundedFile:
    """File wrapper that limits each read, even for a damaged length."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file

    def read(self, n: int) -> bytes:
        """Return `n` bytes; fewer at the end of the file.

        Raises:
            ValueError: No written record is so large.
        """
        require_valid(n <= MAX_CHUNK_BYTES, "a record is larger than any that is written")
        return self._file.read(n)


class Replay:
    """Iterable of a recording's cycles; each iteration reads the file from the beginning.

    Args:
        path: The recording, finished or not.
        on_bytes_read: Receives the number of bytes read so far, after each chunk; None for nobody.

    Attributes:
        path: The recording.
        header: Entries of its header.
        legs: Name of the leg in each row of the frames.

    Raises:
        RecordingError: The file is missing, or not a recording, or its header is damaged.
    """

    def __init__(self, path: Path, on_bytes_read: Callable[[int], None] | None = None) -> None:
        self.path = path
        self._on_read = on_bytes_read or (lambda _: None)
        self.header = self._read_header()
        try:
            self.legs = legs_in_header(self.header)
        except ValueError as error:
            raise RecordingError(f"{path}: {error}") from None

    def _read_header(self) -> dict[str, str]:
        path = self.path
        try:
            with os.fdopen(open_regular(path), "rb") as file:
                records = StreamReader(_BoundedFile(file), emit_chunks=True).records
                container, metadata = next(records), next(records)
        except OSError as error:
            raise RecordingError(f"{path}: cannot be read: {error.strerror}") from None
        except (*_DAMAGE_ERRORS, StopIteration):
            raise RecordingError(f"{path}: is not a recording, or was cut off in its first bytes") from None
        if not isinstance(container, Header) or container.profile != MCAP_PROFILE:
            raise RecordingError(f"{path}: is an MCAP file, but not a recording of footsense")
        header: dict[str, str] = metadata.metadata if isinstance(metadata, Metadata) else {}
        if header.pop(HEADER_CRC_KEY, None) != header_crc(header) or metadata.name != METADATA_NAME:
            raise RecordingError(f"{path}: the header of the recording is damaged; nothing can be read")
        return header

    def entries(self) -> Iterator[NumberedCycle | LostCycles]:
        """Yield every complete cycle and every recorded loss of cycles, in file order.

        Yields:
            Cycles and losses up to the end of the file or its first damage.

        Raises:
            RecordingError: The file ends before its end mark, or is damaged; the message names the byte.
        """
        with os.fdopen(open_regular(self.path), "rb") as file:
            assembly = _CycleAssembly(self.legs)
            good = 0
            try:
                for record in StreamReader(_BoundedFile(file), emit_chunks=True, validate_crcs=True).records:
                    if isinstance(record, Chunk):
                        yield from assembly.entries_of(_chunk_records(record))
                    elif isinstance(record, DataEnd):
                        require_valid(record.data_section_crc != 0, "the checksum of the file is missing")
                        return
                    good = file.tell()
                    self._on_read(good)
                require_valid(False, "no end mark")
            except _DAMAGE_ERRORS as error:
                text = "a record is not whole" if isinstance(error, struct.error) else str(error)
                why = " ".join(text.split())[:80] or "the file ends there"
                size = os.fstat(file.fileno()).st_size
                raise RecordingError(
                    f"{self.path}: cut short or damaged at byte {good} of {size} ({why}): {assembly.n_cycles} "
                    f"cycles are whole, up to {assembly.span_ns * 1e-9:.3f} s after the first; what follows is lost"
                ) from None

    def __iter__(self) -> Iterator[Cycle]:
        """Iterate over complete cycles in file order, as `entries` does."""
        return (entry.cycle for entry in self.entries() if isinstance(entry, NumberedCycle))


def _chunk_records(chunk: Any) -> Iterator[Any]:  # noqa: ANN401 - the library is not typed
    """Yield the channels and messages of a chunk.

    Raises:
        ValueError: It is larger than any that is written, or damaged.
    """
    require_valid(chunk.uncompressed_crc != 0, "a chunk has no checksum")
    require_valid(chunk.uncompressed_size <= MAX_CHUNK_BYTES, "a chunk is larger than any that is written")
    require_valid(
        chunk.uncompressed_size <= MAX_UNPACKED_REL * len(chunk.data),
        "a chunk is packed closer than any that is written",
    )
    # The library would allocate the size that the compressed data claim.
    require_valid(
        chunk.compression == "zstd" and frame_content_size(chunk.data) == chunk.uncompressed_size,
        "a chunk is not packed as it says",
    )
    stream, n_bytes = get_chunk_data_stream(chunk, validate_crc=True)
    for _ in range(MAX_CHUNK_RECORDS):
        if stream.count >= n_bytes:
            return
        opcode, length = stream.read1(), stream.read8()
        if opcode == Opcode.CHANNEL:
            yield Channel.read(stream)
        elif opcode == Opcode.MESSAGE:
            yield Message.read(stream, length)
        else:
            stream.read(length)
    require_valid(False, "a chunk has more records than any that is written")


class _CycleAssembly:
    """Assembles cycles from their messages, and detects missing ones.

    Args:
        legs: Name of each row of the frames.

    Attributes:
        n_cycles: Whole cycles so far.
        span_ns: Time from the first to the last of them [ns].
    """

    def __init__(self, legs: tuple[str, ...]) -> None:
        self.n_cycles = 0
        self.span_ns = 0
        self._legs = legs
        self._topics: dict[int, str] = {}
        self._expected = 0
        #: Messages of the cycle that is not complete yet, by topic, and their bytes.
        self._parts: defaultdict[str, list[bytes]] = defaultdict(list)
        self._n_bytes = self._n_messages = 0
        self._t_first_ns = 0

    def entries_of(self, records: Iterable[Any]) -> Iterator[NumberedCycle | LostCycles]:
        """Yield the cycles and losses that some records complete."""
        for record in records:
            if isinstance(record, Channel):
                self._topics[record.id] = record.topic if record.topic in messages.ENCODERS else ""
            elif isinstance(record, Message):
                yield from self._add_message(self._topics[record.channel_id], record)

    def _add_message(self, topic: str, message: Message) -> Iterator[NumberedCycle | LostCycles]:
        n_lost = messages.decode_loss(message.data) if topic == messages.EVENT else None
        self._expected += n_lost or 0
        require_valid(message.sequence == self._expected & 0xFFFF_FFFF, "cycles are missing")
        if n_lost is not None:
            yield LostCycles(self._expected, message.log_time, n_lost)
            return
        self._n_bytes += len(message.data)
        self._n_messages += 1
        require_valid(
            self._n_bytes <= MAX_CYCLE_BYTES and self._n_messages <= MAX_CYCLE_MESSAGES,
            "a cycle is larger than any that is written",
        )
        self._parts[topic].append(message.data)
        if topic == messages.FORCE:
            # Every cycle of a test stand's recording has a reference, possibly without samples.
            has_reference = messages.REFERENCE in self._topics.values()
            cycle = messages.decode_cycle(self._parts, self._legs, has_reference=has_reference)
            self._parts.clear()
            self._n_bytes = self._n_messages = 0
            if self.n_cycles == 0:
                self._t_first_ns = cycle.forces.t_sent_ns
            span_ns = cycle.forces.t_sent_ns - self._t_first_ns
            require_valid(0 <= span_ns - self.span_ns <= MAX_GAP_NS, "its time jumps")
            self.span_ns = span_ns
            self.n_cycles += 1
            yield NumberedCycle(self._expected, cycle)
            self._expected += 1
