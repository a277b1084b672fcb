"""A signal ends a command at any moment: its start by an exception, its loop by what it asks."""

import os
import signal
from collections.abc import Iterator

import pytest

from footsense.cli.options import StopRequest


@pytest.fixture
def stop() -> Iterator[StopRequest]:
    handlers = {number: signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGINT)}
    yield StopRequest()
    for number, handler in handlers.items():
        signal.signal(number, handler)


def test_a_start_that_waits_is_ended(stop: StopRequest) -> None:
    """Once: a second signal does not disturb what the first one closes."""
    with pytest.raises(SystemExit) as ended:
        os.kill(os.getpid(), signal.SIGTERM)
    assert not ended.value.code
    os.kill(os.getpid(), signal.SIGTERM)
    assert stop.requested


def test_a_loop_ends_where_it_asks(stop: StopRequest) -> None:
    assert not stop.requested
    os.kill(os.getpid(), signal.SIGINT)
    assert stop.requested
