"""Decoder of a force sensor that sends its records as lines of text."""

from collections.abc import Sequence

from footsense.reference.record_columns import MAX_RECORD_BYTES
from footsense.reference.record_decoder import RecordDecoder


class TextRecordDecoder(RecordDecoder):
    r"""Decoder of text lines of numbers, each ended by \n or \r\n.

    Args:
        columns: Column of each number, of `COLUMNS` or "-".
        separator: Text between them; "" for white space.
    """

    def __init__(self, columns: Sequence[str], separator: str) -> None:
        super().__init__(columns, [None] * len(columns))
        self._separator = separator or None
        self._rest = b""

    def reset(self) -> None:
        """Discard an incomplete text line, after the port was reopened."""
        super().reset()
        self._rest = b""

    def _parse_bytes(self, data: bytes) -> list[list[float]]:
        """Return the values of the text lines that these bytes complete."""
        *lines, self._rest = (self._rest + data).split(b"\n")
        if len(self._rest) > MAX_RECORD_BYTES:
            self._count_bad_record(self._rest)
            self._rest = b""
        records = []
        for line in lines:
            record = self._parse_record(line)
            if record is not None:
                records.append(record)
            elif self._synchronised and line.strip():
                self._count_bad_record(line)
            self._synchronised = True  # the first line may have begun before the port was opened
        return records

    def _parse_record(self, line: bytes) -> list[float] | None:
        """Return the values of one text line; None if it is invalid."""
        fields = line.decode("ascii", "replace").strip().split(self._separator)
        if len(fields) != self._n_columns:
            return None
        record = [0.0] * len(fields)
        try:
            for index in self._limits:
                record[index] = float(fields[index])
        except ValueError:
            return None
        return self._plausible_or_none(record)
