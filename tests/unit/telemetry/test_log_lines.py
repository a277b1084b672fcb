"""A log that nobody reads costs lines, not time."""

import logging
import os
import socket
from collections.abc import Callable, Iterator

import pytest

from footsense.telemetry.log_lines import NonBlockingLogHandler


def pipe() -> tuple[int, int]:
    return os.pipe()


def sockets() -> tuple[int, int]:
    reader, writer = socket.socketpair()
    return reader.detach(), writer.detach()


@pytest.fixture(params=[pipe, sockets])
def ends(request: pytest.FixtureRequest) -> Iterator[tuple[int, int]]:
    """Who keeps the log, and standard error, in the two forms that services get."""
    make: Callable[[], tuple[int, int]] = request.param
    reader, writer = make()
    os.set_blocking(reader, False)
    yield reader, writer
    os.close(reader)
    os.close(writer)


def record(text: str) -> logging.LogRecord:
    return logging.LogRecord("test", logging.WARNING, "", 0, text, (), None)


def drained(reader: int) -> list[bytes]:
    data = b""
    while True:
        try:
            data += os.read(reader, 1 << 20)
        except BlockingIOError:
            return data.splitlines()


def test_a_reader_that_stands_still_loses_lines_and_is_told_how_many(ends: tuple[int, int]) -> None:
    """Whole lines arrive, the others are counted, and the first that finds room again says so."""
    reader, writer = ends
    log = NonBlockingLogHandler(writer)
    n_lines = 3000
    for n in range(n_lines):
        log.emit(record(f"{n:04d} {'x' * 200}"))
    assert os.get_blocking(writer)  # whoever shares it finds it as it was
    before = drained(reader)
    assert 0 < log.lost < n_lines
    log.emit(record("later"))
    log.emit(record("last"))
    after = drained(reader)
    assert all(line.startswith(b"%04d x" % n) for n, line in enumerate(before))
    *_, told, later, last = after
    assert told == b"WARNING: %d lines of the log found no room and are lost" % log.lost
    assert (later, last) == (b"later", b"last")
    assert len(before) + len(after) - 3 + log.lost == n_lines
    log.close()


def test_a_reader_that_has_gone_is_no_error() -> None:
    """The service goes on without a log."""
    reader, writer = pipe()
    log = NonBlockingLogHandler(writer)
    os.close(reader)
    log.emit(record("unheard"))
    assert log.lost == 1
    log.close()
    os.close(writer)


def test_a_record_is_one_line_whatever_it_says(ends: tuple[int, int]) -> None:
    """A line break cannot forge a second line, and a record that does not fit its format is still told."""
    reader, writer = ends
    log = NonBlockingLogHandler(writer)
    log.setFormatter(logging.Formatter("%(levelname)s: %(message)s"))
    log.emit(record("a\nERROR: b\x1b[31m"))
    broken = record("leg %d")
    broken.args = ("lf",)
    log.emit(broken)
    assert drained(reader) == [b"WARNING: a ERROR: b\\x1b[31m", b"WARNING: leg %d"]
    log.close()
