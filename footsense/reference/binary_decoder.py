"""Decoder of a force sensor's binary records: sync bytes, values, checksum."""

import binascii
import struct
from collections.abc import Callable, Sequence

import numpy as np

from footsense.reference.record_columns import MAX_RECORD_BYTES, integer_widths_bits
from footsense.reference.record_decoder import RecordDecoder

#: Checksums of a binary record: length [bytes], and function of the bytes between sync bytes and checksum; sent
#: little-endian.
CHECKSUMS: dict[str, tuple[int, Callable[[bytes], int]]] = {
    "none": (0, lambda _: 0),
    "sum8": (1, lambda data: sum(data) & 0xFF),
    "xor8": (1, lambda data: int(np.bitwise_xor.reduce(np.frombuffer(data, np.uint8)))),
    # CRC-16/CCITT-FALSE: polynomial 0x1021, start 0xFFFF, check value 0x29B1.
    "crc16": (2, lambda data: binascii.crc_hqx(data, 0xFFFF)),
}


class BinaryDecoder(RecordDecoder):
    """Decoder of a force sensor's binary records of fixed length.

        sync bytes | values | checksum

    Args:
        columns: Column of each value, of `COLUMNS` or "-".
        layout: The values as of Python's `struct`, byte order included, such as "<Ihhh".
        sync: Bytes that each record begins with, at least one.
        checksum: One of `CHECKSUMS`.
    """

    def __init__(self, columns: Sequence[str], layout: str, sync: bytes, checksum: str) -> None:
        super().__init__(
            columns, [None if bits is None else 1 << bits for bits in integer_widths_bits(layout)]
        )
        self._values = struct.Struct(layout)
        self._sync = sync
        self._n_check, self._check = CHECKSUMS[checksum]
        self._length = len(sync) + self._values.size + self._n_check
        # Without a checksum, the next record has to begin where this one ends.
        self._n_ahead = 0 if self._n_check else len(sync)
        self._buffer = bytearray()
        self._skipped = b""

    def reset(self) -> None:
        """Discard an incomplete record, after the port was reopened."""
        super().reset()
        self._buffer.clear()
        self._skipped = b""

    def _parse_bytes(self, data: bytes) -> list[list[float]]:
        """Return the values of the records that these bytes complete."""
        buffer = self._buffer
        buffer += data
        records: list[list[float]] = []
        at = 0
        while (found := buffer.find(self._sync, at)) >= 0:
            self._keep_skipped_bytes(buffer[at:found])
            at = found
            end = at + self._length + self._n_ahead
            if len(buffer) < end:
                break
            record = self._parse_record(bytes(buffer[at:end]))
            if record is None:
                self._keep_skipped_bytes(buffer[at : at + 1])
                at += 1
            else:
                if self._skipped and self._synchronised:
                    self._count_bad_record(self._skipped)
                self._skipped, self._synchronised = b"", True
                records.append(record)
                at += self._length
        else:  # the last bytes may be the first of the next sync bytes
            keep = max(at, len(buffer) - len(self._sync) + 1)
            self._keep_skipped_bytes(buffer[at:keep])
            at = keep
        del buffer[:at]
        return records

    def _parse_record(self, record: bytes) -> list[float] | None:
        """Return the values of one record; None if its checksum is wrong."""
        body = record[len(self._sync) : self._length - self._n_check]
        checksum = int.from_bytes(record[self._length - self._n_check : self._length], "little")
        if self._n_ahead and record[self._length :] != self._sync:
            return None
        if self._check(body) != checksum:
            return None
        return self._plausible_or_none([float(value) for value in self._values.unpack(body)])

    def _keep_skipped_bytes(self, data: bytes | bytearray) -> None:
        """Append bytes that belong to no record to the example for error messages, up to `MAX_RECORD_BYTES`."""
        self._skipped += data[: MAX_RECORD_BYTES - len(self._skipped)]
