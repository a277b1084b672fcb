"""Numbers that one process counts and another reads, in a memory-mapped file that describes itself.

The loop must not answer HTTP: rendering the metrics in its process costs it milliseconds. So it adds to plain
doubles in shared memory, at some ten nanoseconds each, and the exporter reads them when it is asked. There is one
writer and no lock: each number is whole by itself, and a scrape may fall between two of them.

The file::

    8 bytes   "FSCOUNT1"
    8 bytes   length n of the description, little-endian
    n bytes   the description: a JSON list of families, padded with blanks to a multiple of 8
    rest      cells: doubles of this machine, family after family

A family has a cell for each combination of its labels' values, the last label fastest; a histogram has for each
combination its buckets, the one without a bound, and the sum.
"""

import json
import math
import mmap
import os
import struct
import tempfile
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Literal

import msgspec

from footsense.errors import FootsenseError

__all__ = ["Family", "SharedCounters", "read_counters"]

_MAGIC = b"FSCOUNT1"
_HEAD = struct.Struct("<8sQ")


@dataclass(frozen=True)
class Family:
    """One metric with all its label values.

    Attributes:
        name: As Prometheus shows it, with its unit; a counter's ends in `_total`.
        kind: What Prometheus takes it for.
        help: One sentence for whoever reads the metrics.
        labels: Values of each label, in order.
        bounds: Upper bounds of a histogram's buckets, rising, without infinity.
    """

    name: str
    kind: Literal["counter", "gauge", "histogram"]
    help: str
    labels: dict[str, list[str]] = field(default_factory=dict)
    bounds: list[float] = field(default_factory=list)

    @property
    def width(self) -> int:
        """Cells of one combination of label values."""
        return len(self.bounds) + 2 if self.kind == "histogram" else 1

    @property
    def n_cells(self) -> int:
        """Cells of the whole family."""
        return self.width * math.prod(len(values) for values in self.labels.values())


class SharedCounters:
    """The writer's side: makes the file, and removes it at the end.

    Args:
        families: What is counted, in the order of the cells.
        directory: Where the file is made; by default in memory, /dev/shm, if there is such a place.

    Attributes:
        path: The file.
        cells: Its numbers, all zero at first.
        first: Index of each family's first cell, by name.
    """

    def __init__(self, families: list[Family], directory: Path | None = None) -> None:
        description = json.dumps([asdict(family) for family in families]).encode()
        description += b" " * (-len(description) % 8)
        self.first: dict[str, int] = {}
        n_cells = 0
        for family in families:
            self.first[family.name] = n_cells
            n_cells += family.n_cells
        if directory is None:
            memory = Path("/dev/shm")  # noqa: S108 - mkstemp makes a file that only this user can open
            directory = memory if os.access(memory, os.W_OK) else Path(tempfile.gettempdir())
        file, name = tempfile.mkstemp(prefix="footsense-", suffix=".counters", dir=directory)
        self.path = Path(name)
        try:
            start = _HEAD.size + len(description)
            os.write(file, _HEAD.pack(_MAGIC, len(description)) + description)
            os.ftruncate(file, start + 8 * n_cells)
            self._map = mmap.mmap(file, 0)
        finally:
            os.close(file)
        self.cells = memoryview(self._map)[start:].cast("d")

    def close(self) -> None:
        """Remove the file; what a reader has mapped stays readable to it. A second call does nothing."""
        self.path.unlink(missing_ok=True)
        self.cells.release()


def read_counters(path: Path) -> "tuple[list[Family], memoryview[float]]":
    """Return what is counted in a file and its living cells.

    Raises:
        FootsenseError: The file is missing or was not made by `SharedCounters`.
    """
    try:
        with path.open("rb") as file:
            shared = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
        magic, length = _HEAD.unpack_from(shared)
        if magic != _MAGIC:
            raise FootsenseError(f"{path} does not hold footsense's counters")
        start = _HEAD.size + length
        families = msgspec.json.decode(shared[_HEAD.size : start], type=list[Family])
        cells = memoryview(shared)[start:].cast("d")
    except OSError as error:
        raise FootsenseError(f"{path}: {error.strerror}") from error
    except (msgspec.DecodeError, ValueError, TypeError, struct.error) as error:
        raise FootsenseError(f"{path} does not hold footsense's counters: {error}") from error
    described = sum(family.n_cells for family in families)
    if len(cells) != described:
        raise FootsenseError(
            f"{path} does not hold footsense's counters: {len(cells)} cells instead of {described}"
        )
    return families, cells
