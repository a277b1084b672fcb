"""The recorder's end in the loop's process: it starts the writer's process and copies cycles into its pipe.

An MCAP writer in the loop's process, thread or not, costs the loop milliseconds now and then; a pipe costs
microseconds.
"""

import contextlib
import fcntl
import json
import logging
import os
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from footsense.child_process import start_writer
from footsense.errors import ConfigError, RecordingError
from footsense.frames import Cycle
from footsense.recording.cycle_pipe import CyclePipe

__all__ = ["Recorder", "check_not_being_written", "check_target", "partial_path"]

_log = logging.getLogger(__name__)

SUFFIX = ".mcap"

#: Room in the pipe [bytes], the most that Linux gives a user by default: 512 cycles of six legs, which stand two to a
#: page. These are 12 s of whole scans, or 1.4 s of forces after every conversion; the writer takes them out five times
#: a second, even if its disk stands still.
PIPE_BYTES = 1 << 20

#: Longest wait for the writer to take what is left in the loop's process [s].
DRAIN_TIMEOUT_S = 10.0

#: Longest wait for the writer to finish after the pipe has ended [s].
FINISH_TIMEOUT_S = 30.0


def partial_path(path: Path) -> Path:
    """Return the name that a recording has until it is whole."""
    return path.with_name(path.name + ".partial")


def check_target(path: Path) -> None:
    """Check that a recording may be written to `path`; to be called before anything is started.

    Raises:
        ConfigError: The name does not end in .mcap.
        RecordingError: The file or its unfinished form exists, or the directory cannot be written to.
    """
    if path.suffix != SUFFIX:
        raise ConfigError(f"recording {path}: the name has to end in {SUFFIX}")
    partial = partial_path(path)
    if path.exists():
        raise RecordingError(f"{path}: exists and is not overwritten; choose another name or remove it")
    if partial.exists():
        check_not_being_written(partial)
        raise RecordingError(
            f"{partial}: exists, a recording that was cut short; footsense recover it, or remove it"
        )
    if not path.parent.is_dir():
        raise RecordingError(f"{path}: there is no directory {path.parent}")
    if not os.access(path.parent, os.W_OK | os.X_OK):
        raise RecordingError(f"{path}: the directory {path.parent} cannot be written to")


def check_not_being_written(partial: Path) -> None:
    """Check that an unfinished recording is one that was left, not one that is in the making.

    Raises:
        RecordingError: Its writer, which holds a lock on it, is alive.
    """
    with contextlib.suppress(OSError):  # what cannot be opened is told by whoever needs it
        fd = os.open(partial, os.O_RDONLY | os.O_CLOEXEC)
        try:
            fcntl.flock(fd, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            raise RecordingError(
                f"{partial}: is being written by another footsense; choose another name, or wait for its end"
            ) from None
        finally:
            os.close(fd)


class Recorder:
    """Records every cycle that it observes.

    The writer gives up again what it inherits of a process with real-time scheduling.

    Args:
        path: File to make; it is `FILE.partial` until it is whole.
        legs: Name of each row of the frames.
        header: What the recording is to say of itself.
        blocking: Whether a full pipe makes the loop wait (virtual time) or loses the cycle (real time).

    Raises:
        RecordingError: The file cannot be made.
    """

    def __init__(self, path: Path, legs: Sequence[str], header: Mapping[str, str], *, blocking: bool) -> None:
        check_target(path)
        self._path = path.absolute()
        self._writer, fd = _start_writer(self._path)
        self._pipe = CyclePipe(fd, legs, header, blocking=blocking)
        self._n_written: int | None = None
        self._report = b""
        self._told = False

    @property
    def lost(self) -> int:
        """Return how many cycles are not in the recording as far as is known; final after `close`."""
        return self._pipe.lost if self._n_written is None else self._pipe.n_cycles - self._n_written

    def observe(self, cycle: Cycle) -> None:
        """Copy one cycle into the pipe.

        Timing: microseconds unless `blocking`; never fails, whatever becomes of the writer.
        """
        self._pipe.send(cycle)
        if self._pipe.broken and not self._told:
            self._told = True
            failure = self._hear(self._last_words())["failure"]
            _log.error("%s: %s; the run goes on without its recording", self._path, failure)

    def _last_words(self) -> bytes:
        """Return what the writer has said before it ended, without waiting for it."""
        assert self._writer.stderr is not None
        os.set_blocking(self._writer.stderr.fileno(), False)
        with contextlib.suppress(BlockingIOError):
            self._report = os.read(self._writer.stderr.fileno(), 65_536)
        return self._report

    def _hear(self, report: bytes) -> dict[str, Any]:
        """Return how many cycles the writer has written and what stopped it, if anything."""
        last = report.decode(errors="replace").strip().rpartition("\n")[2]
        try:
            said: dict[str, Any] = json.loads(last)
        except ValueError:
            said = {"n_cycles": 0, "failure": last or "its writer was killed"}
        return said

    def close(self) -> None:
        """End the recording and wait until it is whole.

        Raises:
            RecordingError: It is not whole; what was written is in `FILE.partial`.
        """
        if self._n_written is not None:
            return
        self._n_written = 0
        self._pipe.close(DRAIN_TIMEOUT_S)
        try:
            report = self._writer.communicate(timeout=FINISH_TIMEOUT_S)[1]
        except subprocess.TimeoutExpired:
            raise RecordingError(
                f"{self._path}: not whole yet, its writer goes on; the disk is slow"
            ) from None
        said = self._hear(self._report + report)
        self._n_written = int(said["n_cycles"])
        if said["failure"]:
            raise RecordingError(
                f"{self._path}: {said['failure']}; {self.lost} of {self._pipe.n_cycles} cycles are missing, "
                f"the others are in {partial_path(self._path).name}"
            )


def _start_writer(path: Path) -> tuple[subprocess.Popen[bytes], int]:
    """Start the process that writes `path`.

    Returns:
        The process, and the end of the pipe that feeds it.

    Raises:
        RecordingError: The file cannot be made.
    """
    partial = partial_path(path)
    try:
        file = os.open(partial, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o644)
    except OSError as error:
        raise RecordingError(f"{partial}: cannot be made: {error.strerror}") from None
    with contextlib.suppress(OSError):  # some network drives know no locks; the file is written all the same
        # The writer inherits the lock with the file, and it ends with whoever has the file open last.
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    return start_writer("footsense.recording.writer", [str(path)], file, PIPE_BYTES)
