"""The file that keeps what was sent on CAN: whether it may be made, and in which format."""

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

from footsense.errors import ConfigError, RecordingError

if TYPE_CHECKING:
    from can.io.generic import FileIOMessageWriter

__all__ = ["LOG_SUFFIXES", "check_log_suffix", "check_log_target", "open_log"]

#: Formats of the log: candump, Vector ASCII, Vector binary.
LOG_SUFFIXES = (".log", ".asc", ".blf")


def check_log_suffix(path: Path) -> None:
    """Check that the suffix names a format.

    Raises:
        ConfigError: It does not.
    """
    if path.suffix not in LOG_SUFFIXES:
        raise ConfigError(f"CAN log {path}: the suffix must be one of {', '.join(LOG_SUFFIXES)}")


def check_log_target(path: Path) -> None:
    """Check that a log may be written to `path`; to be called before anything is opened.

    Raises:
        ConfigError: The suffix names no format.
        RecordingError: The file exists, or the directory cannot be written to.
    """
    check_log_suffix(path)
    if path.exists():
        raise RecordingError(
            f"CAN log {path}: exists and is not overwritten; choose another name or remove it"
        )
    if not path.parent.is_dir():
        raise RecordingError(f"CAN log {path}: there is no directory {path.parent}")
    if not os.access(path.parent, os.W_OK | os.X_OK):
        raise RecordingError(f"CAN log {path}: the directory {path.parent} cannot be written to")


def open_log(path: Path, channel: str) -> "FileIOMessageWriter[Any]":
    """Return a writer of the format that the suffix names.

    Raises:
        RecordingError: The file cannot be written.
    """
    import can

    try:
        match path.suffix:
            case ".log":
                return can.CanutilsLogWriter(path, channel=channel)
            case ".asc":
                return can.ASCWriter(path)
            case _:
                return can.BLFWriter(path)
    except OSError as error:
        raise RecordingError(f"CAN log {path}: {error.strerror}") from error
