"""A serial port over a pseudo-terminal: bytes come and go, one process has it, and a port that went comes back."""

import os
import pty
import tty
from collections.abc import Iterator
from pathlib import Path

import pytest

from footsense.acquisition.serial_port import SerialLink
from footsense.clock import MonotonicClock
from footsense.errors import HardwareError

S = 1_000_000_000


class Line:
    """A pseudo-terminal under a name that stays, as by-id names do."""

    def __init__(self, name: Path) -> None:
        self.name = name
        self._ends: tuple[int, ...] = ()

    def plug(self) -> int:
        """Connect a new device, and return its own end."""
        self._ends = pty.openpty()
        tty.setraw(self._ends[1])
        self.name.symlink_to(os.ttyname(self._ends[1]))
        return self._ends[0]

    def unplug(self) -> None:
        """Take the device away."""
        for end in self._ends:
            os.close(end)
        self._ends = ()
        self.name.unlink(missing_ok=True)


class HurriedClock(MonotonicClock):
    """Sleeps in no time: it is the later afterwards."""

    def __init__(self) -> None:
        super().__init__()
        self._ahead_ns = 0

    def now_ns(self) -> int:
        return super().now_ns() + self._ahead_ns

    def sleep_until_ns(self, t_ns: int) -> None:
        self._ahead_ns += max(0, t_ns - self.now_ns())


@pytest.fixture
def line(tmp_path: Path) -> Iterator[Line]:
    line = Line(tmp_path / "usb-foot")
    yield line
    line.unplug()


def test_bytes_both_ways_and_nobody_else(line: Line) -> None:
    """Reading never waits; a wait ends with the first byte."""
    device = line.plug()
    clock = HurriedClock()
    link = SerialLink(str(line.name), 921_600, clock)
    assert (link.read(), link.n_opened) == (b"", 1)
    os.write(device, b"\x00\x03\x11\x13\r\n\xff")
    link.wait_for_bytes_until_ns(clock.now_ns() + 60 * S)
    assert link.read() == b"\x00\x03\x11\x13\r\n\xff"
    link.write(b"go\n")
    assert os.read(device, 10) == b"go\n"
    with pytest.raises(HardwareError, match="usb-foot: Resource temporarily unavailable; `ls /dev/serial"):
        SerialLink(str(line.name), 921_600, clock)
    link.close()


def test_what_is_unplugged_is_opened_again_and_said_once(
    line: Line, caplog: pytest.LogCaptureFixture
) -> None:
    """One line when it goes and one when it is back, however long that takes."""
    caplog.set_level("INFO")
    line.plug()
    clock = HurriedClock()
    link = SerialLink(str(line.name), 921_600, clock)
    line.unplug()
    link.wait_for_bytes_until_ns(clock.now_ns() + S)
    assert link.read() == b""
    for _ in range(20):
        link.wait_for_bytes_until_ns(clock.now_ns() + S)
        assert link.read() == b""
    link.write(b"lost")
    device = line.plug()
    while link.n_opened == 1:
        link.wait_for_bytes_until_ns(clock.now_ns() + S)
        link.read()
    os.write(device, b"back")
    assert link.read() == b"back"
    assert [record.message.rpartition("/")[2] for record in caplog.records] == [
        "usb-foot: gone (hung up); it is opened again when it comes back",
        "usb-foot: back",
    ]
    link.close()


@pytest.mark.parametrize("device", ["/dev/serial/by-id/none", "/dev/null"])
def test_what_is_no_serial_port_is_refused(device: str) -> None:
    """With the name, and where to look."""
    with pytest.raises(
        HardwareError, match=f"{device}: .*; `ls /dev/serial/by-id` .* belongs in group dialout$"
    ):
        SerialLink(device, 115_200, MonotonicClock())
