import os
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

from footsense.telemetry.systemd import SystemdNotifier, watchdog_ping_interval_ns


@pytest.fixture(params=["path", "abstract"])
def systemd(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[tuple[socket.socket, str]]:
    """A socket that listens as systemd does, and the name that it gives to the service."""
    name = str(tmp_path / "notify") if request.param == "path" else f"@footsense-test-{os.getpid()}"
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    listener.bind(name.replace("@", "\0", 1) if name.startswith("@") else name)
    listener.setblocking(False)
    yield listener, name
    listener.close()


def test_each_message_arrives_as_one_datagram(systemd: tuple[socket.socket, str]) -> None:
    """Ready with a status, alive, a new status, stopping; a line break cannot forge an assignment."""
    listener, name = systemd
    notifier = SystemdNotifier(("lf",), {"NOTIFY_SOCKET": name})
    notifier.send(READY="1", STATUS="six legs\nMAINPID=1")
    notifier.send(WATCHDOG="1")
    notifier.send(STATUS="5 of 6 legs valid")
    notifier.close()
    notifier.send(WATCHDOG="1")
    assert [listener.recv(256) for _ in range(4)] == [
        b"READY=1\nSTATUS=six legs MAINPID=1",
        b"WATCHDOG=1",
        b"STATUS=5 of 6 legs valid",
        b"STOPPING=1",
    ]
    with pytest.raises(BlockingIOError):
        listener.recv(256)


@pytest.mark.parametrize("environment", [{}, {"NOTIFY_SOCKET": ""}, {"NOTIFY_SOCKET": "/nowhere/notify"}])
def test_without_a_listener_nothing_happens(environment: dict[str, str]) -> None:
    """In a terminal, or while systemd is away, the service goes on."""
    notifier = SystemdNotifier(("lf",), environment)
    notifier.send(READY="1")
    notifier.send(WATCHDOG="1")
    notifier.close()


def test_a_full_queue_does_not_stop_the_loop(systemd: tuple[socket.socket, str]) -> None:
    """A systemd that does not read costs messages, not time."""
    _, name = systemd
    notifier = SystemdNotifier(("lf",), {"NOTIFY_SOCKET": name})
    for _ in range(2000):
        notifier.send(WATCHDOG="1")
    notifier.close()


@pytest.mark.parametrize(
    ("environment", "interval_ns"),
    [
        ({}, None),
        ({"WATCHDOG_USEC": "2000000"}, 1_000_000_000),
        ({"WATCHDOG_USEC": "2000000", "WATCHDOG_PID": str(os.getpid())}, 1_000_000_000),
        ({"WATCHDOG_USEC": "2000000", "WATCHDOG_PID": "1"}, None),
        ({"WATCHDOG_USEC": "0"}, None),
        ({"WATCHDOG_USEC": "soon"}, None),
    ],
)
def test_the_watchdog_is_fed_at_half_its_time(environment: dict[str, str], interval_ns: int | None) -> None:
    """Only a watchdog that is meant for this process counts."""
    assert watchdog_ping_interval_ns(environment) == interval_ns
