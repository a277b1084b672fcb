"""Export a recording as a CSV file; unknown values are empty cells."""

import csv
import math
from pathlib import Path

from footsense.export.table import COLUMN_NAMES, read_rows
from footsense.recording.replay import Replay


def write_csv(replay: Replay, path: Path) -> int:
    """Write a recording as CSV; return the number of cycles.

    Args:
        replay: The recording.
        path: The new file.

    Raises:
        OSError: The file cannot be written.
        RecordingError: The recording is cut short; what is whole was written.
    """
    n_cycles = 0
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(COLUMN_NAMES)
        for rows in read_rows(replay):
            writer.writerows([["" if _is_missing_value(value) else value for value in row] for row in rows])
            n_cycles += 1
    return n_cycles


def _is_missing_value(value: object) -> bool:
    """Return whether a value is None or NaN."""
    return value is None or (isinstance(value, float) and math.isnan(value))
