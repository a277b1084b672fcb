"""Processes beside the main loop: their end with it, their scheduling, and the new files that they write."""

import contextlib
import ctypes
import os
import signal
from pathlib import Path

from footsense.errors import RecordingError

#: prctl(2).
_PR_SET_PDEATHSIG = 1


def check_new_file(name: str, path: Path) -> None:
    """Raise an error unless a new file can be created at `path`; call it before opening anything.

    Args:
        name: Name of the file in error messages.
        path: The file.

    Raises:
        RecordingError: It exists, or its directory cannot be written to.
    """
    if path.exists():
        raise RecordingError(f"{name}: exists and is not overwritten; choose another name or remove it")
    if not path.parent.is_dir():
        raise RecordingError(f"{name}: there is no directory {path.parent}")
    if not os.access(path.parent, os.W_OK | os.X_OK):
        raise RecordingError(f"{name}: the directory {path.parent} cannot be written to")


def end_with_parent() -> None:
    """Ask the kernel to send this process SIGTERM when its parent ends, even if the parent is killed."""
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)


def drop_realtime() -> None:
    """Set this process's scheduling from real-time to ordinary."""
    with contextlib.suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
