"""The process that keeps a metrics exporter running, so that the loop need not look after it.

    python -m footsense.telemetry.exporter_keeper --file FILE --address 127.0.0.1 --port 9108

It is nothing but a parent: it forks the exporter, waits, and forks the next one, at once the first time and with a
growing pause if they die young. A start from the loop itself would hold it for 0.7 to 7 ms, as measured beside two
busy processors: it waits until the child has become another program, and longer if that gives up its priority first.
Of each start it says on standard output `ready PORT PID`, or of the first `refused REASON` or `failed REASON`; it ends
when its standard input does, which happens when the service ends, even if it was killed. So does the exporter by
itself: if the keeper is killed, the metrics go on, unkept.
"""

import argparse
import contextlib
import logging
import os
import select
import signal
import sys
from pathlib import Path

from footsense.child_process import yield_to_the_loop

__all__ = ["main"]

_log = logging.getLogger(__name__)

#: An exporter that lived so long died of something new: its successor comes at once [ms].
_LONG_LIFE_MS = 60_000
#: Pauses before the next start [ms]; the last is kept.
_PAUSES_MS = (0, 1_000, 2_000, 4_000, 8_000, 16_000, 30_000)
#: How long an exporter may take to end with the service [ms].
_FAREWELL_MS = 3_000


def _fork_exporter(file: Path, address: str, port: int) -> tuple[int, int]:
    """Start an exporter; return its process descriptor and the pipe on which it says its word."""
    reader, writer = os.pipe()
    pid = os.fork()
    if pid:
        os.close(writer)
        return os.pidfd_open(pid), reader
    code = 1
    try:
        from footsense.telemetry.exporter import serve

        code = serve(file, address, port, lambda word: _finish_word(writer, f"{word} {os.getpid()}"))
    finally:
        os._exit(code)


def _finish_word(writer: int, word: str) -> None:
    with contextlib.suppress(BrokenPipeError):
        os.write(writer, word.encode())
    os.close(writer)


def _wait(fds: tuple[int, ...], timeout_ms: int | None = None) -> set[int]:
    """Return which descriptors have something to say; standard input only counts when it has ended."""
    poll = select.poll()
    for fd in fds:
        poll.register(fd, select.POLLIN if fd else 0)
    return {fd for fd, _ in poll.poll(timeout_ms)}


def _hear(reader: int) -> str:
    """Return an exporter's word, empty if it or the service ended before."""
    word = b""
    while 0 not in (spoke := _wait((0, reader))) and reader in spoke and (part := os.read(reader, 4096)):
        word += part
    os.close(reader)
    return word.decode(errors="replace")


def _say(line: str) -> None:
    with contextlib.suppress(BrokenPipeError):  # the service reads the first one only
        os.write(1, f"{line}\n".encode())


def _bury(exporter: int) -> str:
    """Take note of the end of an exporter, and return it in words."""
    ended = os.waitid(os.P_PIDFD, exporter, os.WEXITED)
    os.close(exporter)
    assert ended is not None
    return f"{'exit code' if ended.si_code == os.CLD_EXITED else 'signal'} {ended.si_status}"


def _keep(file: Path, address: str, port: int) -> int:
    """Keep an exporter running until standard input ends; return the exit code."""
    n_young = 0
    started = False
    while True:
        exporter, reader = _fork_exporter(file, address, port)
        word, _, rest = _hear(reader).partition(" ")
        if word == "ready":
            started, port = True, int(rest.split()[0])
            _say(f"ready {rest}")
        elif not started:
            _say(f"{word} {rest.rpartition(' ')[0]}")
            _bury(exporter)
            return 1
        if not _wait((0, exporter), _LONG_LIFE_MS):
            n_young = 0
            _wait((0, exporter))
        if 0 in _wait((0,), 0):  # the service has ended, and so does the exporter, or has done so already
            if not _wait((exporter,), _FAREWELL_MS):
                signal.pidfd_send_signal(exporter, signal.SIGKILL)
            _bury(exporter)
            file.unlink(missing_ok=True)
            return 0
        pause_ms = _PAUSES_MS[min(n_young, len(_PAUSES_MS) - 1)]
        n_young += 1
        _log.warning("the metrics exporter ended (%s) and is started again", _bury(exporter))
        _wait((0,), pause_ms)


def main() -> int:
    """Keep an exporter of one file of counters; return the exit code."""
    parser = argparse.ArgumentParser(prog="python -m footsense.telemetry.exporter_keeper")
    parser.add_argument("--file", type=Path, required=True)
    parser.add_argument("--address", default="127.0.0.1")
    parser.add_argument("--port", type=int, default=9108)
    arguments = parser.parse_args()
    logging.basicConfig(format="%(levelname)s: %(message)s")
    yield_to_the_loop(nice=5)
    return _keep(arguments.file, arguments.address, arguments.port)


if __name__ == "__main__":
    sys.exit(main())
