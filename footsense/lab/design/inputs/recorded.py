"""Largest force in a recording, as the full load of a design."""

import csv
from pathlib import Path

from footsense.errors import FootsenseError

#: Columns are forces if their names end so.
_FORCE_COLUMN_SUFFIX = "z_n"


def largest_recorded_vertical_force_n(path: Path) -> float:
    """Return the largest vertical force in a recording [N], over all columns named `..z_n`.

    Args:
        path: CSV with a header, as `footsense export --csv` writes it.

    Raises:
        FootsenseError: It cannot be read, or has no such column or no number in it.
    """
    try:
        with path.open(newline="", encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise FootsenseError(f"{path}: cannot be read as CSV: {error}") from error
    columns = [name for name in (rows[0] if rows else {}) if name and name.endswith(_FORCE_COLUMN_SUFFIX)]
    if not columns:
        raise FootsenseError(
            f"{path}: no column of forces: a name that ends in {_FORCE_COLUMN_SUFFIX}, "
            f"such as force_{_FORCE_COLUMN_SUFFIX}"
        )
    values: list[float] = []
    for row in rows:
        for name in columns:
            try:
                values.append(float(row[name]))
            except (TypeError, ValueError):
                continue
    largest = max((value for value in values if value == value), default=0.0)  # noqa: PLR0124 - a NaN is not itself
    if largest <= 0.0:
        raise FootsenseError(f"{path}: no force above 0 in {', '.join(columns)}")
    return largest
