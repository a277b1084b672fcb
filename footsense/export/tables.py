"""Export of a recording as one table, CSV: a row per leg and cycle, units in the column names."""

import csv
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from footsense.frames import USABLE, Cycle, CycleField, GaitEventKind
from footsense.recording.messages import FORCE_FIELDS, SCAN_FIELDS, leg_objects
from footsense.recording.replay import Replay
from footsense.ring.records import GAIT_FIELDS


def _columns(fields: Mapping[str, CycleField]) -> Iterator[str]:
    """Yield the names of the columns of some fields, one per component; those of the elements end in their number."""
    for field in fields.values():
        n_values, names = math.prod(field.row_shape), field.json_keys
        yield from names if len(names) == n_values else (f"{names[0]}_{i}" for i in range(n_values))


#: Names of the columns in their order: the keys of a recording's messages.
COLUMN_NAMES = (
    *("sequence", "t_sent_ns", "leg"),
    *_columns(FORCE_FIELDS),
    *_columns(GAIT_FIELDS),
    *("event", "event_t_ns", "friction"),
    *_columns(SCAN_FIELDS),
)


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
        writer = csv.DictWriter(file, COLUMN_NAMES)
        writer.writeheader()
        for cycle in replay:
            for row in _rows(cycle, replay.legs):
                writer.writerow({key: _cell(key, value) for key, value in row.items()})
            n_cycles += 1
    return n_cycles


def _rows(cycle: Cycle, legs: Sequence[str]) -> Iterator[dict[str, Any]]:
    """Yield the row of each leg, values by column."""
    forces, gait = cycle.forces, cycle.forces.gait
    of_forces, of_scan = (
        leg_objects(frame, legs, fields)
        for frame, fields in ((forces, FORCE_FIELDS), (cycle.scan, SCAN_FIELDS))
    )
    of_gait = None if gait is None else leg_objects(gait, legs, GAIT_FIELDS)
    for row, leg in enumerate(legs):
        values = {"sequence": forces.sequence, "t_sent_ns": forces.t_sent_ns, "leg": leg, **of_forces[leg]}
        if gait is not None and of_gait is not None:
            events = [event for event in gait.events if event.leg == row]
            values |= of_gait[leg]
            values["event"] = " ".join(GaitEventKind(event.kind).name for event in events)
            values["event_t_ns"] = events[-1].t_ns if events else None
            values["friction"] = gait.friction
        if int(forces.state[row]) not in USABLE:  # nothing is known about its contact
            values["contact"] = values["contact_raw"] = None
        for key, readings in of_scan[leg].items():
            values |= {f"{key}_{element}": reading for element, reading in enumerate(readings)}
        yield values


def _cell(column: str, value: Any) -> Any:  # noqa: ANN401 - numbers and names
    """Return what stands in a cell: nothing for NaN, and for a time of 0, which is none."""
    is_unknown = value != value or (value == 0 and "_ns" in column)  # noqa: PLR0124 - NaN differs from itself
    return None if is_unknown else value
