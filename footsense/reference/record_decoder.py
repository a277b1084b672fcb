"""The records of a bench's force sensor out of the bytes that it sends, as lines of text or as binary records.

Both resynchronise by themselves: what is not a record is skipped and counted, and the next one is read.
"""

import binascii
import re
import struct
from collections.abc import Callable, Sequence
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "CHECKSUMS",
    "COLUMNS",
    "TIMES",
    "BinaryDecoder",
    "Decoder",
    "LineDecoder",
    "Rows",
    "integer_bits",
    "most",
]

#: Columns that mean something, and the length of a unit of time [ns] of those that are one; others are called "-".
TIMES = {"time_s": 1_000_000_000, "time_ms": 1_000_000, "time_us": 1_000}
COLUMNS = (*TIMES, "sequence", "fx", "fy", "fz", "saturated")

#: Longest line or record [bytes]; what is longer is none.
_LONGEST = 1024

#: What no sensor says, and bytes that were garbled may: a century and more [ns], a number of 35 bits, a force whose
#: square is none. Beyond it a record is none, else one would put all times or zeros wrong.
_MOST_NS, _MOST_NUMBER, _MOST_FORCE = 4e18, 3e10, 1e12

#: Checksums of a binary record: over all between the sync bytes and itself, little-endian.
CHECKSUMS: dict[str, tuple[int, Callable[[bytes], int]]] = {
    "none": (0, lambda _: 0),
    "sum8": (1, lambda data: sum(data) & 0xFF),
    "xor8": (1, lambda data: int(np.bitwise_xor.reduce(np.frombuffer(data, np.uint8)))),
    # CRC-16/CCITT-FALSE: polynomial 0x1021, start 0xFFFF, check value 0x29B1.
    "crc16": (2, lambda data: binascii.crc_hqx(data, 0xFFFF)),
}


class Rows(NamedTuple):
    """Records of a sensor, oldest first.

    Attributes:
        t_ns: The sensor's own time of each [ns], shape (n,), int64; None if it sends none.
        sequence: Their numbers, shape (n,), int64; None if it sends none.
        raw: The three forces as sent, shape (n, 3).
        saturated: Whether the sensor says so, shape (n,).
    """

    t_ns: NDArray[np.int64] | None
    sequence: NDArray[np.int64] | None
    raw: NDArray[np.float64]
    saturated: NDArray[np.bool_]


class Decoder(Protocol):
    """What turns bytes into records.

    Attributes:
        n_bad: Lines or records that were none.
        last_bad: The last of them.
    """

    n_bad: int
    last_bad: bytes

    def feed(self, data: bytes) -> Rows:
        """Return the records that these bytes complete."""
        ...

    def reset(self) -> None:
        """Forget what is not complete: the line has been opened anew."""
        ...


