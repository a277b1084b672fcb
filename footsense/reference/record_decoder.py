"""Decoders of a force sensor's byte stream: lines of text, and binary records.

Both resynchronise: what is not a record is skipped and counted, and the next record is read.
"""

import binascii
import struct
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from footsense.frames import Mask, Stamps, Vector
from footsense.reference.record_columns import MAX_RECORD_BYTES, TIMES, integer_bits, largest_plausible

#: Checksums of a binary record: length [bytes], and function of the bytes between sync bytes and checksum; sent
#: little-endian.
CHECKSUMS: dict[str, tuple[int, Callable[[bytes], int]]] = {
    "none": (0, lambda _: 0),
    "sum8": (1, lambda data: sum(data) & 0xFF),
    "xor8": (1, lambda data: int(np.bitwise_xor.reduce(np.frombuffer(data, np.uint8)))),
    # CRC-16/CCITT-FALSE: polynomial 0x1021, start 0xFFFF, check value 0x29B1.
    "crc16": (2, lambda data: binascii.crc_hqx(data, 0xFFFF)),
}


class SensorRecords(NamedTuple):
    """Records of a sensor, oldest first.

    Attributes:
        t_ns: Time of each by the sensor's clock [ns], shape (n,), int64; None if it sends none.
        sequence: Sequence numbers, shape (n,), int64; None if it sends none.
        raw: Forces as sent, shape (n, 3).
        saturated: Whether the sensor flags them as saturated, shape (n,).
    """

    t_ns: Stamps | None
    sequence: Stamps | None
    raw: Vector
    saturated: Mask


