"""Cycles out of an MCAP container, in file order, up to the first damage.

The library's indexed readers return nothing of a file without its end, and its stream reader accepts short reads,
missing checksums and lost chunks; so everything is counted and checked here, and reading stops at the first doubtful
byte.
"""

import json
import os
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO

from mcap.exceptions import McapError
from mcap.records import Channel, Chunk, DataEnd, Message, Metadata
from mcap.records import Header as McapHeader
from mcap.stream_reader import StreamReader, breakup_chunk
from zstandard import ZstdError, frame_content_size

from footsense.errors import RecordingError
from footsense.frames import LEGS, CapFrame, Command, CommandResult, Cycle
from footsense.recording import messages
from footsense.recording.cycle_records import LostCycles, NumberedCycle, require
from footsense.recording.mcap_writer import HEADER_CRC, METADATA, PROFILE, header_crc
from footsense.recording.reference_messages import decode_reference

#: Largest chunk that is unpacked [bytes]; footsense's have 64 KiB.
MAX_CHUNK_BYTES = 1 << 24

#: Errors of the libraries below on damaged bytes.
_DAMAGE = (
    *(McapError, ZstdError, ValueError, LookupError, TypeError, AttributeError, OverflowError),
    *(MemoryError, RecursionError, EOFError, struct.error),
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
        assembly = _CycleAssembly(legs)
        good = 0
        try:
            for record in StreamReader(bounded, emit_chunks=True, validate_crcs=True).records:
                if isinstance(record, Chunk):
                    yield from assembly.take(_contents(record))
                elif isinstance(record, DataEnd):
                    require(record.data_section_crc != 0, "the checksum of the file is missing")
                    return
                good = file.tell()
        except _DAMAGE as error:
            raise RecordingError(f"{path}: {assembly.damage_text(good, bounded.size, error)}") from None
        raise RecordingError(f"{path}: {assembly.damage_text(good, bounded.size, ValueError('no end mark'))}")


def _contents(chunk: _Record) -> list[_Record]:
    require(chunk.uncompressed_crc != 0, "a chunk has no checksum")
    require(chunk.uncompressed_size <= MAX_CHUNK_BYTES, "a chunk is larger than any that is written")
    # The library would allocate the size that the compressed data claim.
    require(
        chunk.compression == "zstd" and frame_content_size(chunk.data) == chunk.uncompressed_size,
        "a chunk is not packed as it says",
    )
    return list(breakup_chunk(chunk, validate_crc=True))


class _CycleAssembly:
    """Assembles cycles from their messages, and detects missing ones."""

    def __init__(self, legs: tuple[str, ...]) -> None:
        self._legs = legs
        self._topics: dict[int, str] = {}
        self._expected = 0
        self._scan: CapFrame | None = None
        self._commands: list[Command] = []
        self._outcomes: list[CommandResult] = []
        self._samples: list[bytes] = []
        self._temperature_event: dict[str, Any] | None = None
        self._has_reference = False
        self._n_cycles = 0
        self._t_first_ns = 0
        self._t_last_ns = 0

    def take(self, records: list[_Record]) -> Iterator[NumberedCycle | LostCycles]:
        for record in records:
            if isinstance(record, Channel):
                self._topics[record.id] = record.topic
                self._has_reference |= record.topic == messages.REFERENCE
            elif isinstance(record, Message):
                whole = self._message(self._topics[record.channel_id], record)
                if whole is not None:
                    yield whole

    def _message(self, topic: str, message: _Record) -> NumberedCycle | LostCycles | None:
        event = json.loads(message.data) if topic == messages.EVENT else {}
        if event.get("event") == "loss":
            self._expected += messages.whole(event["n_cycles"])
        require(message.sequence == self._expected & 0xFFFF_FFFF, "cycles are missing")
        match topic, event.get("event"):
            case messages.EVENT, "loss":
                return LostCycles(self._expected, message.log_time, event["n_cycles"])
            case messages.EVENT, "command":
                self._commands.append(messages.decode_command(event, self._legs))
            case messages.EVENT, "outcome":
                self._outcomes.append(messages.decode_outcome(event, self._legs))
            case messages.EVENT, "temperature":
                self._temperature_event = event
            case messages.REFERENCE, None:
                self._samples.append(message.data)
            case messages.SCAN, None:
                require(self._scan is None, "forces are missing")
                self._scan = messages.decode_scan(message.data, self._legs)
            case messages.FORCE, None:
                return self._cycle(message.data)
        return None

    def _cycle(self, data: bytes) -> NumberedCycle:
        forces = messages.decode_force(data, self._legs)
        if self._scan is None:
            raise ValueError("a scan is missing")
        # Every cycle of a test stand's recording has a reference, possibly without samples.
        reference = decode_reference(self._samples) if self._has_reference else None
        temperature_c = (
            messages.decode_temperature(self._temperature_event, self._legs)
            if self._temperature_event
            else None
        )
        cycle = Cycle(
            self._scan, tuple(self._commands), forces, tuple(self._outcomes), reference, temperature_c
        )
        numbered = NumberedCycle(self._expected, cycle)
        self._scan, self._temperature_event = None, None
        self._commands, self._outcomes, self._samples = [], [], []
        self._expected += 1
        self._t_first_ns = forces.t_sent_ns if self._n_cycles == 0 else self._t_first_ns
        self._t_last_ns = forces.t_sent_ns
        self._n_cycles += 1
        return numbered

    def damage_text(self, good: int, size: int, error: Exception) -> str:
        """Return a message about the damage."""
        t_s = (self._t_last_ns - self._t_first_ns) * 1e-9
        why = " ".join(str(error).split())[:80] or "the file ends there"
        return (
            f"cut short or damaged at byte {good} of {size} ({why}): "
            f"{self._n_cycles} cycles are whole, up to {t_s:.3f} s after the first; what follows is lost"
        )
