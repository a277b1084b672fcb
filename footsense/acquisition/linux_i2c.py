"""I2C adapter of Linux (i2c-dev); the only module that imports smbus2.

Only these transactions are used, because only they work on every adapter: a write, a read, and a write followed by a
read of the same address. What the kernel gets of each is built once and used again, which smbus2 does not.
"""

import ctypes
import errno
import fcntl
import logging
import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import smbus2
from smbus2.smbus2 import I2C_M_RD, I2C_RDWR, i2c_msg, i2c_rdwr_ioctl_data

from footsense.errors import HardwareError, I2cError, I2cTimeoutError, NackError
from footsense.ports import Transaction

_I2C_RETRIES, _I2C_TIMEOUT = 0x0701, 0x0702  # linux/i2c-dev.h
#: Adapter timeout in units of 10 ms. The kernel's default of 1 s would let one stuck leg stop all others for as long.
_TIMEOUT_10MS = 2
#: How often the kernel begins a transaction again that lost arbitration, within the timeout.
_RETRIES = 3

_log = logging.getLogger(__name__)

#: Messages for a device file that cannot be opened; another kind of file does not have the ioctl I2C_FUNCS.
_OPEN_ERROR_TEXTS = {
    errno.ENOENT: "no such I2C adapter; enable it, or see `ls /dev/i2c-*`",
    **dict.fromkeys(
        (errno.EACCES, errno.EPERM), "permission denied; the service's user belongs in group i2c"
    ),
    **dict.fromkeys((errno.ENOTTY, errno.EINVAL, errno.EISDIR), "not an I2C adapter; see `ls /dev/i2c-*`"),
}
#: Errors of a transaction (Documentation/i2c/fault-codes.rst of the kernel).
_ERROR_OF_ERRNO: dict[int | None, tuple[type[I2cError], str]] = {
    errno.EREMOTEIO: (NackError, "no acknowledge"),
    errno.ENXIO: (NackError, "no acknowledge"),
    errno.ETIMEDOUT: (I2cTimeoutError, "timeout, SDA or SCL is held low"),
    # A held SDA looks like another master to an adapter that compares the line with what it sends. A real one does not
    # win four times in a row; if it did, no leg would be found to hold the line.
    errno.EAGAIN: (
        I2cTimeoutError,
        "arbitration lost four times, SDA is held low or another master is on this bus",
    ),
    errno.ENODEV: (NackError, "the adapter is gone"),
}
_ADAPTERS = Path("/sys/bus/i2c/devices")


class LinuxI2cBus:
    """I2C adapter of Linux (i2c-dev): one ioctl per transaction, locked against other processes that also lock it.

    An adapter that was unplugged acknowledges nothing; each transaction tries to open it again. Its old file is closed
    at once: as long as it is open, the kernel keeps the number, and the driver in its disconnect.

    Args:
        adapter: The open adapter.
        device: Its device file.
        ioctl: The system call, of a file's descriptor, a request, and its data.
    """

    def __init__(
        self, adapter: smbus2.SMBus, device: str, ioctl: Callable[[int, int, Any], object] = fcntl.ioctl
    ) -> None:
        self._adapter: smbus2.SMBus | None = adapter
        self._device = device
        self._ioctl = ioctl
        self._requests: dict[Transaction, _Request] = {}

    @classmethod
    def open(cls, device: str) -> "LinuxI2cBus":
        """Open a device file such as /dev/i2c-1, lock it, and shorten the adapter's timeout.

        Raises:
            HardwareError: There is no such adapter, this user may not use it, it does SMBus commands only, or another
                process holds the lock.
        """
        return cls(_open(device), device)

    def transfer(self, transaction: Transaction) -> bytes:
        """Do one I2C transaction, and return the bytes read.

        Raises:
            NackError: No chip acknowledged, or the adapter is gone.
            I2cTimeoutError: A line is stuck.
            I2cError: The transaction failed otherwise.
        """
        request = self._requests.get(transaction)
        if request is None:
            request = self._requests[transaction] = _request(transaction)
        data, answer = request
        adapter = self._adapter or self._reopen()
        try:
            self._ioctl(adapter.fd, I2C_RDWR, data)
        except OSError as error:
            number = errno.ENODEV if os.fstat(adapter.fd).st_nlink == 0 else error.errno
            if number == errno.ENODEV:
                self.close()
                _log.warning("%s: gone; it is opened again when it comes back", self._device)
            kind, why = _ERROR_OF_ERRNO.get(number, (I2cError, error.strerror or str(error)))
            raise kind(f"{self._device}, address {transaction.address:#04x}: {why}") from error
        return answer.raw

    def _reopen(self) -> smbus2.SMBus:
        """Open the adapter again, after it has disappeared.

        Raises:
            NackError: It is still gone.
        """
        try:
            self._adapter = _open(self._device)
        except HardwareError as error:
            raise NackError(str(error)) from error
        _log.warning("%s: back", self._device)
        return self._adapter

    def close(self) -> None:
        """Close the adapter's device file."""
        if self._adapter is not None:
            self._adapter.close()
            self._adapter = None