class RecordDecoder:
    """Part of both decoders: the columns of a record, unwrapped counters, and bad records.

    Args:
        names: Column of each value, of `COLUMNS` or "-".
        wraps: Modulus of each value that is an integer counter, else None.

    Attributes:
        n_bad: Lines or runs of bytes that were no record.
        last_bad: The last of them.
    """

    def __init__(self, names: Sequence[str], wraps: Sequence[int | None]) -> None:
        self._n_columns = len(names)
        self._forces = [names.index(axis) for axis in ("fx", "fy", "fz")]
        self._time = next(((names.index(name), unit) for name, unit in TIMES.items() if name in names), None)
        self._sequence = names.index("sequence") if "sequence" in names else None
        self._saturated = names.index("saturated") if "saturated" in names else None
        self._limits = {index: largest_plausible(name) for index, name in enumerate(names) if name != "-"}
        self._wraps = wraps
        self._unwrapped: dict[int, int] = {}
        self._synchronised = False
        self.n_bad = 0
        self.last_bad = b""

    def feed(self, data: bytes) -> SensorRecords:
        """Return the records that these bytes complete."""
        values = np.array(self._parse(data), dtype=np.float64).reshape(-1, self._n_columns)
        t_ns = sequence = None
        if self._time is not None:
            index, unit_ns = self._time
            t_ns = np.rint(self._unwrap(values[:, index], index) * unit_ns).astype(np.int64)
        if self._sequence is not None:
            sequence = self._unwrap(values[:, self._sequence], self._sequence).astype(np.int64)
        none = np.zeros(len(values), np.bool_)
        saturated = none if self._saturated is None else values[:, self._saturated] != 0
        return SensorRecords(t_ns, sequence, values[:, self._forces], saturated)

    def reset(self) -> None:
        """Drop an incomplete record: the line has been opened anew."""
        self._synchronised = False

    def _parse(self, data: bytes) -> list[list[float]]:
        """Return the values of the records that these bytes complete."""
        raise NotImplementedError

    def _plausible(self, record: list[float]) -> list[float] | None:
        """Return the record, None if a sensor cannot have sent it; NaN fails every comparison."""
        return record if all(abs(record[index]) <= limit for index, limit in self._limits.items()) else None

    def _count_bad(self, data: bytes) -> None:
        self.n_bad += 1
        self.last_bad = data[:60]

    def _unwrap(self, counts: Vector, index: int) -> Vector:
        """Return counts without wraps; one that goes back by less than half its range has gone back."""
        wrap = self._wraps[index]
        if wrap is None or not len(counts):
            return counts
        unwrapped = []
        for count in counts.astype(np.int64).tolist():
            last = self._unwrapped.get(index, count)
            step = (count - last) % wrap
            self._unwrapped[index] = last + (step if step < wrap // 2 else step - wrap)
            unwrapped.append(self._unwrapped[index])
        return np.array(unwrapped, np.float64)


class LineDecoder(RecordDecoder):
    r"""Lines of numbers, each ended by \n or \r\n.

    Args:
        columns: Column of each number, of `COLUMNS` or "-".
        separator: Text between them; "" for white space.
    """

    def __init__(self, columns: Sequence[str], separator: str) -> None:
        super().__init__(columns, [None] * len(columns))
        self._separator = separator or None
        self._rest = b""

    def reset(self) -> None:
        """Drop an incomplete line: the port has been opened anew."""
        super().reset()
        self._rest = b""

    def _parse(self, data: bytes) -> list[list[float]]:
        *lines, self._rest = (self._rest + data).split(b"\n")
        if len(self._rest) > MAX_RECORD_BYTES:
            self._count_bad(self._rest)
            self._rest = b""
        records = []
        for line in lines:
            record = self._record(line)
            if record is not None:
                records.append(record)
            elif self._synchronised and line.strip():
                self._count_bad(line)
            self._synchronised = True  # the first line may have begun before the port was opened
        return records

    def _record(self, line: bytes) -> list[float] | None:
        fields = line.decode("ascii", "replace").strip().split(self._separator)
        if len(fields) != self._n_columns:
            return None
        record = [0.0] * len(fields)
        try:
            for index in self._limits:
                record[index] = float(fields[index])
        except ValueError:
            return None
        return self._plausible(record)


class BinaryDecoder(RecordDecoder):
    """Binary records of one length.

        sync bytes | values | checksum

    Args:
        columns: Column of each value, of `COLUMNS` or "-".
        layout: The values as of Python's `struct`, byte order included, such as "<Ihhh".
        sync: Bytes that each record begins with, at least one.
        checksum: One of `CHECKSUMS`.
    """

    def __init__(self, columns: Sequence[str], layout: str, sync: bytes, checksum: str) -> None:
        super().__init__(columns, [None if bits is None else 1 << bits for bits in integer_bits(layout)])
        self._values = struct.Struct(layout)
        self._sync = sync
        self._n_check, self._check = CHECKSUMS[checksum]
        self._length = len(sync) + self._values.size + self._n_check
        # Without a checksum, the next record has to begin where this one ends.
        self._n_ahead = 0 if self._n_check else len(sync)
        self._buffer = bytearray()
        self._skipped = b""

    def reset(self) -> None:
        """Drop an incomplete record: the port has been opened anew."""
        super().reset()
        self._buffer.clear()
        self._skipped = b""

    def _parse(self, data: bytes) -> list[list[float]]:
        buffer = self._buffer
        buffer += data
        records: list[list[float]] = []
        at = 0
        while (found := buffer.find(self._sync, at)) >= 0:
            self._skip(buffer[at:found])
            at = found
            end = at + self._length + self._n_ahead
            if len(buffer) < end:
                break
            record = self._record(bytes(buffer[at:end]))
            if record is None:
                self._skip(buffer[at : at + 1])
                at += 1
            else:
                if self._skipped and self._synchronised:
                    self._count_bad(self._skipped)
                self._skipped, self._synchronised = b"", True
                records.append(record)
                at += self._length
        else:  # the last bytes may be the first of the next sync bytes
            keep = max(at, len(buffer) - len(self._sync) + 1)
            self._skip(buffer[at:keep])
            at = keep
        del buffer[:at]
        return records

    def _record(self, record: bytes) -> list[float] | None:
        body = record[len(self._sync) : self._length - self._n_check]
        checksum = int.from_bytes(record[self._length - self._n_check : self._length], "little")
        if self._n_ahead and record[self._length :] != self._sync:
            return None
        if self._check(body) != checksum:
            return None
        return self._plausible([float(value) for value in self._values.unpack(body)])

    def _skip(self, data: bytes | bytearray) -> None:
        self._skipped += data[: MAX_RECORD_BYTES - len(self._skipped)]
