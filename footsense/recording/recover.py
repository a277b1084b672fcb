"""Recover a truncated recording."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from footsense.errors import RecordingError
from footsense.recording.container.mcap_writer import McapFile
from footsense.recording.cycle_records import NumberedCycle
from footsense.recording.recorder import check_not_being_written, check_recording_target, partial_path
from footsense.recording.replay import Replay


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
    unfinished = target.with_name(target.name + ".recovering")
    if target.exists() or partial_path(target) != path:
        check_recording_target(target)
    n_cycles, damage = 0, None
    try:
        fd = os.open(unfinished, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC, 0o644)
        try:
            file = McapFile(fd, replay.header)
            try:
                for entry in replay.entries():
                    file.add_entry(entry)
                    n_cycles += isinstance(entry, NumberedCycle)
            except RecordingError as error:
                damage = error
            file.finish()
            os.fsync(fd)
        finally:
            os.close(fd)
        unfinished.rename(target)
    except OSError as error:
        unfinished.unlink(missing_ok=True)
        raise RecordingError(f"{target}: cannot be written: {error.strerror}") from None
    return RecoveryResult(n_cycles, damage)
