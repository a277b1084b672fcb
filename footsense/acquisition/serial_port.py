"""Serial port of Linux, reopened after it was unplugged; the only module that imports pyserial.

pyserial sets up the line at any bit rate; bytes are read from its descriptor, with one system call instead of the two
or three of its `read`.
"""

import logging
import os
import select
import termios
from contextlib import suppress

import serial

from footsense.errors import HardwareError
from footsense.ports import Clock

#: More than the kernel returns at once.
_MAX_BYTES = 65_536
_FIRST_PAUSE_NS = 100_000_000
_MAX_PAUSE_NS = 2_000_000_000
_POLL_LOST_MASK = select.POLLHUP | select.POLLERR | select.POLLNVAL

_log = logging.getLogger(__name__)


class SerialLink:
    """One serial port, 8N1, opened exclusively for this process.

    A port that was unplugged is opened again by its name, with growing pauses. A name under /dev/serial/by-id stays the
    same device; /dev/ttyACM0 may be another one by then.

    Args:
        device: Its name.
        bits_per_s: Bits per second; without effect on a USB device that is no UART adapter.
        clock: The time to wait in.

    Attributes:
        n_opened: Number of times that it was opened.

    Raises:
        HardwareError: It is missing, is in use, or this user may not use it.
    """

    def __init__(self, device: str, bits_per_s: int, clock: Clock) -> None:
        self.n_opened = 0
        self._device = device
        self._bits_per_s = bits_per_s
        self._clock = clock
        self._poll = select.poll()
        self._port: serial.Serial | None = None
        self._descriptor = -1
        self._retry_at_ns = 0
        self._pause_ns = _FIRST_PAUSE_NS
        self._open()

    def read(self) -> bytes:
        """Return the received bytes without waiting; reopen a lost port once the retry delay has passed."""
        if self._port is None and not self._try_reopen():
            return b""
        try:
            data = os.read(self._descriptor, _MAX_BYTES)
        except BlockingIOError:
            return b""
        except OSError as error:
            self._close_lost_port(error.strerror or "unreadable")
            return b""
        # A quiet line and a lost one both read as no bytes.
        if not data and any(events & _POLL_LOST_MASK for _, events in self._poll.poll(0)):
            self._close_lost_port("hung up")
        return data

    def wait_for_bytes_until_ns(self, t_ns: int) -> None:
        """Wait until bytes have arrived or the port is lost, at most until `t_ns` [ns]."""
        if self._port is None:
            self._clock.sleep_until_ns(min(t_ns, self._retry_at_ns))
            return
        remaining_ns = t_ns - self._clock.now_ns()
        if remaining_ns > 0:
            select.select((self._descriptor,), (), (), remaining_ns * 1e-9)

    def write(self, data: bytes) -> None:
        """Send a few bytes; those that a full or lost port does not accept are dropped."""
        if self._port is None:
            return
        try:
            os.write(self._descriptor, data)
        except BlockingIOError:
            _log.warning("%s: takes no more bytes now; %d are lost", self._device, len(data))
        except OSError as error:
            self._close_lost_port(error.strerror or "not writable")

    def close(self) -> None:
        """Close the port."""
        if self._port is not None:
            self._poll.unregister(self._descriptor)
            self._port.close()
            self._port = None

    def _open(self) -> None:
        """Open the port.

        Raises:
            HardwareError: It cannot be opened.
        """
        try:
            port = serial.Serial(self._device, self._bits_per_s, timeout=0, exclusive=True)
        except (OSError, ValueError, termios.error) as error:
            why = os.strerror(error.errno) if isinstance(error, OSError) and error.errno else str(error)
            raise HardwareError(
                f"{self._device}: {why}; `ls /dev/serial/by-id` lists the ports, no other process may have it open, "
                "and the service's user belongs in group dialout"
            ) from error
        # Without it an FTDI adapter holds bytes back for up to 16 ms (deploy/README.md); others do not support it.
        with suppress(OSError, ValueError):
            port.set_low_latency_mode(True)
        self._port, self._descriptor = port, port.fileno()
        self._poll.register(self._descriptor, 0)
        self.n_opened += 1

    def _try_reopen(self) -> bool:
        """Reopen the port once the retry delay has passed; return whether the port is open."""
        if self._clock.now_ns() < self._retry_at_ns:
            return False
        try:
            self._open()
        except HardwareError:
            self._retry_at_ns = self._clock.now_ns() + self._pause_ns
            self._pause_ns = min(2 * self._pause_ns, _MAX_PAUSE_NS)
            return False
        self._pause_ns = _FIRST_PAUSE_NS
        _log.info("%s: back", self._device)
        return True

    def _close_lost_port(self, why: str) -> None:
        """Close a port that has failed, and log why."""
        self.close()
        self._retry_at_ns = self._clock.now_ns() + self._pause_ns
        _log.warning("%s: gone (%s); it is opened again when it comes back", self._device, why)
