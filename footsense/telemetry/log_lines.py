"""Non-blocking logging: the main loop never waits for a reader of its log.

Standard error is a pipe or a socket to the reader of the log. When the reader hangs, the pipe fills, and a blocking
write would hang the loop. Here a line that finds no room is dropped and counted, and the next line that finds room is
preceded by the count. The kernel's buffer is the queue, and its size the bound.

Standard error is shared with the shell and with the writers' processes, so it is not made non-blocking itself: that
would change it for all of them.
"""

import contextlib
import logging
import os
import select
import socket
import stat
from collections.abc import Callable

from footsense.errors import printable_line

#: Up to this length a pipe takes a line whole or not at all [bytes]. Source: pipe(7), PIPE_BUF.
_PIPE_ATOMIC_WRITE_BYTES = 4096


class NonBlockingLogHandler(logging.Handler):
    """Log handler that writes each record as one text line, and drops it if the output is full.

    Args:
        fd: Descriptor to write to; its mode stays as it is, and it stays open.

    Attributes:
        lost: Dropped lines since start.
    """

    def __init__(self, fd: int) -> None:
        super().__init__()
        self._write, self._release = _nonblocking_writer(fd)
        self._rest = b""
        self._unreported = 0
        self.lost = 0

    def emit(self, record: logging.LogRecord) -> None:
        """Write a record as one text line, without waiting or failing."""
        try:
            line = self.format(record)
        except Exception:  # noqa: BLE001 - a record that does not fit its own format must not end the loop
            line = f"{record.levelname}: {record.msg}"
        data = _encoded_line(line)
        if self._unreported:
            data = (
                _encoded_line(f"WARNING: {self._unreported} lines of the log found no room and are lost")
                + data
            )
        if self._write_without_waiting(data):
            self._unreported = 0
        else:
            self._unreported += 1
            self.lost += 1

    def close(self) -> None:
        """Close the descriptor opened for writing."""
        self._release()
        super().close()

    def _write_without_waiting(self, data: bytes) -> bool:
        """Write the rest of the last line, then `data`; return whether `data` was accepted."""
        try:
            self._rest = self._rest[self._write(self._rest) :] if self._rest else b""
            if self._rest:
                return False
            self._rest = data[self._write(data) :]
        except OSError:  # full, or without a reader
            return False
        return True


def n_lost_log_lines() -> int:
    """Return the number of log lines of this process that were dropped."""
    return sum(sink.lost for sink in logging.getLogger().handlers if isinstance(sink, NonBlockingLogHandler))


def _encoded_line(text: str) -> bytes:
    """Return a text as one printable UTF-8 line of limited length, whoever wrote a part of it."""
    data = printable_line(text).encode()
    return data[: _PIPE_ATOMIC_WRITE_BYTES // 2 - 1] + b"\n"


def _nonblocking_writer(fd: int) -> tuple[Callable[[bytes], int], Callable[[], None]]:
    """Return two functions for a file descriptor: a non-blocking write, and its close."""
    kind = os.fstat(fd).st_mode
    if stat.S_ISSOCK(kind):  # as systemd gives it to a service
        journal = socket.socket(fileno=os.dup(fd))
        return lambda data: journal.send(data, socket.MSG_DONTWAIT | socket.MSG_NOSIGNAL), journal.close
    if stat.S_ISFIFO(kind) or stat.S_ISCHR(kind):
        # Opened once more it is the same pipe or terminal, with a mode of its own.
        with contextlib.suppress(OSError):
            own = os.open(f"/proc/self/fd/{fd}", os.O_WRONLY | os.O_NONBLOCK | os.O_NOCTTY | os.O_CLOEXEC)
            return lambda data: os.write(own, data), lambda: os.close(own)
    room = select.poll()
    room.register(fd, select.POLLOUT)
    return lambda data: os.write(fd, data) if room.poll(0) else 0, lambda: None
