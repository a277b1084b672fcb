"""Recorder in the main loop's process: starts the child process that writes the file, and sends it the cycles.

An MCAP writer in the loop's process, in a thread or not, costs the loop milliseconds now and then; a pipe costs
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

from footsense.child_process import check_new_file, start_writer
from footsense.errors import ConfigError, RecordingError
from footsense.recording.cycle_pipe import CyclePipe

_log = logging.getLogger(__name__)

RECORDING_SUFFIX = ".mcap"

#: Size of the pipe [bytes], the most that Linux grants a user by default: 512 cycles of six legs, two to a page. These
#: are 1.4 s; the writer empties it five times a second, even while its disk hangs.
PIPE_BYTES = 1 << 20

#: Longest wait for the writer to read the rest [s].
DRAIN_TIMEOUT_S = 10.0

#: Longest wait for the writer to finish after the pipe was closed [s].
FINISH_TIMEOUT_S = 30.0


def partial_path(path: Path) -> Path:
    """Return the path of a recording while it is being written: the final path with `.partial` appended."""
    return path.with_name(path.name + ".partial")


def check_recording_target(path: Path) -> None:
    """Raise an error unless a recording can be written to `path`; starts nothing.

    Raises:
        ConfigError: The name does not end in .mcap.
        RecordingError: The file or its unfinished form exists, or the directory cannot be written to.
    """
    if path.suffix != RECORDING_SUFFIX:
        raise ConfigError(f"recording {path}: the name has to end in {RECORDING_SUFFIX}")
    partial = partial_path(path)
    if partial.exists() and not path.exists():
        check_not_being_written(partial)
        raise RecordingError(
            f"{partial}: exists, a recording that was cut short; footsense recover it, or remove it"
        )
    check_new_file(str(path), path)


def check_not_being_written(partial: Path) -> None:
    """Raise an error if another process is still writing an unfinished recording.

    Raises:
        RecordingError: Its writer, which holds a lock on it, runs.
    """
    with contextlib.suppress(OSError):  # a file that cannot be opened is reported where it is needed
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
    """Observer that records every cycle to an MCAP file, through a child process.

    The writer's process gives up the real-time scheduling that it inherits.

    Args:
        path: File to write; `FILE.partial` until it is complete.
        legs: Name of the leg in each row of the frames.
        header: Entries of the recording's header, of feet without nine elements with their number.
        blocking: Whether a full pipe makes the loop wait (virtual time) or loses the cycle (real time).

    Attributes:
        observe: Copies one cycle into the pipe: microseconds unless `blocking`; never fails, even without a writer.

    Raises:
        RecordingError: The file cannot be created.
    """

    def __init__(self, path: Path, legs: Sequence[str], header: Mapping[str, str], *, blocking: bool) -> None:
        check_recording_target(path)
        self._path = path.absolute()
        self._writer, fd = _start_writer(self._path)
        header = {**header, "legs": ",".join(legs)}
        self._pipe = CyclePipe(fd, header, blocking=blocking, on_broken=self._log_failure)
        self._n_cycles_written: int | None = None
        self._report = b""
        self.observe = self._pipe.send  # the loop calls it every cycle

    @property
    def n_lost_cycles(self) -> int:
        """Number of cycles known to be missing in the recording; final after `close`."""
        return (
            self._pipe.lost
            if self._n_cycles_written is None
            else self._pipe.n_cycles - self._n_cycles_written
        )

    def _log_failure(self) -> None:
        """Log why the child process has ended, from its error report."""
        assert self._writer.stderr is not None
        os.set_blocking(self._writer.stderr.fileno(), False)
        with contextlib.suppress(BlockingIOError):
            self._report = os.read(self._writer.stderr.fileno(), 65_536)
        failure = _parse_report(self._report)["failure"]
        _log.error("%s: %s; the run goes on without its recording", self._path, failure)

    def close(self) -> None:
        """End the recording, and wait until its file is complete.

        Raises:
            RecordingError: It is incomplete; what was written is in `FILE.partial`.
        """
        if self._n_cycles_written is not None:
            return
        self._n_cycles_written = 0
        self._pipe.close(DRAIN_TIMEOUT_S)
        try:
            report = self._writer.communicate(timeout=FINISH_TIMEOUT_S)[1]
        except subprocess.TimeoutExpired:
            raise RecordingError(
                f"{self._path}: not whole yet, its writer goes on; the disk is slow"
            ) from None
        parsed = _parse_report(self._report + report)
        self._n_cycles_written = int(parsed["n_cycles"])
        if parsed["failure"]:
            raise RecordingError(
                f"{self._path}: {parsed['failure']}; {self.n_lost_cycles} of {self._pipe.n_cycles} cycles are missing, "
                f"the others are in {partial_path(self._path).name}"
            )


def _parse_report(report: bytes) -> dict[str, Any]:
    """Return the child process's report: number of cycles written, and the error that ended it, if any."""
    last = report.decode(errors="replace").strip().rpartition("\n")[2]
    try:
        parsed: dict[str, Any] = json.loads(last)
    except ValueError:
        parsed = {"n_cycles": 0, "failure": last or "its writer was killed"}
    return parsed


def _start_writer(path: Path) -> tuple[subprocess.Popen[bytes], int]:
    """Start the child process that writes `path`; return it and the write end of its pipe.

    Returns:
        The process, and the end of the pipe that feeds it.

    Raises:
        RecordingError: The file cannot be created.
    """
    partial = partial_path(path)
    try:
        file = os.open(partial, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o644)
    except OSError as error:
        raise RecordingError(f"{partial}: cannot be made: {error.strerror}") from None
    with contextlib.suppress(OSError):  # network drives without locks are written to all the same
        # The writer inherits the lock with the file; the lock ends when the last process closes the file.
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    return start_writer("footsense.recording.writer", [str(path)], file, PIPE_BYTES)