class _Columns:
    """Which value of a record is what, and counters that have wrapped made whole."""

    def __init__(self, names: Sequence[str], wraps: Sequence[int | None]) -> None:
        self.n = len(names)
        self._forces = [names.index(axis) for axis in ("fx", "fy", "fz")]
        self._time = next(((names.index(name), unit) for name, unit in TIMES.items() if name in names), None)
        self._sequence = names.index("sequence") if "sequence" in names else None
        self._saturated = names.index("saturated") if "saturated" in names else None
        self.used = [index for index, name in enumerate(names) if name != "-"]
        self._most = [(index, most(names[index])) for index in self.used]
        self._wraps = wraps
        self._whole: dict[int, int] = {}

    def may_be(self, record: Sequence[float]) -> bool:
        """Tell whether a sensor may have said this; NaN it may not."""
        return all(abs(record[index]) <= most_there for index, most_there in self._most)

    def rows(self, records: list[list[float]]) -> Rows:
        values = np.array(records, dtype=np.float64).reshape(-1, self.n)
        time = sequence = None
        if self._time is not None:
            index, unit_ns = self._time
            time = np.rint(self._unwrapped(values[:, index], index) * unit_ns).astype(np.int64)
        if self._sequence is not None:
            sequence = self._unwrapped(values[:, self._sequence], self._sequence).astype(np.int64)
        none = np.zeros(len(values), np.bool_)
        saturated = none if self._saturated is None else values[:, self._saturated] != 0
        return Rows(time, sequence, values[:, self._forces], saturated)

    def _unwrapped(self, counts: NDArray[np.float64], index: int) -> NDArray[np.float64]:
        """Return counts that never wrap; one that goes back by less than half its range has gone back."""
        wrap = self._wraps[index]
        if wrap is None or not len(counts):
            return counts
        whole = []
        for count in counts.astype(np.int64).tolist():
            last = self._whole.get(index, count)
            step = (count - last) % wrap
            self._whole[index] = last + (step if step < wrap // 2 else step - wrap)
            whole.append(self._whole[index])
        return np.array(whole, np.float64)


class LineDecoder:
    r"""Lines of numbers, each ended by \n or \r\n.

    Args:
        columns: What each number is, some of `COLUMNS` or "-".
        separator: What stands between them; "" for any white space.

    Attributes:
        n_bad: Lines that were none, but for the first after the opening, which may have begun before.
        last_bad: The last of them.
    """

    def __init__(self, columns: Sequence[str], separator: str) -> None:
        self._columns = _Columns(columns, [None] * len(columns))
        self._separator = separator or None
        self._rest = b""
        self._begun = False
        self.n_bad = 0
        self.last_bad = b""

    def feed(self, data: bytes) -> Rows:
        """Return the records that these bytes complete."""
        *lines, self._rest = (self._rest + data).split(b"\n")
        if len(self._rest) > _LONGEST:
            self._note(self._rest)
            self._rest = b""
        records = []
        for line in lines:
            record = self._record(line)
            if record is not None:
                records.append(record)
            elif self._begun and line.strip():
                self._note(line)
            self._begun = True
        return self._columns.rows(records)

    def reset(self) -> None:
        """Forget what is not complete: the line has been opened anew."""
        self._rest, self._begun = b"", False

    def _record(self, line: bytes) -> list[float] | None:
        fields = line.decode("ascii", "replace").strip().split(self._separator)
        if len(fields) != self._columns.n:
            return None
        record = [0.0] * len(fields)
        try:
            for index in self._columns.used:
                record[index] = float(fields[index])
        except ValueError:
            return None
        return record if self._columns.may_be(record) else None

    def _note(self, line: bytes) -> None:
        self.n_bad += 1
        self.last_bad = line[:60]


class BinaryDecoder:
    """Binary records of one length.

        sync bytes | values | checksum

    Args:
        columns: What each value is, some of `COLUMNS` or "-".
        layout: The values as of Python's `struct`, byte order included, such as "<Ihhh".
        sync: Bytes that each record begins with, at least one.
        checksum: One of `CHECKSUMS`.

    Attributes:
        n_bad: Runs of bytes that were no record.
        last_bad: The last of them.
    """

    def __init__(self, columns: Sequence[str], layout: str, sync: bytes, checksum: str) -> None:
        self._values = struct.Struct(layout)
        wraps = [None if bits is None else 1 << bits for bits in integer_bits(layout)]
        self._columns = _Columns(columns, wraps)
        self._sync = sync
        self._n_check, self._check = CHECKSUMS[checksum]
        self._length = len(sync) + self._values.size + self._n_check
        self._n_ahead = 0 if self._n_check else len(sync)
        self._buffer = bytearray()
        self._skipped = b""
        self._begun = False
        self.n_bad = 0
        self.last_bad = b""

    def feed(self, data: bytes) -> Rows:
        """Return the records that these bytes complete."""
        buffer = self._buffer
        buffer += data
        records: list[list[float]] = []
        at = 0
        while (found := buffer.find(self._sync, at)) >= 0:
            self._skip(buffer[at:found])
            at = found
            if len(buffer) < at + self._length + self._n_ahead:
                break
            record = self._record(bytes(buffer[at : at + self._length + self._n_ahead]))
            if record is None:
                self._skip(buffer[at : at + 1])
                at += 1
            else:
                self._end_skipping()
                records.append(record)
                at += self._length
        else:  # the last bytes may be the first of the next sync bytes
            keep = max(at, len(buffer) - len(self._sync) + 1)
            self._skip(buffer[at:keep])
            at = keep
        del buffer[:at]
        return self._columns.rows(records)

    def reset(self) -> None:
        """Forget what is not complete: the line has been opened anew."""
        self._buffer.clear()
        self._skipped, self._begun = b"", False

    def _record(self, record: bytes) -> list[float] | None:
        n_sync, n_end = len(self._sync), self._length - self._n_check
        body = record[n_sync:n_end]
        # Without a checksum, the next record has to begin where this one ends.
        if self._n_ahead and record[self._length :] != self._sync:
            return None
        if self._check(body) != int.from_bytes(record[n_end : self._length], "little"):
            return None
        values = [float(value) for value in self._values.unpack(body)]
        return values if self._columns.may_be(values) else None

    def _skip(self, data: bytes | bytearray) -> None:
        self._skipped += data[: _LONGEST - len(self._skipped)]

    def _end_skipping(self) -> None:
        if self._skipped and self._begun:
            self.n_bad += 1
            self.last_bad = self._skipped[:60]
        self._skipped, self._begun = b"", True


def most(column: str) -> float:
    """Return the largest value that a sensor may say in a column, in that column's unit."""
    if column in TIMES:
        return _MOST_NS / TIMES[column]
    return _MOST_NUMBER if column == "sequence" else _MOST_FORCE


def integer_bits(layout: str) -> list[int | None]:
    """Return for each value of a layout how many bits it counts with, None where it does not count.

    Raises:
        struct.error: The layout is none, or holds something else than numbers.

    Example:
        >>> integer_bits("<IH2hf")
        [32, 16, 16, 16, None]
    """
    size = struct.Struct(layout).size  # checks it
    if size > _LONGEST:
        raise struct.error(f"{size} bytes are no record, at most {_LONGEST} are")
    order, counted = (layout[0], layout[1:]) if layout[:1] in tuple("<>=!@") else ("@", layout)
    codes = re.sub(r"(\d*)(\D)", lambda found: found[2] * int(found[1] or 1), counted.replace(" ", ""))
    for code in codes:
        if code not in "bBhHiIlLqQfd":
            raise struct.error(f"{code!r} is no number")
    if not codes or size != sum(struct.calcsize(order + code) for code in codes):
        raise struct.error("gaps between the values; begin with < or >")
    return [None if code in "fd" else 8 * struct.calcsize(order + code) for code in codes]
