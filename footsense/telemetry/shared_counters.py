"""Counters in a self-describing memory-mapped file that one process writes and others read.

The loop must not answer HTTP: rendering the metrics in its process costs milliseconds. It adds to plain doubles in
shared memory at some ten nanoseconds each, and `footsense exporter` reads them at each scrape. There is one writer
and no lock on the cells: each double is whole by itself, and a scrape may fall between two of them.

The file::

    8 bytes   "FSCOUNT1"
    8 bytes   length n of the description, little-endian
    n bytes   the description: a JSON list of families, padded with blanks to a multiple of 8
    rest      cells: doubles of this machine, family after family

A family has one cell per combination of its label values, the last label fastest; a histogram has per combination
its buckets, the unbounded one, and the sum. The writer holds an exclusive flock(2) on the file for as long as it
lives, so a file without a lock is left over from a service that was killed.
"""

import json
import math
import struct
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Literal

import msgspec

from footsense.errors import FootsenseError
from footsense.shared_file import SharedFileWriter, is_locked

_MAGIC = b"FSCOUNT1"
_HEADER_STRUCT = struct.Struct("<8sQ")
#: Most that is read of a file of counters [bytes]; that of six legs has 14 thousand.
_MAX_BYTES = 1 << 20


@dataclass(frozen=True)
class MetricFamily:
    """Declaration of a metric family: name, type, help, label values, histogram bounds; without its values.

    Attributes:
        name: Name in Prometheus, with its unit; a counter's ends in `_total`.
        metric_type: Type in Prometheus.
        help: One sentence for readers of the metrics.
        label_values: Values that each label can have, in order.
        bucket_bounds: Upper bounds of a histogram's buckets, rising, without infinity.
    """

    name: str
    metric_type: Literal["counter", "gauge", "histogram"]
    help: str
    label_values: dict[str, list[str]] = field(default_factory=dict)
    bucket_bounds: list[float] = field(default_factory=list)

    @property
    def cells_per_label_set(self) -> int:
        """Number of values for one combination of label values."""
        return len(self.bucket_bounds) + 2 if self.metric_type == "histogram" else 1

    @property
    def n_cells(self) -> int:
        """Number of values of the whole family."""
        return self.cells_per_label_set * math.prod(len(values) for values in self.label_values.values())


class SharedCountersWriter:
    """Writer's end of the shared counters: creates the file, and removes it when closed.

    Args:
        families: Metrics in the order of their cells.
        path: The file. It should lie in memory (/dev/shm, /run): on a disk, write-back can block the writer.

    Attributes:
        cells: The counters, initially zero.
        first_cell: Index of each family's first cell, by name.

    Raises:
        FootsenseError: Another running service writes this file, or it cannot be created.
    """

    def __init__(self, families: list[MetricFamily], path: Path) -> None:
        description = json.dumps([asdict(family) for family in families]).encode()
        description += b" " * (-len(description) % 8)
        self.first_cell: dict[str, int] = {}
        n_cells = 0
        for family in families:
            self.first_cell[family.name] = n_cells
            n_cells += family.n_cells
        self._file = SharedFileWriter(
            path, _HEADER_STRUCT.pack(_MAGIC, len(description)) + description, 8 * n_cells
        )
        self.cells = self._file.cells.cast("d")

    def close(self) -> None:
        """Remove the file; a second call does nothing."""
        self.cells.release()
        self._file.close()


def read_counters(path: Path) -> tuple[list[MetricFamily], list[float]]:
    """Return the metric families of a running service and all their present values.

    Raises:
        FootsenseError: No running service writes the file, or `SharedCountersWriter` did not create it.
    """
    try:
        with path.open("rb") as file:
            content = file.read(_MAX_BYTES) if is_locked(file) else b""
        if not content:
            raise FootsenseError(f"{path}: its service has ended")
        magic, length = _HEADER_STRUCT.unpack_from(content)
        start = _HEADER_STRUCT.size + length
        families = msgspec.json.decode(content[_HEADER_STRUCT.size : start], type=list[MetricFamily])
        cells: list[float] = memoryview(content)[start:].cast("d").tolist()  # type: ignore[assignment]
    except OSError as error:
        raise FootsenseError(f"{path}: {error.strerror}") from error
    except (msgspec.DecodeError, ValueError, TypeError, struct.error) as error:
        raise FootsenseError(f"{path} does not hold footsense's counters: {error}") from error
    if magic != _MAGIC or len(cells) != sum(family.n_cells for family in families):
        raise FootsenseError(f"{path} does not hold footsense's counters")
    return families, cells
