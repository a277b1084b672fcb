"""Log of the CAN frames that a simulation sends; on a robot `candump -l` writes it, in a process of its own."""

import contextlib
import logging
import os
from collections.abc import Sequence
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

from footsense.can.wire import sent_message
from footsense.child_process import check_new_file
from footsense.errors import ConfigError, RecordingError

if TYPE_CHECKING:
    from can.io.generic import FileIOMessageWriter

_log = logging.getLogger(__name__)

#: Formats of the log: candump, Vector ASCII, Vector binary.
_LOG_SUFFIXES = (".log", ".asc", ".blf")


def check_log_target(path: Path, interface: str, channel: str) -> None:
    """Raise an error unless the frames of a channel can be logged to `path`; call it before opening anything.

    Raises:
        ConfigError: The suffix names no format, or a disk could make the loop of a robot wait.
        RecordingError: The file exists, or the directory cannot be written to.
    """
    if interface == "socketcan":
        raise ConfigError(
            f"CAN log {path}: the frames of a simulation alone are logged; try: candump -l {channel}"
        )
    if path.suffix not in _LOG_SUFFIXES:
        raise ConfigError(f"CAN log {path}: the suffix must be one of {', '.join(_LOG_SUFFIXES)}")
    check_new_file(f"CAN log {path}", path)


class CanFrameLog:
    """Log of sent CAN frames, written by python-can. A disk that fails ends the log, and not the run.

    Args:
        path: The file, its format by suffix.
        channel: Name of the channel in the log.

    Raises:
        RecordingError: The file cannot be opened.
    """

    def __init__(self, path: Path, channel: str) -> None:
        self._path = path
        self._error: OSError | None = None
        # Exclusive: no file, link or pipe that appeared since the check is written through.
        try:
            file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o644)
        except OSError as error:
            raise RecordingError(f"CAN log {path}: {error.strerror}") from error
        self._file, self._writer = _open_writer(file, path.suffix, channel)

    def add(self, t_ns: int, frames: Sequence[bytes]) -> None:
        """Append frames with their time [ns]; never fails."""
        if self._error is not None:
            return
        try:
            for frame in frames:
                self._writer.on_message_received(sent_message(frame, t_ns))
        except OSError as error:
            self._error = error
            _log.warning("CAN log %s ends here: %s; the run goes on without it", self._path, error.strerror)

    def close(self) -> None:
        """Finish the file.

        Raises:
            RecordingError: It is incomplete.
        """
        try:
            self._writer.stop()
        except OSError as error:
            self._error = self._error or error
            with contextlib.suppress(OSError):  # its buffer cannot be written
                self._file.close()
        if self._error is not None:
            raise RecordingError(
                f"CAN log {self._path} ended early: {self._error.strerror}; what was sent is not affected"
            )


def _open_writer(file: int, suffix: str, channel: str) -> "tuple[IO[Any], FileIOMessageWriter[Any]]":
    """Return the file of an open descriptor, and python-can's writer for the format of `suffix`."""
    import can

    if suffix == ".blf":
        binary = os.fdopen(file, "wb")
        return binary, can.BLFWriter(binary)
    text = os.fdopen(file, "w", encoding="utf-8")
    return text, can.ASCWriter(text) if suffix == ".asc" else can.CanutilsLogWriter(text, channel=channel)
