"""Recorder in the main loop's process: starts the child process that writes the file from the ring.

An MCAP writer in the loop's process, in a thread or not, costs the loop milliseconds now and then; so the loop writes
its cycles into the ring, and knows of the recorder what it reports.
"""

import contextlib
import fcntl
import json
import logging
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

from footsense.child_process import check_new_file
from footsense.errors import ConfigError, RecordingError
from footsense.regular_file import open_regular
from footsense.ring.cycle_ring import CycleRing

_log = logging.getLogger(__name__)

RECORDING_SUFFIX = ".mcap"

#: Longest wait for the writer after the end of the service [s].
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
            f"{partial}: exists, a recording that was cut short, and can be read as it is; rename or remove it"
        )
    check_new_file(str(path), path)


def check_not_being_written(partial: Path) -> None:
    """Raise an error if another process is still writing an unfinished recording.

    Raises:
        RecordingError: Its writer, which holds a lock on it, runs.
    """
    with contextlib.suppress(OSError):  # a file that cannot be opened is reported where it is needed
        fd = open_regular(partial)
        try:
            fcntl.flock(fd, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            raise RecordingError(
                f"{partial}: is being written by another footsense; choose another name, or wait for its end"
            ) from None
        finally:
            os.close(fd)


class Recorder:
    """Recorder of a ring's cycles to an MCAP file, in a child process.

    Args:
        path: File to write; `FILE.partial` until it is complete.
        ring: The ring.
        waits: Whether the loop waits before it overwrites what is not recorded yet (virtual time) or loses it.

    Raises:
        RecordingError: The file cannot be created.
    """

    def __init__(self, path: Path, ring: CycleRing, *, waits: bool) -> None:
        check_recording_target(path)
        self._path = path.absolute()
        self._ring = ring
        self._writer = _start_writer(self._path, ring.open_for_reading())
        assert self._writer.stderr is not None
        self._reports = self._writer.stderr.fileno()
        self._rest = b""
        self._words = "its writer was killed"
        self._has_ended = False
        self._last: dict[str, Any] = {"position": 0, "n_lost": 0, "n_cycles": 0}
        if waits:
            ring.before_overwriting = self._wait_until_read

    @property
    def n_lost_cycles(self) -> int:
        """Number of cycles known to be missing in the recording; final after `close`."""
        if not self._has_ended:
            self._read_reports(blocking=False)
        return int(self._ring.n_cycles - self._last["n_cycles"] if self._has_ended else self._last["n_lost"])

    def _wait_until_read(self, position: int) -> None:
        """Wait until the recorder has read the ring up to a position [bytes], or has ended."""
        while not self._has_ended and self._last["position"] < position:
            self._read_reports(blocking=True)

    def _read_reports(self, *, blocking: bool) -> None:
        """Read the reports of the child process; log why it has ended before the service."""
        os.set_blocking(self._reports, blocking)
        with contextlib.suppress(BlockingIOError):
            data = os.read(self._reports, 65_536)
            self._take(data)
            if not data or "failure" in self._last:
                self._has_ended = True
                _log.error("%s: %s; the run goes on without its recording", self._path, self._failure)

    def _take(self, data: bytes) -> None:
        """Take the newest complete report of those in some bytes."""
        *lines, self._rest = (self._rest + data).split(b"\n")
        for line in lines:
            try:
                self._last |= json.loads(line)
            except ValueError:  # of an interpreter that fails
                self._words = line.decode(errors="replace").strip() or self._words

    @property
    def _failure(self) -> str:
        return str(self._last.get("failure", self._words))

    def close(self) -> None:
        """End the recording after the last cycle, and wait until its file is complete.

        Raises:
            RecordingError: It is incomplete; what was written is in `FILE.partial`.
        """
        assert self._writer.stdin is not None
        if self._writer.stdin.closed:
            return
        try:
            # Closes the writer's standard input, which ends it.
            self._take(self._writer.communicate(timeout=FINISH_TIMEOUT_S)[1] + b"\n")
        except subprocess.TimeoutExpired:
            raise RecordingError(
                f"{self._path}: not whole yet, its writer goes on; the disk is slow"
            ) from None
        self._has_ended = True
        if failure := self._failure:
            raise RecordingError(
                f"{self._path}: {failure}; {self.n_lost_cycles} of {self._ring.n_cycles} cycles are missing"
                + (f", the others are in {partial_path(self._path).name}" if self._last["n_cycles"] else "")
            )


def _start_writer(path: Path, ring: int) -> subprocess.Popen[bytes]:
    """Start the child process that writes `path` from a ring until its standard input ends, and return it.

    Raises:
        RecordingError: The file cannot be created.
    """
    partial = partial_path(path)
    try:
        file = os.open(partial, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o644)
    except OSError as error:
        os.close(ring)
        raise RecordingError(f"{partial}: cannot be made: {error.strerror}") from None
    with contextlib.suppress(OSError):  # network drives without locks are written to all the same
        # The writer inherits the lock with the file; the lock ends when the last process closes the file.
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    # A blocked signal stays blocked in the child: a Ctrl-C or a stop of the service ends the loop, and then
    # the end of the pipe ends the writer.
    blocked = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGTERM})
    try:
        return subprocess.Popen(  # noqa: S603 - our own module
            [sys.executable, "-P", "-m", "footsense.recording.writer", str(path), str(ring)],
            stdin=subprocess.PIPE,
            stdout=file,
            stderr=subprocess.PIPE,
            pass_fds=(ring,),
        )
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, blocked)
        os.close(file)
        os.close(ring)
