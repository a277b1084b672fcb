"""Child processes of the main loop: start a file writer, read its pipe, drop inherited real-time scheduling."""

import contextlib
import ctypes
import fcntl
import os
import select
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

from footsense.errors import RecordingError

#: Longest time that bytes stay in the pipe [ms]. A wake-up at every scan would cost the loop, whose write does the
#: waking. At 370 cycles a second the pipe has room for five times as many.
_READ_PERIOD_MS = 200
_MAX_READ_BYTES = 1 << 18
#: prctl(2).
_PR_SET_PDEATHSIG = 1
#: Processors of this process before the loop takes one of them: those that the unit allows.
_CPUS_AT_START = os.sched_getaffinity(0)
#: So many bytes at once come only from a loop in virtual time, which waits for room [bytes].
_MIN_BATCH_WITHOUT_PAUSE_BYTES = 1 << 17


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


def start_writer(
    module: str, arguments: list[str], output_fd: int, pipe_bytes: int = 0, ring: int | None = None
) -> tuple[subprocess.Popen[bytes], int]:
    """Start a footsense module that writes a file from a pipe; return the process and the pipe's write end.

    Args:
        module: Name of the module.
        arguments: Its command line.
        output_fd: Descriptor of the open file, its standard output; closed here.
        pipe_bytes: Size of the pipe that is its standard input [bytes]; the kernel may grant less.
        ring: Descriptor of a ring, which it inherits; closed here.

    Returns:
        The process, which reports its failure on its standard error, and the writing end of the pipe.
    """
    read_end, write_end = os.pipe()
    with contextlib.suppress(OSError):
        fcntl.fcntl(write_end, fcntl.F_SETPIPE_SZ, pipe_bytes)
    # A blocked signal stays blocked in the child: a Ctrl-C or a stop of the service ends the loop, and then
    # the end of the pipe ends the writer.
    blocked = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGTERM})
    of_loop = os.sched_getaffinity(0)
    try:
        os.sched_setaffinity(0, _CPUS_AT_START)  # the child keeps them
        writer = subprocess.Popen(  # noqa: S603 - our own module
            [sys.executable, "-P", "-m", module, *arguments],
            stdin=read_end,
            stdout=output_fd,
            stderr=subprocess.PIPE,
            pass_fds=() if ring is None else (ring,),
        )
    finally:
        os.sched_setaffinity(0, of_loop)
        signal.pthread_sigmask(signal.SIG_SETMASK, blocked)
        os.close(read_end)
        os.close(output_fd)
        if ring is not None:
            os.close(ring)
    return writer, write_end


def read_batches(pipe: int) -> Iterator[bytes]:
    """Yield the bytes of a pipe in batches, a few times per second, until its end.

    Args:
        pipe: Descriptor of the reading end; made non-blocking.

    Yields:
        The bytes received since the last time.
    """
    end = select.poll()
    end.register(pipe, 0)  # without events, poll still reports the end of the pipe
    os.set_blocking(pipe, False)
    n_read = -1
    while n_read:
        end.poll(0 if n_read >= _MIN_BATCH_WITHOUT_PAUSE_BYTES else _READ_PERIOD_MS)
        try:
            data = os.read(pipe, _MAX_READ_BYTES)
        except BlockingIOError:  # the loop sends nothing
            n_read = -1
            continue
        n_read = len(data)
        if data:
            yield data


def end_with_parent() -> None:
    """Ask the kernel to send this process SIGTERM when its parent ends, even if the parent is killed."""
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)


def drop_realtime() -> None:
    """Set this process's scheduling from real-time to ordinary."""
    with contextlib.suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
