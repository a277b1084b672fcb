"""Export a recording as a Parquet file (pandas, Polars, DuckDB, Matlab); needs the extra `parquet`."""

from itertools import islice
from pathlib import Path
from typing import Any

import pyarrow as pa
from pyarrow import parquet

from footsense.export.table import COLUMN_NAMES, read_rows
from footsense.recording.replay import Replay

#: Cycles in a group of rows: ten seconds of walking.
_CYCLES_PER_ROW_GROUP = 4_000
_TEXT_COLUMNS = {"leg", "state", "cause", "baseline_status", "slip", "event"}
_BOOLEAN_COLUMNS = {"contact", "contact_raw"}
_INTEGER_COLUMNS = {"sequence", "fault_mask", "flags"}


def write_parquet(replay: Replay, path: Path) -> int:
    """Write a recording as a Parquet file; return the number of cycles.

    Args:
        replay: The recording.
        path: The new file.

    Raises:
        OSError: The file cannot be written.
        RecordingError: The recording is cut short; what is whole was written.
    """
    schema = pa.schema([(name, _column_type(name)) for name in COLUMN_NAMES])
    cycles = read_rows(replay)
    n_cycles = 0
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


def _column_type(name: str) -> Any:  # noqa: ANN401 - the library is not typed
    """Return the Arrow type of a column."""
    if name in _TEXT_COLUMNS:
        return pa.dictionary(pa.int8(), pa.string()) if name != "event" else pa.string()
    if name in _BOOLEAN_COLUMNS:
        return pa.bool_()
    is_whole = (
        name in _INTEGER_COLUMNS or name.startswith("reading_") or name.endswith("_ns") or "t_ns_" in name
    )
    return pa.int64() if is_whole else pa.float64()
