"""Driver of a force sensor that sends lines of text on a (real or simulated) serial port.

The decoder resynchronises: what is no record is skipped and counted, and the next line is read.
"""

from collections.abc import Sequence

import numpy as np

from footsense.frames import ReferenceSamples
from footsense.ports import SerialPort
from footsense.reference.sample_stream import SampleStream, SensorRecords

#: Time columns and their unit [ns]; the others are `sequence`, `fx`, `fy`, `fz`, `saturated`, and `-` for unused ones.
NS_PER_TIME_COLUMN_UNIT = {"time_s": 1_000_000_000, "time_ms": 1_000_000, "time_us": 1_000}

_MAX_LINE_BYTES = 1024
#: Limits that only corrupt bytes exceed: a century [ns], a counter of 35 bits, a force whose square overflows nothing.
#: Without them, one corrupt record would spoil all times or offsets.
_MAX_NS, _MAX_SEQUENCE, _MAX_FORCE = 4e18, 3e10, 1e12


class LineDecoder:
    r"""Decoder of text lines of numbers, each ended by \n or \r\n.

    Args:
        columns: Meaning of each number: `fx`, `fy`, `fz`, and at most one each of a time, `sequence` and `saturated`.
        separator: Text between them; "" for white space.

    Attributes:
        n_bad: Lines that were no record.
        last_bad: The last of them.
    """

    def __init__(self, columns: Sequence[str], separator: str) -> None:
        self._n_columns = len(columns)
        self._index_of_name = {name: index for index, name in enumerate(columns) if name != "-"}
        self._separator = separator or None
        self._rest = b""
        self._synchronised = False
        self.n_bad = 0
        self.last_bad = b""

    def reset(self) -> None:
        """Discard an incomplete line, after the port was reopened."""
        self._rest, self._synchronised = b"", False

    def feed(self, data: bytes) -> SensorRecords:
        """Return the records that these bytes complete."""
        *lines, self._rest = (self._rest + data).split(b"\n")
        if len(self._rest) > _MAX_LINE_BYTES:
            self._count_bad_line(self._rest)
            self._rest = b""
        records = []
        for line in lines:
            record = self._parse_line(line)
            if record is not None:
                records.append(record)
            elif self._synchronised and line.strip():
                self._count_bad_line(line)
            self._synchronised = True  # the first line may have begun before the port was opened
        values = np.array(records, np.float64).reshape(-1, len(self._index_of_name))
        by_name = dict(zip(self._index_of_name, values.T, strict=True))
        time = next((name for name in NS_PER_TIME_COLUMN_UNIT if name in by_name), None)
        return SensorRecords(
            np.rint(by_name[time] * NS_PER_TIME_COLUMN_UNIT[time]).astype(np.int64) if time else None,
            by_name["sequence"].astype(np.int64) if "sequence" in by_name else None,
            np.column_stack([by_name[axis] for axis in ("fx", "fy", "fz")]),
            by_name.get("saturated", np.zeros(len(values))) != 0,
        )

    def _parse_line(self, line: bytes) -> list[float] | None:
        """Return the numbers of a line; None if one is missing, NaN, or impossible for a sensor."""
        texts = line.decode("ascii", "replace").strip().split(self._separator)
        if len(texts) != self._n_columns:
            return None
        values = []
        for column, index in self._index_of_name.items():
            try:
                value = float(texts[index])
            except ValueError:
                return None
            limit = _MAX_SEQUENCE if column == "sequence" else _MAX_FORCE
            if column in NS_PER_TIME_COLUMN_UNIT:
                limit = _MAX_NS / NS_PER_TIME_COLUMN_UNIT[column]
            if not abs(value) <= limit:
                return None
            values.append(value)
        return values

    def _count_bad_line(self, line: bytes) -> None:
        self.n_bad += 1
        self.last_bad = line[:60]


class SerialReference:
    """Driver of a force sensor on a serial port that streams by itself or after a start command.

    Args:
        port: Source of its bytes.
        decoder: Decoder of its lines.
        stream: Conversion of the records to forces.
        start: Bytes to send after the port was opened; empty if it streams by itself.

    Attributes:
        statistics: Counts so far.
    """

    def __init__(
        self, port: SerialPort, decoder: LineDecoder, stream: SampleStream, start: bytes = b""
    ) -> None:
        self._port = port
        self._decoder = decoder
        self._stream = stream
        self.statistics = stream.statistics
        self._start = start
        self.statistics.n_stream_starts = port.n_opened
        port.write(start)

    def read(self, now_ns: int) -> ReferenceSamples:
        """Return the force samples received since the last call.

        Raises:
            ReferenceSensorError: The bytes are no records of this sensor.
        """
        data = self._port.read()
        if self._port.n_opened != self.statistics.n_stream_starts:
            self.statistics.n_stream_starts = self._port.n_opened
            self._decoder.reset()
            self._stream.restart_clock_sync()
            self._port.write(self._start)
        records = self._decoder.feed(data)
        self.statistics.n_bad_records = self._decoder.n_bad
        return self._stream.convert(records, len(data), now_ns, self._decoder.last_bad or data[:60])

    def close(self) -> None:
        """Close the serial port."""
        self._port.close()
