"""The processes beside the loop: how one that writes a file is started, and what each gives up when it begins.

The loop is the only one that may have a processor to itself; what it hands down, its children give back.
"""

import contextlib
import fcntl
import os
import signal
import subprocess
import sys

__all__ = ["start_writer", "yield_to_the_loop"]


def start_writer(
    module: str, arguments: list[str], file: int, pipe_bytes: int
) -> tuple[subprocess.Popen[bytes], int]:
    """Start a module of ours as the process that writes a file from what comes through a pipe.

    Args:
        module: What runs.
        arguments: Its command line.
        file: Descriptor of the open file, its standard output; closed here.
        pipe_bytes: Room in the pipe that is its standard input [bytes]; a smaller one serves too.

    Returns:
        The process, whose last words come on its standard error, and the end of the pipe that feeds it.
    """
    read_end, write_end = os.pipe()
    with contextlib.suppress(OSError):
        fcntl.fcntl(write_end, fcntl.F_SETPIPE_SZ, pipe_bytes)
    # A blocked signal stays blocked in the child: a Ctrl-C or a stop of the service ends the loop, and then
    # the end of the pipe ends the writer.
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


def yield_to_the_loop(nice: int = 0) -> None:
    """Give up what a service with real-time scheduling hands down to its children, as far as that is allowed.

    Args:
        nice: By how much less than others this process may ask for.
    """
    with contextlib.suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
        os.sched_setaffinity(0, range(os.cpu_count() or 1))
        os.nice(nice)
