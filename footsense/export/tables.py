"""Export of a recording as one table, CSV or Parquet: a row per leg and cycle, units in the column names."""

import csv
import math
from collections.abc import Iterator, Mapping
from itertools import islice
from operator import attrgetter
from pathlib import Path
from typing import Any

from footsense.frames import USABLE, GaitEventKind
from footsense.recording.replay import Replay
from footsense.ring.cycle_fields import CYCLE_FIELDS, GAIT_FIELDS, CycleField

#: A row: numbers or names, one for each column; NaN and None stand for values that are not known.
_Row = list[Any]

_FORCE_FIELDS = {path: field for path, field in CYCLE_FIELDS.items() if path.startswith("forces.")}
_SCAN_FIELDS = {path: field for path, field in CYCLE_FIELDS.items() if path not in _FORCE_FIELDS}
#: Cycles in a group of rows of Parquet: ten seconds of walking.
_CYCLES_PER_ROW_GROUP = 4_000


def _columns(fields: Mapping[str, CycleField]) -> dict[str, str]:
    """Return the columns of some fields by name, one per component, with their types in Arrow."""
    columns: dict[str, str] = {}
    for field in fields.values():
        kind = "text" if field.code_enum else "bool_" if field.max_code == 1 else "int64"
        n_values = math.prod(field.row_shape)
        names = field.json_keys
        if len(names) < n_values:
            names = tuple(f"{names[0]}_{element}" for element in range(n_values))
        columns |= dict.fromkeys(names, "float64" if field.dtype == "<f8" else kind)
    return columns


_COLUMNS = {
    "sequence": "int64",
    "t_sent_ns": "int64",
    "leg": "text",
    **_columns(_FORCE_FIELDS),
    **_columns(GAIT_FIELDS),
    "event": "string",
    "event_t_ns": "int64",
    "friction": "float64",
    **_columns(_SCAN_FIELDS),
}
#: Names of the columns in their order; those of the elements end in the number of the element.
COLUMN_NAMES = tuple(_COLUMNS)
_EMPTY_GAIT_ROW: _Row = [None] * len(_columns(GAIT_FIELDS))
_CONTACT_COLUMNS = tuple(list(_columns(GAIT_FIELDS)).index(name) for name in ("contact", "contact_raw"))


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


def write_parquet(replay: Replay, path: Path) -> int:
    """Write a recording as Parquet (pandas, Polars, DuckDB, Matlab; extra `parquet`); return the number of cycles.

    Args:
        replay: The recording.
        path: The new file.

    Raises:
        OSError: The file cannot be written.
        RecordingError: The recording is cut short; what is whole was written.
    """
    import pyarrow as pa
    from pyarrow import parquet

    of_few_words = pa.dictionary(pa.int8(), pa.string())
    types = {kind: of_few_words if kind == "text" else getattr(pa, kind)() for kind in _COLUMNS.values()}
    schema = pa.schema([(name, types[kind]) for name, kind in _COLUMNS.items()])
    cycles, n_cycles = _rows(replay), 0
    with parquet.ParquetWriter(path, schema, compression="zstd") as writer:
        while group := list(islice(cycles, _CYCLES_PER_ROW_GROUP)):
            n_cycles += len(group)
            columns = zip(*(row for rows in group for row in rows), strict=True)
            # From pandas' point of view NaN is null, which is how an unknown value reads in every tool.
            arrays = [
                pa.array(column, type=field.type, from_pandas=True)
                for column, field in zip(columns, schema, strict=True)
            ]
            writer.write_table(pa.Table.from_arrays(arrays, schema=schema))
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
