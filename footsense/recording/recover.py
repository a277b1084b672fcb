"""Recordings made in this process: the whole part of one that was cut short, and the last 30 s of a running service."""

import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import closing
from pathlib import Path
from typing import NamedTuple

from footsense.errors import RecordingError
from footsense.recording.mcap_writer import McapFile
from footsense.recording.recorder import check_not_being_written, check_recording_target, partial_path
from footsense.recording.replay import Replay
from footsense.ring.cycle_reader import CycleReader
from footsense.ring.records import LostCycles, NumberedCycle

#: Header entry of a snapshot with the number of its first cycle in its run.
SNAPSHOT_KEY = "snapshot_from_cycle"


class RecoveryResult(NamedTuple):
    """Result of a recovery: number of cycles recovered, and the damage that ended the recording.

    Attributes:
        n_recovered_cycles: Cycles in the new file.
        damage: Error about the lost part; None if only the index was missing.
    """

    n_recovered_cycles: int
    damage: RecordingError | None


def recovered_path(path: Path) -> Path:
    """Return the default path of a recovered recording: without `.partial`, else with `.recovered` inserted.

    Example:
        >>> recovered_path(Path("walk.mcap.partial")).name, recovered_path(Path("walk.mcap")).name
        ('walk.mcap', 'walk.recovered.mcap')
    """
    return path.with_suffix("") if path.suffix == ".partial" else path.with_suffix(f".recovered{path.suffix}")


def recover(path: Path, target: Path, on_bytes_read: Callable[[int], None] | None = None) -> RecoveryResult:
    """Copy the complete cycles of a truncated recording to a new file with an index.

    Args:
        path: The recording that was cut short; not changed.
        target: The file to write.
        on_bytes_read: Receives the number of bytes read so far; None for nobody.

    Returns:
        The number of copied cycles and the damage.

    Raises:
        ConfigError: `target` does not end in .mcap.
        RecordingError: `path` is no recording or is still being written, or `target` cannot be created.
    """
    check_not_being_written(path)
    replay = Replay(path, on_bytes_read)
    # The unfinished form of the target may be the very file that is recovered.
    if target.exists() or partial_path(target) != path:
        check_recording_target(target)
    damages: list[RecordingError] = []

    def entries() -> Iterator[NumberedCycle | LostCycles]:
        try:
            yield from replay.entries()
        except RecordingError as error:
            damages.append(error)

    n_cycles = _write_recording(target, replay.header, entries())
    return RecoveryResult(n_cycles, damages[0] if damages else None)


def write_snapshot(ring: Path | None, target: Path) -> int:
    """Write the last 30 s of a running service to a recording; return the number of its cycles.

    Args:
        ring: The service's ring; None for where it is by default.
        target: The file to write.

    Returns:
        The number of cycles.

    Raises:
        ConfigError: `target` does not end in .mcap.
        RecordingError: `target` exists or cannot be written, or the service has sent nothing yet.
        FootsenseError: No service runs.
    """
    check_recording_target(target)
    with closing(CycleReader(ring)) as reader:
        reader.rewind()
        end = reader.end
        entries = reader.read()
        if not entries:
            raise RecordingError("the service has no cycle yet")
        first = entries[0][0]

        def renumbered() -> Iterator[NumberedCycle | LostCycles]:
            nonlocal entries
            while entries:
                for entry in entries:
                    if isinstance(entry, NumberedCycle):
                        yield NumberedCycle(entry.cycle_number - first, entry.cycle)
                    else:
                        yield entry._replace(next_cycle_number=entry.next_cycle_number - first)
                # Not behind the end at the start: a simulation may be faster than this.
                entries = reader.read() if reader.position < end else []

        return _write_recording(target, {**reader.header, SNAPSHOT_KEY: str(first)}, renumbered())


def _write_recording(
    target: Path, header: Mapping[str, str], entries: Iterable[NumberedCycle | LostCycles]
) -> int:
    """Write a recording whole or not at all; return the number of cycles.

    Raises:
        RecordingError: It cannot be written.
    """
    unfinished = target.with_name(f"{target.name}.unfinished")
    n_cycles = 0
    try:
        fd = os.open(unfinished, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC, 0o644)
        try:
            file = McapFile(fd, header)
            for entry in entries:
                file.add_entry(entry)
                n_cycles += isinstance(entry, NumberedCycle)
            file.finish()
            os.fsync(fd)
        finally:
            os.close(fd)
        unfinished.rename(target)
    except OSError as error:
        unfinished.unlink(missing_ok=True)
        raise RecordingError(f"{target}: cannot be written: {error.strerror}") from None
    except BaseException:
        unfinished.unlink(missing_ok=True)
        raise
    return n_cycles
