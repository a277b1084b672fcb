"""Child process that writes a recording from the pipe of cycles: `python -m footsense.recording.writer FILE`.

Its standard input is the pipe, its standard output the open `FILE.partial`, which it renames to FILE at the end of
the pipe, and its standard error one line of JSON: the number of written cycles, and the failure that stopped it, if
any. The pipe ends when the service stops or is killed; `footsense.recording.recorder` starts this process with SIGINT
and SIGTERM blocked, so that it finishes the recording in both cases.
"""

import contextlib
import json
import os
import queue
import sys
import threading
from pathlib import Path

from footsense.child_process import drop_realtime, read_batches
from footsense.errors import RecordingError
from footsense.recording.container.mcap_writer import McapFile
from footsense.recording.cycle_records import LostCycles, NumberedCycle, legs_in_header, unpack_records

#: Longest time that cycles stay in an unfinished chunk [ns].
FLUSH_PERIOD_NS = 400_000_000

#: Pieces of the pipe that are kept while the disk hangs: 20 s at any rate of cycles.
_MAX_WAITING_BATCHES = 100


class RecordingWriter:
    """Decodes the bytes received from the pipe, and writes their cycles and losses to an MCAP file.

    Args:
        fd: The open file.

    Attributes:
        n_cycles: Cycles handed to the kernel so far.
    """

    def __init__(self, fd: int) -> None:
        self._fd = fd
        self._buffer = bytearray()
        self._file: McapFile | None = None
        self._legs: tuple[str, ...] | None = None
        self._n_added = 0
        self._t_flushed_ns: int | None = None
        self.n_cycles = 0

    def feed(self, data: bytes) -> None:
        """Write the complete records in the bytes received; keep an incomplete rest.

        Raises:
            RecordingError: The bytes are damaged.
        """
        self._buffer += data
        for entry in unpack_records(self._buffer, self._legs):
            if isinstance(entry, dict):
                self._file = McapFile(self._fd, entry)
                self._legs = legs_in_header(entry)
            elif self._file is not None:
                self._add(self._file, entry)

    def _add(self, file: McapFile, entry: NumberedCycle | LostCycles) -> None:
        """Write a cycle or a loss of cycles, and close the MCAP chunk if that is due."""
        n_bytes_written = file.n_bytes_written
        file.add_entry(entry)
        if isinstance(entry, LostCycles):
            return
        # A chunk was full and is written; the force of this cycle may be in the next one.
        if file.n_bytes_written > n_bytes_written:
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
        if self._file is not None:
            self._file.flush()
            self.n_cycles = self._n_added

    def finish(self) -> None:
        """Write the last MCAP chunk and the index.

        Raises:
            RecordingError: The pipe ended before the header.
        """
        if self._file is None:
            raise RecordingError("the recorder ended before it sent a header")
        self.flush()
        self._file.finish()


def _write_until_eof(writer: RecordingWriter, pipe: int) -> None:
    # A disk may hang for longer than the pipe has room, so a thread of its own empties the pipe.
    batches: queue.Queue[bytes] = queue.Queue(_MAX_WAITING_BATCHES)

    def empty_pipe() -> None:
        for data in read_batches(pipe):
            batches.put(data)
        batches.put(b"")

    threading.Thread(target=empty_pipe, daemon=True).start()
    while True:
        try:
            data = batches.get(timeout=FLUSH_PERIOD_NS * 1e-9)
        except queue.Empty:
            writer.flush()
            continue
        if not data:
            return
        writer.feed(data)


def _remove_partial_suffix(path: Path) -> None:
    """Rename the complete recording from `FILE.partial` to `FILE`.

    Raises:
        RecordingError: FILE exists by now.
    """
    if path.exists():
        raise RecordingError("it appeared in the meantime and is not overwritten")
    path.with_name(path.name + ".partial").rename(path)


def main(path: Path, pipe: int = 0, fd: int = 1, report: int = 2) -> int:
    """Write a recording until the pipe ends; return the exit code.

    Args:
        path: Name of the file once it is complete.
        pipe: Descriptor to read from.
        fd: Descriptor of the open `.partial` file.
        report: Descriptor for the report.

    Returns:
        The exit code: 0 if the recording is complete and has its name.
    """
    drop_realtime()
    writer = RecordingWriter(fd)
    failure = ""
    try:
        _write_until_eof(writer, pipe)
        writer.finish()
        os.fsync(fd)
        _remove_partial_suffix(path)
    except OSError as error:
        failure = error.strerror or str(error)
    except RecordingError as error:
        failure = str(error)
    with contextlib.suppress(BrokenPipeError):  # without a reader if the service was killed
        os.write(report, json.dumps({"n_cycles": writer.n_cycles, "failure": failure}).encode())
    return 1 if failure else 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))
