"""Writer of cycles to an MCAP file.

Chunks are small and carry checksums, so that a killed process loses little and damage is detected; the data section
has a checksum of its own, and so has footsense's header, which stands outside the chunks. A cycle's force is written
last: a reader that has it has the complete cycle.

Source:
    MCAP format specification, https://mcap.dev/spec.
"""

import os
from collections.abc import Mapping

from mcap.writer import CompressionType, Writer

from footsense.recording.container import event_messages, messages
from footsense.recording.container.event_messages import (
    encode_gait,
    encode_gait_events,
    encode_reference,
    reference_schema,
)
from footsense.recording.container.mcap_header import HEADER_CRC_KEY, MCAP_PROFILE, METADATA_NAME, header_crc
from footsense.ring.records import LostCycles, NumberedCycle

#: Chunk size before compression [bytes]: about half a second of six legs.
CHUNK_BYTES = 65_536


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


class McapFile:
    """MCAP file of a recording that is being written.

    Args:
        fd: Descriptor of the empty file.
        recording_header: Entries of the recording's header; `legs` names the rows of the frames.
    """

    def __init__(self, fd: int, recording_header: Mapping[str, str]) -> None:
        self._legs = recording_header["legs"].split(",")
        self._stream = _UnbufferedFile(fd)
        self._writer = Writer(
            self._stream, chunk_size=CHUNK_BYTES, compression=CompressionType.ZSTD, enable_data_crcs=True
        )
        self._writer.start(profile=MCAP_PROFILE)
        self._writer.add_metadata(
            METADATA_NAME, {**recording_header, HEADER_CRC_KEY: header_crc(recording_header)}
        )
        self._channels: dict[str, int] = {}
        for topic, schema in messages.topic_schemas(self._legs).items():
            self._register_topic(topic, schema)
        self.flush()

    @property
    def n_bytes_written(self) -> int:
        """Number of bytes passed to the kernel so far."""
        return self._stream.n_bytes_written

    def add_entry(self, entry: NumberedCycle | LostCycles) -> None:
        """Write the messages of one cycle, or of a loss of cycles."""
        if isinstance(entry, LostCycles):
            self._add_message(
                messages.EVENT,
                entry.next_cycle_number,
                entry.next_t_sent_ns,
                event_messages.loss_event(entry.n_cycles),
            )
            return
        counter, (scan, commands, forces, outcomes, reference, temperature_c) = entry
        t_ns = forces.t_sent_ns
        for command in commands:
            self._add_message(
                messages.EVENT, counter, t_ns, event_messages.command_event(command, self._legs)
            )
        for outcome in outcomes:
            self._add_message(
                messages.EVENT, counter, t_ns, event_messages.outcome_event(outcome, self._legs)
            )
        if temperature_c is not None:
            self._add_message(
                messages.EVENT, counter, t_ns, event_messages.temperature_event(temperature_c, self._legs)
            )
        if reference is not None:
            # The topic identifies recordings of a test stand, so it is registered with the first reference.
            if messages.REFERENCE not in self._channels:
                self._register_topic(messages.REFERENCE, reference_schema())
            for sample_ns, sample in encode_reference(reference):
                self._add_message(messages.REFERENCE, counter, sample_ns, sample)
        if forces.gait is not None:
            self._add_message(messages.GAIT, counter, t_ns, encode_gait(forces.gait, self._legs))
            for event in encode_gait_events(forces.gait, self._legs):
                self._add_message(messages.GAIT_EVENT, counter, t_ns, event)
        self._add_message(messages.SCAN, counter, t_ns, messages.encode_scan(scan, self._legs))
        self._add_message(messages.FORCE, counter, t_ns, messages.encode_force(forces, self._legs))

    def _register_topic(self, topic: str, schema: bytes) -> None:
        schema_id = self._writer.register_schema(f"footsense.{topic[1:]}", "jsonschema", schema)
        self._channels[topic] = self._writer.register_channel(topic, "json", schema_id)

    def _add_message(self, topic: str, counter: int, t_ns: int, data: bytes) -> None:
        # The sequence field has 32 bits; readers detect a missing chunk by it.
        self._writer.add_message(
            self._channels[topic], log_time=t_ns, publish_time=t_ns, sequence=counter & 0xFFFF_FFFF, data=data
        )

    def flush(self) -> None:
        """Close the current MCAP chunk, and write all buffered data to the file."""
        self._writer.flush()

    def finish(self) -> None:
        """Write the last chunk and the index of the MCAP file."""
        self._writer.finish()
        self._writer.flush()
