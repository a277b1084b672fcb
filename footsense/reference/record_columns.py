"""Columns of a force sensor's records: names, plausible ranges, bit widths."""

import re
import struct

#: Time columns and their unit [ns].
NS_PER_TIME_COLUMN_UNIT = {"time_s": 1_000_000_000, "time_ms": 1_000_000, "time_us": 1_000}
#: Columns with a meaning; others are called "-".
COLUMNS = (*NS_PER_TIME_COLUMN_UNIT, "sequence", "fx", "fy", "fz", "saturated")

#: Longest line or record [bytes].
MAX_RECORD_BYTES = 1024

#: Limits that only corrupt bytes exceed: a century [ns], a counter of 35 bits, a force whose square overflows nothing.
#: Without them, one corrupt record would spoil all times or offsets.
_MAX_NS, _MAX_SEQUENCE, _MAX_FORCE = 4e18, 3e10, 1e12


def max_plausible_magnitude(column: str) -> float:
    """Return the largest plausible magnitude of a column, in the column's unit."""
    if column in NS_PER_TIME_COLUMN_UNIT:
        return _MAX_NS / NS_PER_TIME_COLUMN_UNIT[column]
    return _MAX_SEQUENCE if column == "sequence" else _MAX_FORCE


def integer_widths_bits(layout: str) -> list[int | None]:
    """Return the bit width of each value of a `struct` layout; None for floating point.

    Raises:
        struct.error: The layout is invalid, too long, has gaps, or holds something else than numbers.

    Example:
        >>> integer_widths_bits("<IH2hf")
        [32, 16, 16, 16, None]
    """
    size = struct.Struct(layout).size  # raises if it is invalid
    if size > MAX_RECORD_BYTES:
        raise struct.error(f"{size} bytes are no record, at most {MAX_RECORD_BYTES} are")
    order, counted = (layout[0], layout[1:]) if layout[:1] in tuple("<>=!@") else ("@", layout)
    codes = re.sub(r"(\d*)(\D)", lambda match: match[2] * int(match[1] or 1), counted.replace(" ", ""))
    for code in codes:
        if code not in "bBhHiIlLqQfd":
            raise struct.error(f"{code!r} is no number")
    if not codes or size != sum(struct.calcsize(order + code) for code in codes):
        raise struct.error("gaps between the values; begin with < or >")
    return [None if code in "fd" else 8 * struct.calcsize(order + code) for code in codes]
