"""Child process that writes a recording from the ring: `python -m footsense.recording.writer FILE RING`.

RING is the number of a descriptor of the ring. Standard output is the open `FILE.partial`, which is renamed to FILE at
the end; without a cycle there is no recording, and the file is removed. Standard input is a pipe that ends when the
service stops or is killed. Standard error gets a line of JSON for what has been read and written, and at last one for
the whole. `footsense.recording.recorder` starts this process with SIGINT and SIGTERM blocked, so that it finishes the
recording in each case.
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
from footsense.recording.recorder import partial_path
from footsense.ring.cycle_reader import CycleReader
from footsense.ring.records import LostCycles

#: Longest time that cycles stay unread [ms].
_READ_PERIOD_MS = 200
#: So much at once comes only from a loop in virtual time, which waits for its recorder [bytes].
_MIN_BATCH_WITHOUT_PAUSE_BYTES = 1 << 17


def _report(report: int, **entries: object) -> None:
    # Without a reader if the service was killed, without room if its loop hangs.
    with contextlib.suppress(BrokenPipeError, BlockingIOError):
        os.write(report, json.dumps(entries).encode() + b"\n")


def _write_until_end(file: McapFile, reader: CycleReader, alive: int, report: int) -> None:
    end = select.poll()
    end.register(alive, 0)  # without events, poll still reports the end of the pipe
    n_read = n_lost = 0
    told: dict[str, int] = {}
    while True:
        # Looked at first: what was written before the end is read after it.
        has_ended = end.poll(0 if n_read >= _MIN_BATCH_WITHOUT_PAUSE_BYTES else _READ_PERIOD_MS)
        start = reader.position
        for entry in reader.read():
            file.add_entry(entry)
            n_lost += entry.n_cycles if isinstance(entry, LostCycles) else 0
        n_read = reader.position - start
        if not n_read:
            if has_ended:
                return
            file.flush()
        state = {"position": reader.position, "n_lost": n_lost, "n_cycles": file.n_cycles}
        if state != told:
            _report(report, **state)
            told = state


def _remove_partial_suffix(path: Path) -> None:
    """Rename the complete recording from `FILE.partial` to `FILE`.

    Raises:
        RecordingError: FILE exists by now.
    """
    if path.exists():
        raise RecordingError("it appeared in the meantime and is not overwritten")
    partial_path(path).rename(path)


def main(path: Path, ring: int, alive: int = 0, fd: int = 1, report: int = 2) -> int:
    """Write a recording until the service ends; return the exit code.

    Args:
        path: Name of the file once it is complete.
        ring: Descriptor of the ring.
        alive: Descriptor of a pipe that ends with the service.
        fd: Descriptor of the open `.partial` file.
        report: Descriptor for the reports.

    Returns:
        The exit code: 0 if the recording is complete and has its name, or has no cycle.
    """
    drop_realtime()
    failure, file = "", None
    os.set_blocking(report, False)
    try:
        reader = CycleReader(fd=ring)
        reader.rewind(first_number=0)
        file = McapFile(fd, reader.header)
        _write_until_end(file, reader, alive, report)
        file.finish()
        os.fsync(fd)
        if file.n_cycles:
            _remove_partial_suffix(path)
    except OSError as error:
        failure = error.strerror or str(error)
    except FootsenseError as error:
        failure = str(error)
    if file is None or not file.n_cycles:  # of a start that was refused, or ended
        partial_path(path).unlink(missing_ok=True)
    os.set_blocking(report, True)
    _report(report, n_cycles=file.n_cycles if file else 0, failure=failure)
    return 1 if failure else 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), int(sys.argv[2])))
