"""Convert a recording to one table: a row per leg and cycle, a column per value, units in the column names."""

from collections.abc import Iterator, Mapping
from operator import attrgetter
from typing import Any

import numpy as np

from footsense.frames import USABLE, Cycle, GaitEventKind
from footsense.recording.replay import Replay
from footsense.ring.cycle_fields import (
    CYCLE_FIELDS,
    GAIT_FIELDS,
    CycleField,
)

#: A row: numbers or names, one for each column; NaN and None stand for values that are not known.
Row = list[Any]

_FORCE_FIELDS = {path: field for path, field in CYCLE_FIELDS.items() if path.startswith("forces.")}
_SCAN_FIELDS = {path: field for path, field in CYCLE_FIELDS.items() if path not in _FORCE_FIELDS}
_FIRST_COLUMNS = ("sequence", "t_sent_ns", "leg")
_EVENT_COLUMNS = ("event", "event_t_ns", "friction")


def _column_names(fields: Mapping[str, CycleField]) -> list[str]:
    """Return the column names of fields, one per component."""
    names: list[str] = []
    for field in fields.values():
        n_values = int(np.prod(field.row_shape))
        names += (
            field.json_keys
            if len(field.json_keys) == n_values
            else [f"{field.json_keys[0]}_{e}" for e in range(n_values)]
        )
    return names


#: Names of the columns in their order; those of the elements end in the number of the element.
COLUMN_NAMES = (
    *_FIRST_COLUMNS,
    *_column_names(_FORCE_FIELDS),
    *_column_names(GAIT_FIELDS),
    *_EVENT_COLUMNS,
    *_column_names(_SCAN_FIELDS),
)
_EMPTY_GAIT_ROW: Row = [None] * len(_column_names(GAIT_FIELDS))
_CONTACT_COLUMN_INDICES = tuple(
    list(GAIT_FIELDS).index(path) for path in ("gait.contact", "gait.contact_raw")
)


def read_rows(replay: Replay) -> Iterator[list[Row]]:
    """Yield the table's rows of each cycle, one row per leg.

    Args:
        replay: The recording.

    Yields:
        The rows of each cycle, a list of values for each leg, in the order of `COLUMN_NAMES`.

    Raises:
        RecordingError: The rest of the file is cut off or damaged.
    """
    for cycle in replay:
        yield _cycle_rows(cycle, replay.legs)


def _cycle_rows(cycle: Cycle, legs: tuple[str, ...]) -> list[Row]:
    """Return the table's rows of one cycle, one row per leg."""
    forces, gait = cycle.forces, cycle.forces.gait
    of_forces, of_scan = _rows_by_leg(cycle, _FORCE_FIELDS), _rows_by_leg(cycle, _SCAN_FIELDS)
    of_gait = [_EMPTY_GAIT_ROW] * len(legs) if gait is None else _rows_by_leg(forces, GAIT_FIELDS)
    rows = []
    for row, leg in enumerate(legs):
        events = [event for event in gait.events if event.leg == row] if gait else []
        told = [
            " ".join(GaitEventKind(event.kind).name for event in events) or None,
            events[-1].t_ns if events else None,
            gait.friction if gait else None,
        ]
        if int(forces.state[row]) not in USABLE:  # nothing is known about its contact
            of_gait[row] = [
                None if at in _CONTACT_COLUMN_INDICES else value for at, value in enumerate(of_gait[row])
            ]
        first = [forces.sequence, forces.t_sent_ns, leg]
        rows.append([*first, *of_forces[row], *of_gait[row], *told, *of_scan[row]])
    return rows


def _rows_by_leg(frame: Any, fields: Mapping[str, CycleField]) -> list[Row]:  # noqa: ANN401 - frames of three kinds
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
