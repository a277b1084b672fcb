"""Child processes of the loop: start a writer, and drop the real-time scheduling that a child inherits."""

import contextlib
import fcntl
import os
import signal
import subprocess
import sys

__all__ = ["drop_realtime", "start_writer"]


def start_writer(
    module: str, arguments: list[str], file: int, pipe_bytes: int
) -> tuple[subprocess.Popen[bytes], int]:
    """Start a module as the process that writes a file from what it reads from a pipe.

    Args:
        module: The module.
        arguments: Its arguments.
        file: Descriptor of the open file, its standard output; closed here.
        pipe_bytes: Capacity to request for the pipe on its standard input [bytes]; a refusal is ignored.

    Returns:
        The process, which reports a failure on its standard error, and the write end of the pipe.
    """
    read_end, write_end = os.pipe()
    with contextlib.suppress(OSError):
        fcntl.fcntl(write_end, fcntl.F_SETPIPE_SZ, pipe_bytes)
    # A signal stays blocked in the child: Ctrl-C or a stop of the service ends the loop, and the end of the pipe then
    # ends the writer.
    blocked = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGTERM})
    try:
        writer = subprocess.Popen(  # noqa: S603 - our own module
            [sys.executable, "-P", "-m", module, *arguments],
            stdin=read_end,
            stdout=file,
            stderr=subprocess.PIPE,
        )
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, blocked)
        os.close(read_end)
        os.close(file)
    return writer, write_end


def drop_realtime(nice: int = 0) -> None:
    """Drop the real-time scheduling and the affinity that a child inherits, as far as that is allowed.

    Args:
        nice: Increment of the niceness.
    """
    with contextlib.suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
        os.sched_setaffinity(0, range(os.cpu_count() or 1))
        os.nice(nice)
