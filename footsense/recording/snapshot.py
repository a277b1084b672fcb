"""Recording of the last 30 s of a running service, from its ring."""

import os
from pathlib import Path

from footsense.errors import RecordingError
from footsense.recording.mcap_writer import McapFile
from footsense.recording.recorder import check_recording_target
from footsense.ring.cycle_reader import CycleReader

#: Header entry of a snapshot with the number of its first cycle in its run.
SNAPSHOT_KEY = "snapshot_from_cycle"


def write_snapshot(reader: CycleReader, target: Path) -> int:
    """Write what a ring holds, 30 s or more, to a recording, or nothing; return the number of cycles.

    Args:
        reader: Reader of the ring, which goes on behind these cycles.
        target: The file to write.

    Raises:
        ConfigError: `target` does not end in .mcap.
        RecordingError: `target` exists or cannot be written, or the service has sent nothing yet.
        FootsenseError: The ring is damaged.
    """
    check_recording_target(target)
    unfinished = target.with_name(f"{target.name}.unfinished")
    reader.rewind()
    end, entries = reader.end, reader.read()
    if not entries:
        raise RecordingError("the service has no cycle yet")
    first = entries[0][0]
    try:
        unfinished.unlink(missing_ok=True)  # of a snapshot that was killed
        with unfinished.open("xb", buffering=0) as file:
            recording = McapFile(file.fileno(), {**reader.header, SNAPSHOT_KEY: str(first)}, first)
            while entries:
                for entry in entries:
                    recording.add_entry(entry)
                # Not behind the end at the start: a simulation may be faster than this.
                entries = reader.read() if reader.position < end else []
            recording.finish()
            os.fsync(file.fileno())
        unfinished.rename(target)
    except OSError as error:
        raise RecordingError(f"{target}: cannot be written: {error.strerror}") from None
    finally:
        unfinished.unlink(missing_ok=True)
    return recording.n_cycles
