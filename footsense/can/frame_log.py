"""Log of sent CAN frames: checks of the log file, and the pipe to the child process that writes it.

A busy disk or an absent network drive makes a writer wait, so a process of its own writes the file (`log_writer`), and
the loop copies a cycle's frames into a pipe with one system call. In virtual time the loop waits for room there; in
real time it never does, and frames without room are counted.
"""

import logging
import os
import struct
import subprocess
from pathlib import Path

from firmware_interface.can.socketcan import frame_ends
from footsense.child_process import check_new_file, start_writer
from footsense.errors import ConfigError, RecordingError
from footsense.frames import CanStatistics

_log = logging.getLogger(__name__)

#: Formats of the log: candump, Vector ASCII, Vector binary.
LOG_SUFFIXES = (".log", ".asc", ".blf")

#: Time [ns] and length [bytes] of the frames of one call, before them.
RECORD_HEAD = struct.Struct("<qI")

#: Size of the pipe [bytes], the most that Linux grants a user by default: a minute of forces, or 14 s
#: with `publish_every: 1`.
PIPE_BYTES = 1 << 20

#: Longest wait for the writer after the pipe was closed [s].
FINISH_TIMEOUT_S = 10.0


def check_log_suffix(path: Path) -> None:
    """Raise an error unless the file's suffix names a supported log format.

    Raises:
        ConfigError: It does not.
    """
    if path.suffix not in LOG_SUFFIXES:
        raise ConfigError(f"CAN log {path}: the suffix must be one of {', '.join(LOG_SUFFIXES)}")


def check_log_target(path: Path) -> None:
    """Raise an error unless a log can be written to `path`; call it before opening anything.

    Raises:
        ConfigError: The suffix names no format.
        RecordingError: The file exists, or the directory cannot be written to.
    """
    check_log_suffix(path)
    check_new_file(f"CAN log {path}", path)


class CanFrameLog:
    """Log of sent CAN frames, passed through a pipe to a child process that writes the file.

    Args:
        path: The file, its format by suffix.
        channel: Name of the channel in the log.
        stats: Statistics; counts frames missing in the log.
        waits: Whether a full pipe makes the loop wait (virtual time) or loses the frames (real time).

    Raises:
        RecordingError: The file cannot be opened.
    """

    def __init__(self, path: Path, channel: str, stats: CanStatistics, *, waits: bool) -> None:
        self._path = path
        self._stats = stats
        self._writer, self._pipe = _start_writer(path, channel)
        os.set_blocking(self._pipe, waits)
        self._ended = False

    def add(self, t_ns: int, frames: bytes) -> None:
        """Append frames with their time [ns] to the log; never fails, even if its writer has ended."""
        if not self._ended:
            try:
                # Below PIPE_BUF for any robot: written completely or not at all. Source: pipe(7).
                os.write(self._pipe, RECORD_HEAD.pack(t_ns, len(frames)) + frames)
            except BlockingIOError:
                pass
            except BrokenPipeError:
                self._ended = True
                _log.warning("CAN log %s: its writer has ended; the run goes on without it", self._path)
            else:
                return
        self._stats.unlogged += len(frame_ends(frames))

    def close(self, timeout_s: float = FINISH_TIMEOUT_S) -> None:
        """Close the pipe, and wait until the child process has written all frames.

        Args:
            timeout_s: How long to wait for the writer [s].

        Raises:
            RecordingError: It is incomplete.
        """
        os.close(self._pipe)
        try:
            failure = self._writer.communicate(timeout=timeout_s)[1].decode(errors="replace").strip()
        except subprocess.TimeoutExpired:
            self._writer.kill()
            self._writer.communicate()
            failure = f"the file did not take what was written within {timeout_s:g} s"
        if not failure and self._writer.returncode:
            failure = "its writer was killed"
        if not failure and self._stats.unlogged:
            failure = f"its writer was too slow: {self._stats.unlogged} frames are missing"
        if failure:
            last = failure.rpartition("\n")[2]
            raise RecordingError(f"CAN log {self._path}: {last}; what was sent is not affected")


def _start_writer(path: Path, channel: str) -> "tuple[subprocess.Popen[bytes], int]":
    """Start the child process that writes the log; return it and the write end of its pipe.

    Returns:
        The process, and the end of the pipe that feeds it.

    Raises:
        RecordingError: The file cannot be opened.
    """
    # Exclusive: no file, link or pipe that appeared since the check is written through.
    try:
        file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o644)
    except OSError as error:
        raise RecordingError(f"CAN log {path}: {error.strerror}") from error
    return start_writer("footsense.can.log_writer", [path.suffix, channel], file, PIPE_BYTES)
