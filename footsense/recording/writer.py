"""Child process that writes a recording from the ring: `python -m footsense.recording.writer FILE RING`.

RING is the number of a descriptor of the ring. Standard output is the open `FILE.partial`, which is renamed to FILE at
the end. Standard input is a pipe that ends when the service stops or is killed. Standard error gets a line of JSON for
what has been read, and at last one for the whole. `footsense.recording.recorder` starts this process with SIGINT and
SIGTERM blocked, so that it finishes the recording in each case.
"""

import contextlib
import json
import os
import select
import sys
from pathlib import Path

from footsense.child_process import drop_realtime
from footsense.errors import FootsenseError, RecordingError
from footsense.recording.mcap_writer import McapFile
from footsense.ring.cycle_reader import CycleReader
from footsense.ring.records import LostCycles, NumberedCycle

#: Longest time that cycles stay in an unfinished chunk [ns].
FLUSH_PERIOD_NS = 400_000_000
#: Longest time that cycles stay unread [ms].
_READ_PERIOD_MS = 200
#: So much at once comes only from a loop in virtual time, which waits for its recorder [bytes].
_MIN_BATCH_WITHOUT_PAUSE_BYTES = 1 << 17


class RecordingWriter:
    """Writes cycles and losses to an MCAP file.

    Args:
        file: The file.

    Attributes:
        n_cycles: Cycles handed to the kernel so far.
        n_lost: Cycles that were lost before the recorder read them.
    """

    def __init__(self, file: McapFile) -> None:
        self._file = file
        self._n_added = 0
        self._t_flushed_ns: int | None = None
        self.n_cycles = 0
        self.n_lost = 0

    def add(self, entry: NumberedCycle | LostCycles) -> None:
        """Write a cycle or a loss of cycles, and close the MCAP chunk if that is due."""
        n_bytes_written = self._file.n_bytes_written
        self._file.add_entry(entry)
        if isinstance(entry, LostCycles):
            self.n_lost += entry.n_cycles
            return
        # A chunk was full and is written; the force of this cycle may be in the next one.
        if self._file.n_bytes_written > n_bytes_written:
            self.n_cycles = self._n_added
        self._n_added += 1
        t_ns = entry.cycle.forces.t_sent_ns
        if self._t_flushed_ns is None:
            self._t_flushed_ns = t_ns
        elif t_ns - self._t_flushed_ns >= FLUSH_PERIOD_NS:
            self._t_flushed_ns = t_ns
            self.flush()

    def flush(self) -> None:
        """Write all complete cycles to the file."""
        self._file.flush()
        self.n_cycles = self._n_added

    def finish(self) -> None:
        """Write the last MCAP chunk and the index."""
        self.flush()
        self._file.finish()


def _report(report: int, **entries: object) -> None:
    # Without a reader if the service was killed, without room if its loop hangs.
    with contextlib.suppress(BrokenPipeError, BlockingIOError):
        os.write(report, json.dumps(entries).encode() + b"\n")


def _write_until_end(writer: RecordingWriter, reader: CycleReader, alive: int, report: int) -> None:
    end = select.poll()
    end.register(alive, 0)  # without events, poll still reports the end of the pipe
    n_read = 0
    while True:
        # Looked at first: what was written before the end is read after it.
        has_ended = end.poll(0 if n_read >= _MIN_BATCH_WITHOUT_PAUSE_BYTES else _READ_PERIOD_MS)
        start = reader.position
        for entry in reader.read():
            writer.add(entry)
        n_read = reader.position - start
        if n_read:
            _report(report, position=reader.position, n_lost=writer.n_lost)
        elif has_ended:
            return
        else:
            writer.flush()


def _remove_partial_suffix(path: Path) -> None:
    """Rename the complete recording from `FILE.partial` to `FILE`.

    Raises:
        RecordingError: FILE exists by now.
    """
    if path.exists():
        raise RecordingError("it appeared in the meantime and is not overwritten")
    path.with_name(path.name + ".partial").rename(path)


def main(path: Path, ring: int, alive: int = 0, fd: int = 1, report: int = 2) -> int:
    """Write a recording until the service ends; return the exit code.

    Args:
        path: Name of the file once it is complete.
        ring: Descriptor of the ring.
        alive: Descriptor of a pipe that ends with the service.
        fd: Descriptor of the open `.partial` file.
        report: Descriptor for the reports.

    Returns:
        The exit code: 0 if the recording is complete and has its name.
    """
    drop_realtime()
    failure, writer = "", None
    os.set_blocking(report, False)
    try:
        reader = CycleReader(fd=ring)
        reader.rewind(first_number=0)
        writer = RecordingWriter(McapFile(fd, reader.header))
        _write_until_end(writer, reader, alive, report)
        writer.finish()
        os.fsync(fd)
        _remove_partial_suffix(path)
    except OSError as error:
        failure = error.strerror or str(error)
    except FootsenseError as error:
        failure = str(error)
    os.set_blocking(report, True)
    _report(report, n_cycles=writer.n_cycles if writer else 0, failure=failure)
    return 1 if failure else 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), int(sys.argv[2])))
