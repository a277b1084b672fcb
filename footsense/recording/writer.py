"""The process that turns the loop's pipe into an MCAP file: `python -m footsense.recording.writer FILE`.

Its standard input is the pipe, its standard output the open `FILE.partial`, which it renames to FILE when the
pipe ends, and its standard error one line of JSON with the number of cycles written and what stopped it, if
anything. The pipe ends when the daemon stops or dies; `footsense.recording.recorder` starts this process with
SIGINT and SIGTERM blocked, so that a recording is finished properly in both cases.
"""

import contextlib
import json
import os
import queue
import select
import sys
import threading
from pathlib import Path

from footsense.child_process import drop_realtime
from footsense.errors import RecordingError
from footsense.recording.cycle_records import Loss, Numbered, unpack
from footsense.recording.mcap_writer import McapFile

__all__ = ["FdStream", "PipeWriter", "main"]

#: Longest time that cycles wait in an unfinished chunk [ns].
FLUSH_PERIOD_NS = 400_000_000

#: Longest time that cycles wait in the pipe [ms], which has room for five times as many at 370 Hz.
GATHER_MS = 200

#: Most that is taken out of the pipe at once [bytes].
_READ_BYTES = 1 << 18

#: Pieces that wait while the disk does not take them: 20 s, however many cycles there are in a second.
_WAITING_PIECES = 100

#: So much at once comes only from a loop in virtual time, which waits for room.
_BUSY_BYTES = 1 << 17


class FdStream:
    """A file descriptor that is written to without a buffer, so that a full disk shows at the write.

    Args:
        fd: The descriptor, at the start of an empty file.
    """

    def __init__(self, fd: int) -> None:
        self._fd = fd
        self._n_written = 0

    def write(self, data: bytes) -> int:
        """Write all of `data`.

        Returns:
            Its length.
        """
        rest = memoryview(data)
        while rest:
            n = os.write(self._fd, rest)
            self._n_written += n
            rest = rest[n:]
        return len(data)

    def tell(self) -> int:
        """Return how many bytes were written."""
        return self._n_written

    def flush(self) -> None:
        """Nothing waits here."""


class PipeWriter:
    """Writes what arrives on the pipe.

    Args:
        fd: The open file.

    Attributes:
        n_cycles: Cycles handed to the kernel so far.
    """

    def __init__(self, fd: int) -> None:
        self._stream = FdStream(fd)
        self._buffer = bytearray()
        self._file: McapFile | None = None
        self._n_legs: int | None = None
        self._n_added = 0
        self._t_flushed_ns: int | None = None
        self.n_cycles = 0

    def feed(self, data: bytes) -> None:
        """Take bytes from the pipe, whole records or not."""
        self._buffer += data
        for entry in unpack(self._buffer, self._n_legs):
            if isinstance(entry, dict):
                self._file = McapFile(self._stream, entry)
                self._n_legs = len(entry["legs"].split(","))
            elif self._file is not None and isinstance(entry, Numbered):
                n_written = self._stream.tell()
                self._file.add_cycle(entry)
                if (
                    self._stream.tell() > n_written
                ):  # a chunk was full; this cycle may have its force in the next
                    self.n_cycles = self._n_added
                self._n_added += 1
                self._pace(entry.cycle.forces.t_sent_ns)
            elif self._file is not None and isinstance(entry, Loss):
                self._file.add_loss(entry)

    def _pace(self, t_ns: int) -> None:
        if self._t_flushed_ns is None:
            self._t_flushed_ns = t_ns
        elif t_ns - self._t_flushed_ns >= FLUSH_PERIOD_NS:
            self._t_flushed_ns = t_ns
            self.flush()

    def flush(self) -> None:
        """Hand every whole cycle to the kernel."""
        if self._file is not None:
            self._file.flush()
            self.n_cycles = self._n_added

    def finish(self) -> None:
        """Write what waits and the index.

        Raises:
            RecordingError: The pipe ended before the header came.
        """
        if self._file is None:
            raise RecordingError("the recorder went away before it said what it records")
        self.flush()
        self._file.finish()


def _gather(pipe: int, pieces: queue.Queue[bytes]) -> None:
    """Take what comes out of the pipe, up to its end, which is an empty piece."""
    # Asked for no event, poll still tells the end of the pipe. To be woken for every cycle would be work for
    # the loop, whose write has to do the waking.
    end = select.poll()
    end.register(pipe, 0)
    os.set_blocking(pipe, False)
    n_read = -1
    while n_read:
        end.poll(0 if n_read >= _BUSY_BYTES else GATHER_MS)
        try:
            data = os.read(pipe, _READ_BYTES)
        except BlockingIOError:  # the loop stands still
            n_read = -1
        else:
            n_read = len(data)
            pieces.put(data)


def _write_until_end(writer: PipeWriter, pipe: int) -> None:
    # A disk may stand still for longer than the pipe has room; so a thread of its own empties the pipe.
    pieces: queue.Queue[bytes] = queue.Queue(_WAITING_PIECES)
    threading.Thread(target=_gather, args=(pipe, pieces), daemon=True).start()
    while True:
        try:
            data = pieces.get(timeout=FLUSH_PERIOD_NS * 1e-9)
        except queue.Empty:
            writer.flush()
            continue
        if not data:
            return
        writer.feed(data)


def _give_name(path: Path) -> None:
    """Turn `FILE.partial` into FILE.

    Raises:
        RecordingError: There is such a file by now.
    """
    if path.exists():
        raise RecordingError("it appeared in the meantime and is not overwritten")
    path.with_name(path.name + ".partial").rename(path)


def main(path: Path, pipe: int = 0, fd: int = 1, report: int = 2) -> int:
    """Write a recording until the pipe ends.

    Args:
        path: Name that the file gets when it is whole.
        pipe: Descriptor to read from.
        fd: Descriptor of the open `.partial` file.
        report: Descriptor that gets the last word.

    Returns:
        The exit code: 0 if the recording is whole and has its name.
    """
    drop_realtime()
    writer = PipeWriter(fd)
    failure = ""
    try:
        _write_until_end(writer, pipe)
        writer.finish()
        os.fsync(fd)
        _give_name(path)
    except OSError as error:
        failure = error.strerror or str(error)
    except RecordingError as error:
        failure = str(error)
    with contextlib.suppress(BrokenPipeError):  # nobody listens any more if the daemon was killed
        os.write(report, json.dumps({"n_cycles": writer.n_cycles, "failure": failure}).encode())
    return 1 if failure else 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))
