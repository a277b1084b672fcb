"""Reader of the cycles of a running service: recorder, exporter, page and snapshot have no other."""

import mmap
import os
import zlib
from contextlib import suppress
from pathlib import Path

import msgspec

from footsense.errors import FootsenseError
from footsense.ring import ring_file
from footsense.ring.records import LostCycles, NumberedCycle, ServiceStatus, decode_record, legs_in_header

_MAX_HEADER_BYTES = 1 << 20
_MAX_RING_BYTES = 1 << 30
#: Most that is copied at once [bytes].
_MAX_READ_BYTES = 1 << 20


class CycleReader:
    """Reader of the cycles of a running service; begins with the last second.

    Args:
        path: The file; None for that of the robot's service, or without one of this user's simulated robot.
        fd: A descriptor of the file instead; closed by `close`.

    Attributes:
        path: The file.
        header: Entries of the header.
        legs: Name of the leg in each row of the frames.
        position: Position of the next record in the ring [bytes].
        status: Status of the service when the last cycles were written; None before the first.

    Raises:
        FootsenseError: No running service writes the file, or it holds something else.
    """

    def __init__(self, path: Path | None = None, fd: int | None = None) -> None:
        service_ring = ring_file.SERVICE_RING
        self.path = path or (service_ring if service_ring.exists() else ring_file.user_ring())
        self._fd = ring_file.open_ring(self.path) if fd is None else fd
        try:
            self.header = self._read_header()
            self.legs = legs_in_header(self.header)
        except (ValueError, LookupError, OSError, RecursionError) as error:
            os.close(self._fd)
            raise FootsenseError(f"{self.path} does not hold footsense's cycles: {error}") from error
        self.position: int = self._counters[ring_file.RECENT]
        self.status: ServiceStatus | None = None
        self._next_number: int | None = None
        #: Position of the record that was not whole, and the furthest `end` without another one behind it.
        self._doubted = (-1, 0)

    def _read_header(self) -> dict[str, str]:
        """Map the counters, and return the entries of the header.

        Raises:
            ValueError: They are not those of a ring.
        """
        self._counters = memoryview(mmap.mmap(self._fd, mmap.PAGESIZE, prot=mmap.PROT_READ)).cast("Q")
        n_header = self._counters[ring_file.HEADER_BYTES]
        self._place = ring_file.ring_place(n_header)
        self._n_bytes = os.fstat(self._fd).st_size - self._place
        if n_header > _MAX_HEADER_BYTES or not ring_file.MARGIN_BYTES < self._n_bytes <= _MAX_RING_BYTES:
            raise ValueError("it has other sizes")
        if os.pread(self._fd, len(ring_file.MAGIC), 0) != ring_file.MAGIC:
            raise ValueError("it begins otherwise")
        return msgspec.json.decode(os.pread(self._fd, n_header, ring_file.HEADER_PLACE), type=dict[str, str])

    def rewind(self, first_number: int | None = None) -> None:
        """Begin with the oldest cycle that the ring holds; those from a number on are counted as lost before it."""
        self.position = self._counters[ring_file.BEGIN]
        self._next_number = first_number

    @property
    def end(self) -> int:
        """Position behind the last record that was written [bytes]."""
        return int(self._counters[ring_file.END])

    def read(self) -> list[NumberedCycle | LostCycles]:
        """Return the cycles since the last call, some hundred at most, and the gaps between them; do not wait.

        A record that is not whole is left for the next call as long as none follows it, however often that is: on some
        processors its bytes may be seen later than `end`. So damage of the newest record is an error when the next one
        comes, and where the service has ended, as `is_still_written` tells, that cycle is not returned.

        Raises:
            FootsenseError: A record is damaged.
        """
        entries: list[NumberedCycle | LostCycles] = []
        for record in self._records():
            entry = decode_record(record, len(self.legs))
            if isinstance(entry, ServiceStatus):
                self.status = entry
                continue
            n_lost = 0 if self._next_number is None else entry.cycle_number - self._next_number
            if n_lost < 0:
                raise FootsenseError(f"{self.path}: a cycle comes twice")
            if n_lost:
                entries.append(LostCycles(entry.cycle_number, entry.cycle.forces.t_sent_ns, n_lost))
            entries.append(entry)
            self._next_number = entry.cycle_number + 1
        return entries

    def _records(self) -> list[bytes]:
        """Return the next whole records; those that were overwritten are skipped.

        Raises:
            FootsenseError: A record is damaged.
        """
        start, end = max(self.position, self._counters[ring_file.BEGIN]), self.end
        data = self._copy(start, min(end, start + _MAX_READ_BYTES))
        n_overwritten = max(0, self._counters[ring_file.BEGIN] - start)  # during the copy
        start, data = start + n_overwritten, data[n_overwritten:]
        records, at, n_head = [], 0, ring_file.RECORD_HEAD.size
        while at + n_head <= len(data):
            length, crc = ring_file.RECORD_HEAD.unpack_from(data, at)
            behind = at + n_head + length
            record = data[at + n_head : behind]
            is_possible = 0 < length <= ring_file.MAX_RECORD_BYTES and start + behind <= end
            if is_possible and behind > len(data):
                break  # the next copy has all of it
            if not is_possible or zlib.crc32(record, start + at) != crc:
                self._doubt(start + at, end)
                break
            records.append(record)
            at = behind
        self.position = start + at
        return records

    def _doubt(self, position: int, end: int) -> None:
        """Leave a record that is not whole for the next read.

        Raises:
            FootsenseError: It was doubted before, and another record follows it: that one's pwrite(2), which takes the
                file's lock, came between, so that all of this one's bytes have to be seen.
        """
        doubted_position, its_end = self._doubted
        if position != doubted_position:
            longest = ring_file.RECORD_HEAD.size + ring_file.MAX_RECORD_BYTES
            self._doubted = position, min(end, position + longest)
        elif end > its_end:
            raise FootsenseError(f"{self.path}: a record is damaged")

    def _copy(self, start: int, end: int) -> bytes:
        n, place = max(end - start, 0), start % self._n_bytes
        ahead = os.pread(self._fd, min(n, self._n_bytes - place), self._place + place)
        return ahead + os.pread(self._fd, n - len(ahead), self._place) if len(ahead) < n else ahead

    def is_still_written(self) -> bool:
        """Return whether the service still runs and its file has not been replaced."""
        with suppress(OSError):
            is_same = self.path.stat().st_ino == os.fstat(self._fd).st_ino
            return is_same and ring_file.is_locked(self._fd)
        return False

    def close(self) -> None:
        """Unmap and close the file."""
        self._counters.release()
        os.close(self._fd)
