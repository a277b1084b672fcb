"""What every I2cBus promises, asked of the simulated one and of the Linux one over a fake adapter."""

import errno
import os
from collections.abc import Callable
from pathlib import Path
from typing import cast

import pytest
import smbus2
from smbus2.smbus2 import i2c_rdwr_ioctl_data

from footsense.acquisition import linux_i2c
from footsense.acquisition.linux_i2c import (
    LinuxI2cBus,
    adapter_and_parents,
    kernel_drivers,
    shorten_timeout,
)
from footsense.errors import HardwareError, I2cError, I2cTimeoutError, NackError
from footsense.ports import I2cBus, Transaction
from footsense.sim.chips.chip import SimulatedMux
from footsense.sim.clock import VirtualClock
from footsense.sim.i2c_bus import SimulatedBus

MUX = 0x71


class KernelAdapter:
    """What the kernel does to messages, with one TCA9548A on the wire."""

    def __init__(self, fd: int = 0) -> None:
        self.fd = fd
        self.control = 0
        self.closed = False
        self.fails_with: int | None = None
        self.funcs = smbus2.I2cFunc.I2C
        self.calls: list[list[tuple[int, int, int]]] = []

    def ioctl(self, fd: int, _request: int, data: i2c_rdwr_ioctl_data) -> None:
        assert fd == self.fd
        messages = data.msgs[: data.nmsgs]
        self.calls.append([(message.addr, message.flags, message.len) for message in messages])
        number = self.fails_with or (0 if messages[0].addr == MUX else errno.EREMOTEIO)
        if number:
            raise OSError(number, os.strerror(number))
        for message in messages:
            if message.flags & 1:
                for i in range(message.len):
                    message.buf[i] = self.control
            elif message.len:
                self.control = bytes(message)[-1]

    def close(self) -> None:
        self.closed = True
        os.close(self.fd)


def on_linux(adapter: KernelAdapter) -> LinuxI2cBus:
    return LinuxI2cBus(cast("smbus2.SMBus", adapter), "/dev/i2c-1", adapter.ioctl)


def linux() -> I2cBus:
    return on_linux(KernelAdapter())


def simulated() -> I2cBus:
    return SimulatedBus(VirtualClock(), 400_000, 0, SimulatedMux(MUX), {})


@pytest.mark.parametrize("make", [linux, simulated])
def test_a_written_byte_is_read_back(make: Callable[[], I2cBus]) -> None:
    """A write answers nothing; a write with a read answers what was asked for, each time anew."""
    bus = make()
    assert bus.transfer(Transaction(MUX, b"\x05")) == b""
    assert bus.transfer(Transaction(MUX, b"\x09", 1)) == b"\x09"
    assert bus.transfer(Transaction(MUX, b"\x0a", 1)) == b"\x0a"
    assert bus.transfer(Transaction(MUX, b"\x09", 1)) == b"\x09"


@pytest.mark.parametrize("make", [linux, simulated])
def test_a_transaction_without_a_byte_asks_who_is_there(make: Callable[[], I2cBus]) -> None:
    """It changes nothing at an address that answers; at one that nobody has, any is a NackError, which names it."""
    bus = make()
    bus.transfer(Transaction(MUX, b"\x05"))
    assert bus.transfer(Transaction(MUX, b"")) == b""
    assert bus.transfer(Transaction(MUX, b"", 1)) == b"\x05"
    for nobody in (Transaction(0x20, b""), Transaction(0x20, b"\x00", 2)):
        with pytest.raises(NackError, match="0x20"):
            bus.transfer(nobody)


def test_the_chips_that_the_kernel_holds_are_found(tmp_path: Path) -> None:
    """A chip without a driver is nobody's."""
    (tmp_path / "drivers" / "pca9685").mkdir(parents=True)
    for client in ("1-0040", "1-0050", "11-0041"):
        (tmp_path / "devices" / client).mkdir(parents=True)
    (tmp_path / "devices" / "1-0040" / "driver").symlink_to(tmp_path / "drivers" / "pca9685")
    assert kernel_drivers("/dev/i2c-1", tmp_path / "devices") == {0x40: "pca9685"}


@pytest.mark.parametrize(
    ("number", "kind"),
    [
        (errno.EREMOTEIO, NackError),
        (errno.ENXIO, NackError),
        (errno.ETIMEDOUT, I2cTimeoutError),
        (errno.EAGAIN, I2cTimeoutError),
        (errno.EIO, I2cError),
    ],
)
def test_the_kernel_s_errors_get_names(number: int, kind: type[I2cError]) -> None:
    """What the adapters of different boards say means the same to the scanner."""
    adapter = KernelAdapter()
    adapter.fails_with = number
    with pytest.raises(kind, match="/dev/i2c-1, address 0x71"):
        on_linux(adapter).transfer(Transaction(MUX, b"\x01"))


def test_only_portable_transactions_reach_the_kernel() -> None:
    """One write, or one write and one read of the same address with the read last: what all adapters can do."""
    adapter = KernelAdapter()
    bus = on_linux(adapter)
    bus.transfer(Transaction(MUX, b"\x01"))
    bus.transfer(Transaction(MUX, b"\x01", 1))
    assert adapter.calls == [[(MUX, 0, 1)], [(MUX, 0, 1), (MUX, 1, 1)]]


