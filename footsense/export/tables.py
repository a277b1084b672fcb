"""Export of a recording as one table, CSV: a row per leg and cycle, units in the column names."""

import csv
import math
from collections.abc import Iterator, Mapping
from operator import attrgetter
from pathlib import Path
from typing import Any

from footsense.frames import USABLE, CycleField, GaitEventKind
from footsense.recording.replay import Replay
from footsense.ring.records import CYCLE_FIELDS, GAIT_FIELDS

#: A row: numbers or names, one for each column; NaN and None stand for values that are not known.
_Row = list[Any]

_FORCE_FIELDS = {path: field for path, field in CYCLE_FIELDS.items() if path.startswith("forces.")}
_SCAN_FIELDS = {path: field for path, field in CYCLE_FIELDS.items() if path not in _FORCE_FIELDS}


def _columns(fields: Mapping[str, CycleField]) -> tuple[str, ...]:
    """Return the names of the columns of some fields, one per component."""
    columns: list[str] = []
    for field in fields.values():
        n_values, names = math.prod(field.row_shape), field.json_keys
        if len(names) < n_values:
            names = tuple(f"{names[0]}_{element}" for element in range(n_values))
        columns += names
    return tuple(columns)


_GAIT_COLUMNS = _columns(GAIT_FIELDS)
#: Names of the columns in their order; those of the elements end in the number of the element.
COLUMN_NAMES = (
    *("sequence", "t_sent_ns", "leg"),
    *_columns(_FORCE_FIELDS),
    *_GAIT_COLUMNS,
    *("event", "event_t_ns", "friction"),
    *_columns(_SCAN_FIELDS),
)
_EMPTY_GAIT_ROW: _Row = [None] * len(_GAIT_COLUMNS)
_CONTACT_COLUMNS = tuple(_GAIT_COLUMNS.index(name) for name in ("contact", "contact_raw"))


def write_csv(replay: Replay, path: Path) -> int:
    """Write a recording as CSV, unknown values as empty cells; return the number of cycles.

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
        for rows in _rows(replay):
            # None is an empty cell already; NaN is the value that differs from itself.
            writer.writerows(["" if value != value else value for value in row] for row in rows)  # noqa: PLR0124
            n_cycles += 1
    return n_cycles


def _rows(replay: Replay) -> Iterator[list[_Row]]:
    """Yield the rows of each cycle, one for each leg."""
    for cycle in replay:
        forces, gait = cycle.forces, cycle.forces.gait
        of_forces, of_scan = _rows_by_leg(cycle, _FORCE_FIELDS), _rows_by_leg(cycle, _SCAN_FIELDS)
        of_gait = [_EMPTY_GAIT_ROW] * len(replay.legs) if gait is None else _rows_by_leg(forces, GAIT_FIELDS)
        rows = []
        for row, leg in enumerate(replay.legs):
            events = [event for event in gait.events if event.leg == row] if gait else []
            told = [
                " ".join(GaitEventKind(event.kind).name for event in events) or None,
                events[-1].t_ns if events else None,
                gait.friction if gait else None,
            ]
            if int(forces.state[row]) not in USABLE:  # nothing is known about its contact
                of_gait[row] = [
                    None if column in _CONTACT_COLUMNS else value for column, value in enumerate(of_gait[row])
                ]
            first = [forces.sequence, forces.t_sent_ns, leg]
            rows.append([*first, *of_forces[row], *of_gait[row], *told, *of_scan[row]])
        yield rows


def _rows_by_leg(frame: Any, fields: Mapping[str, CycleField]) -> list[_Row]:  # noqa: ANN401 - frames of three kinds
    """Return one row per leg with the values of a frame's fields, one value per column."""
    columns: list[list[Any]] = []
    for path, field in fields.items():
        array = attrgetter(path)(frame)
        flat = array.reshape(len(array), -1).T.tolist()
        if field.code_enum is not None:
            flat = [[field.code_enum(code).name for code in one] for one in flat]
        elif field.dtype == "<i8":  # times, 0 for none
            flat = [[t_ns or None for t_ns in one] for one in flat]
        columns += flat
    return [list(row) for row in zip(*columns, strict=True)]