def _open(device: str) -> smbus2.SMBus:
    """Open an I2C adapter, lock it, and shorten its timeout.

    Raises:
        HardwareError: It is missing, this user may not use it, it does SMBus commands only, or another process holds
            the lock.
    """
    try:
        adapter = smbus2.SMBus(device)
    except OSError as error:
        why = _OPEN_ERROR_TEXTS.get(error.errno or 0, error.strerror)
        raise HardwareError(f"{device}: {why}") from error
    if not adapter.funcs & smbus2.I2cFunc.I2C:
        adapter.close()
        raise HardwareError(
            f"{device}: this adapter does SMBus commands only (no I2C_FUNC_I2C); use one that does plain I2C"
        )
    try:
        fcntl.flock(adapter.fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        adapter.close()
        raise HardwareError(
            f"{device}: another process has locked it, most often the service: systemctl stop footsense"
        ) from None
    for each in adapter_and_parents(device):
        shorten_timeout(each)
    return adapter


def adapter_and_parents(device: str, folder: Path = _ADAPTERS) -> list[str]:
    """Return the device files of an adapter and of the adapters that its mux is behind, the outermost first.

    A transfer through a multiplexer of the kernel waits as long as the adapter does that moves the lines.
    """
    path = (folder / Path(device).resolve().name).resolve()
    return [f"/dev/{part}" for part in path.parts if re.fullmatch(r"i2c-\d+", part)] or [device]


def adapter_names(folder: Path = _ADAPTERS) -> dict[str, str]:
    """Return what every I2C adapter calls itself, by its device file, in the order of their numbers."""
    numbers = sorted(int(path.name.removeprefix("i2c-")) for path in folder.glob("i2c-*"))
    return {f"/dev/i2c-{n}": (folder / f"i2c-{n}" / "name").read_text().strip() for n in numbers}


def kernel_drivers(device: str, folder: Path = _ADAPTERS) -> dict[int, str]:
    """Return the kernel drivers bound to an adapter's chips: I2C address to driver name."""
    number = device.removeprefix("/dev/i2c-")
    held = {}
    for client in folder.glob(f"{number}-*"):
        driver = client / "driver"
        if driver.exists():
            held[int(client.name.partition("-")[2], 16)] = driver.resolve().name
    return held


def shorten_timeout(device: str) -> None:
    """Set an adapter's timeout to 20 ms and its retries to 3; if it refuses, log that and go on."""
    try:
        with Path(device).open("rb", buffering=0) as file:
            fcntl.ioctl(file, _I2C_TIMEOUT, _TIMEOUT_10MS)
            fcntl.ioctl(file, _I2C_RETRIES, _RETRIES)
    except OSError as error:
        _log.warning(
            "%s: its timeout cannot be shortened (%s); a line that is held low may stop all legs for 1 s each time",
            device,
            error.strerror,
        )


#: What the kernel gets of a transaction, and the buffer of the bytes read.
_Request = tuple[i2c_rdwr_ioctl_data, "ctypes.Array[ctypes.c_char]"]


def _request(transaction: Transaction) -> _Request:
    address, write, n_read = transaction
    answer = ctypes.create_string_buffer(n_read)
    # A write without a byte asks for the acknowledge of the address alone.
    messages = [i2c_msg.write(address, write)] if write or not n_read else []
    if n_read:
        messages.append(i2c_msg(addr=address, flags=I2C_M_RD, len=n_read, buf=answer))
    return i2c_rdwr_ioctl_data.create(*messages), answer  # type: ignore[arg-type]  # its stub takes each for several