def test_an_adapter_whose_timeout_cannot_be_shortened_is_named(caplog: pytest.LogCaptureFixture) -> None:
    """It is used all the same; the line says what to expect."""
    shorten_timeout("/dev/null")
    assert "/dev/null: its timeout cannot be shortened" in caplog.text
    assert "stop all legs for 1 s" in caplog.text


def test_behind_a_mux_of_the_kernel_the_outer_adapters_are_found(tmp_path: Path) -> None:
    """Their timeouts count: the child's adapter only hands its messages on."""
    inner = tmp_path / "sys" / "i2c-1" / "i2c-11" / "i2c-12"
    inner.mkdir(parents=True)
    (tmp_path / "i2c-12").symlink_to(inner)
    assert adapter_and_parents("/dev/i2c-12", tmp_path) == ["/dev/i2c-1", "/dev/i2c-11", "/dev/i2c-12"]
    assert adapter_and_parents("/dev/i2c-7", tmp_path) == ["/dev/i2c-7"]


def test_an_adapter_that_is_opened_shortens_the_timeouts_of_those_it_is_behind(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The child of a mux of the kernel waits as long as its parent: a second, and the watchdog ends the service."""
    node, outer, shortened = Node(tmp_path / "i2c-11", monkeypatch), "/dev/i2c-1", list[str]()
    monkeypatch.setattr(linux_i2c, "adapter_and_parents", lambda device: [outer, device])
    monkeypatch.setattr(linux_i2c, "shorten_timeout", shortened.append)
    LinuxI2cBus.open(str(node.path)).close()
    assert shortened == [outer, str(node.path)]


class Node:
    """A device file of an adapter that can be unplugged, and the adapters opened on it."""

    def __init__(self, path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        self.path = path
        self.opened: list[KernelAdapter] = []
        self.funcs = smbus2.I2cFunc.I2C | smbus2.I2cFunc.SMBUS_QUICK
        path.touch()
        monkeypatch.setattr("smbus2.SMBus", self.open)

    def open(self, device: str) -> KernelAdapter:
        self.opened.append(KernelAdapter(os.open(device, os.O_RDWR)))
        self.opened[-1].funcs = self.funcs
        return self.opened[-1]

    def ioctl(self, fd: int, request: int, data: i2c_rdwr_ioctl_data) -> None:
        self.opened[-1].ioctl(fd, request, data)

    def unplug(self) -> None:
        self.path.unlink()
        self.opened[-1].fails_with = errno.EIO


def test_an_unplugged_adapter_is_closed_and_opened_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """Whatever its driver says; until it is back nobody acknowledges, and the journal has one line for each."""
    node = Node(tmp_path / "i2c-1", monkeypatch)
    bus = LinuxI2cBus(cast("smbus2.SMBus", node.open(str(node.path))), str(node.path), node.ioctl)
    bus.transfer(Transaction(MUX, b"\x05"))
    caplog.clear()
    node.unplug()
    for _ in range(3):
        with pytest.raises(NackError, match="i2c-1"):
            bus.transfer(Transaction(MUX, b"\x05"))
    assert node.opened[0].closed
    node.path.touch()
    bus.transfer(Transaction(MUX, b"\x06"))
    assert node.opened[-1].control == 6
    lines = [record.getMessage() for record in caplog.records if "timeout" not in record.getMessage()]
    assert lines == [f"{node.path}: gone; it is opened again when it comes back", f"{node.path}: back"]
    bus.close()


def test_an_adapter_is_locked_against_a_second_process(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two scanners on one bus would publish each other's legs; the second one names the remedy."""
    node = Node(tmp_path / "i2c-1", monkeypatch)
    first = LinuxI2cBus.open(str(node.path))
    with pytest.raises(
        HardwareError, match="another process has locked it, most often the service: systemctl stop"
    ):
        LinuxI2cBus.open(str(node.path))
    assert node.opened[1].closed
    first.close()
    LinuxI2cBus.open(str(node.path)).close()


def test_an_adapter_that_does_smbus_commands_only_is_one_clear_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It would open, and then refuse every transaction as if no chip answered."""
    node = Node(tmp_path / "i2c-1", monkeypatch)
    node.funcs = smbus2.I2cFunc.SMBUS_QUICK | smbus2.I2cFunc.SMBUS_BYTE
    with pytest.raises(HardwareError, match=f"^{node.path}: this adapter does SMBus commands only"):
        LinuxI2cBus.open(str(node.path))
    assert node.opened[0].closed


@pytest.mark.parametrize(
    ("device", "says"),
    [
        ("/dev/i2c-99", "no such I2C adapter; enable it"),
        ("/dev/null", "not an I2C adapter; see `ls /dev/i2c-"),
        ("/dev", "not an I2C adapter; see `ls /dev/i2c-"),
    ],
)
def test_what_is_no_adapter_is_one_clear_line(device: str, says: str) -> None:
    """The message names the device and what to look at, not which system call failed."""
    with pytest.raises(HardwareError, match=f"^{device}: {says}"):
        LinuxI2cBus.open(device)
