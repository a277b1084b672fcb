"""Log of the CAN frames that a simulation sends; on a robot `candump -l` writes it, in a process of its own."""

import contextlib
import logging
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

from footsense.child_process import check_new_file
from footsense.errors import ConfigError, RecordingError
from footsense.ports import CanWire

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
        open_wire: Opens the interface.
    """

    def __init__(self, path: Path, channel: str, open_wire: Callable[[], CanWire]) -> None:
        self._path = path
        self._channel = channel
        self._open_wire = open_wire
        self._error: OSError | None = None
        self._untimed: list[bytes] = []  # sent before the first force defined the time
        self._opened: tuple[IO[Any], FileIOMessageWriter[Any]] | None = None

    def connect(self) -> CanWire:
        """Open the interface, and with the first one the file; return it as one whose sent frames are logged.

        Raises:
            CanError: The interface cannot be opened.
            RecordingError: The file cannot.
        """
        wire = self._open_wire()
        if self._opened is None:
            try:
                self._opened = _open_writer(self._path, self._channel)
            except OSError as error:
                wire.close()
                raise RecordingError(f"CAN log {self._path}: {error.strerror}") from error
        return _LoggedWire(wire, self)

    def add(self, t_ns: int, frames: Sequence[bytes]) -> None:
        """Append frames with their time [ns]; never fails."""
        if self._opened is None or self._error is not None:
            return
        if not t_ns:
            self._untimed += frames
            return
        from footsense.wires.python_can import sent_message  # a robot does not load python-can

        frames, self._untimed = [*self._untimed, *frames], []
        try:
            for frame in frames:
                self._opened[1].on_message_received(sent_message(frame, t_ns))
        except OSError as error:
            self._error = error
            _log.warning("CAN log %s ends here: %s; the run goes on without it", self._path, error.strerror)

    def close(self) -> None:
        """Finish the file.

        Raises:
            RecordingError: It is incomplete.
        """
        if self._opened is None:
            return
        file, writer = self._opened
        try:
            writer.stop()
        except OSError as error:
            self._error = self._error or error
            with contextlib.suppress(OSError):  # its buffer cannot be written
                file.close()
        if self._error is not None:
            raise RecordingError(
                f"CAN log {self._path} ended early: {self._error.strerror}; what was sent is not affected"
            )


class _LoggedWire:
    """An interface whose sent frames are logged (a `CanWire`)."""

    def __init__(self, wire: CanWire, log: CanFrameLog) -> None:
        self._wire = wire
        self._log = log
        self.receive = wire.receive
        self.close = wire.close

    def send(self, frames: Sequence[bytes], t_ns: int) -> int:
        taken = self._wire.send(frames, t_ns)
        self._log.add(t_ns, frames[:taken])
        return taken


def _open_writer(path: Path, channel: str) -> "tuple[IO[Any], FileIOMessageWriter[Any]]":
    """Create a log, and return it with python-can's writer for its format."""
    import can

    # Exclusive: no file, link or pipe that appeared since the check is written through.
    file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o644)
    suffix = path.suffix
    if suffix == ".blf":
        binary = os.fdopen(file, "wb")
        return binary, can.BLFWriter(binary)
    text = os.fdopen(file, "w", encoding="utf-8")
    return text, can.ASCWriter(text) if suffix == ".asc" else can.CanutilsLogWriter(text, channel=channel)
