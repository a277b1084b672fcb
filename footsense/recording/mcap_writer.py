"""Writer of cycles to an MCAP file.

Chunks are small and carry checksums, so that a killed process loses little and damage is detected; the data section
has a checksum of its own, and so has footsense's header, a metadata record that stands outside the chunks. A cycle's
force is written last: a reader that has it has the complete cycle.

Source:
    MCAP format specification, https://mcap.dev/spec.
"""

import json
import os
import tempfile
import zlib
from collections.abc import Iterator, Mapping
from typing import Self

from mcap.data_stream import RecordBuilder
from mcap.records import ChunkIndex
from mcap.writer import CompressionType, Writer

from footsense.recording import messages
from footsense.ring.records import LostCycles, NumberedCycle

#: Profile of the container, which identifies footsense's files.
MCAP_PROFILE = "footsense"
#: Name of the metadata record with the header, and key of the header's checksum.
METADATA_NAME = "footsense"
HEADER_CRC_KEY = "crc32"
#: Chunk size before compression [bytes]: 16 cycles of six legs.
CHUNK_BYTES = 65_536
#: Longest time that cycles stay in an unfinished chunk [ns].
_FLUSH_PERIOD_NS = 400_000_000


def header_crc(header: Mapping[str, str]) -> str:
    """Return the CRC-32 of a header's entries, except that of the checksum itself."""
    entries = sorted((key, value) for key, value in header.items() if key != HEADER_CRC_KEY)
    return f"{zlib.crc32(json.dumps(entries).encode()):08x}"


class _UnbufferedFile:
    """Unbuffered file for the MCAP writer: a full disk raises an error in the write that hits it."""

    def __init__(self, fd: int) -> None:
        self._fd = fd
        self.n_bytes_written = 0

    def write(self, data: bytes) -> int:
        """Write all of `data`; return the number of bytes."""
        rest = memoryview(data)
        while rest:
            n = os.write(self._fd, rest)
            self.n_bytes_written += n
            rest = rest[n:]
        return len(data)

    def tell(self) -> int:
        """Return the number of bytes written so far."""
        return self.n_bytes_written

    def flush(self) -> None:
        """Do nothing: there is no buffer."""


class _ChunkIndices:
    """Indices of the chunks, kept in a temporary file until the end: the library's list takes 80 MB an hour."""

    def __init__(self) -> None:
        self._file = tempfile.TemporaryFile(dir="/var/tmp")  # noqa: SIM115 - a disk; goes with the recording

    def append(self, index: ChunkIndex) -> None:
        builder = RecordBuilder()
        index.write(builder)
        self._file.write(builder.end())

    def __iter__(self) -> Iterator[Self]:
        """Yield what writes them all, as the library asks each."""
        yield self

    def write(self, builder: RecordBuilder) -> None:
        with self._file:
            self._file.seek(0)
            while block := self._file.read(1 << 16):
                builder.write(block)


class McapFile:
    """MCAP file of a recording that is being written.

    Args:
        fd: Descriptor of the empty file.
        header: Entries of the recording's header; `legs` names the rows of the frames.
        first_cycle_number: Number in its run of the cycle from which the recording counts.

    Attributes:
        n_cycles: Cycles handed to the kernel so far.
    """

    def __init__(self, fd: int, header: Mapping[str, str], first_cycle_number: int = 0) -> None:
        self._first_cycle_number = first_cycle_number
        self._legs = header["legs"].split(",")
        self._stream = _UnbufferedFile(fd)
        self._writer = Writer(
            self._stream, chunk_size=CHUNK_BYTES, compression=CompressionType.ZSTD, enable_data_crcs=True
        )
        self._writer._Writer__chunk_indices = _ChunkIndices()  # noqa: SLF001 - the library has no other way
        self._writer.start(profile=MCAP_PROFILE)
        self._writer.add_metadata(METADATA_NAME, {**header, HEADER_CRC_KEY: header_crc(header)})
        self._schemas = messages.topic_schemas(self._legs)
        self._channels: dict[str, int] = {}
        self._n_added = self.n_cycles = 0
        self._t_flushed_ns: int | None = None
        for topic in self._schemas:
            if topic != messages.REFERENCE:
                self._register(topic)
        self.flush()

    def add_entry(self, entry: NumberedCycle | LostCycles) -> None:
        """Write the messages of one cycle, or of a loss of cycles; close the chunk if that is due."""
        n_bytes_written = self._stream.n_bytes_written
        if isinstance(entry, LostCycles):
            loss = messages.loss_event(entry.n_cycles)
            self._add(messages.EVENT, entry.next_cycle_number, entry.next_t_sent_ns, loss)
            return
        # The topic identifies recordings of a test stand, so it is registered with the first reference.
        if entry.cycle.reference is not None and messages.REFERENCE not in self._channels:
            self._register(messages.REFERENCE)
        for topic, encode in messages.ENCODERS.items():
            for t_ns, data in encode(entry.cycle, self._legs):
                self._add(topic, entry.cycle_number, t_ns, data)
        # A chunk was full and is written; the force of this cycle may be in the next one.
        if self._stream.n_bytes_written > n_bytes_written:
            self.n_cycles = self._n_added
        self._n_added += 1
        t_ns = entry.cycle.forces.t_sent_ns
        if self._t_flushed_ns is None:
            self._t_flushed_ns = t_ns
        elif t_ns - self._t_flushed_ns >= _FLUSH_PERIOD_NS:
            self._t_flushed_ns = t_ns
            self.flush()

    def _register(self, topic: str) -> None:
        schema = self._writer.register_schema(f"footsense.{topic[1:]}", "jsonschema", self._schemas[topic])
        self._channels[topic] = self._writer.register_channel(topic, "json", schema)

    def _add(self, topic: str, cycle_number: int, t_ns: int, data: bytes) -> None:
        # The sequence field has 32 bits; readers detect a missing chunk by it.
        sequence = cycle_number - self._first_cycle_number & 0xFFFF_FFFF
        self._writer.add_message(self._channels[topic], t_ns, data, publish_time=t_ns, sequence=sequence)

    def flush(self) -> None:
        """Close the current MCAP chunk, and write all buffered data to the file."""
        self._writer.flush()
        self.n_cycles = self._n_added

    def finish(self) -> None:
        """Write the last chunk and the index of the MCAP file."""
        self.flush()
        self._writer.finish()
        self._writer.flush()
