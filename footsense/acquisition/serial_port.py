"""A serial port behind the SerialPort port; the only file that knows pyserial.

pyserial finds the way to set up a line, whatever its baud rate; its `read` costs two or three system calls, where one
on the descriptor that it opened says the same.
"""

import logging
import os
import select
import termios
from contextlib import suppress

import serial

from footsense.errors import HardwareError
from footsense.ports import Clock

__all__ = ["SerialLink"]

#: More than the kernel hands over at once.
_MOST_BYTES = 65_536
_FIRST_PAUSE_NS = 100_000_000
_LONGEST_PAUSE_NS = 2_000_000_000
_GONE = select.POLLHUP | select.POLLERR | select.POLLNVAL

_log = logging.getLogger(__name__)


class SerialLink:
    """One serial port, 8N1, opened for this process alone.

    What is unplugged is looked for again at its name, with growing pauses: a name under /dev/serial/by-id stays, while
    /dev/ttyACM0 may be another device by then.

    Args:
        device: Its name.
        baud: Bits per second; of no effect on a USB device that is no adapter.
        clock: The time to wait in.

    Attributes:
        opened: How often it has been opened.

    Raises:
        HardwareError: It is not there, is in use, or this user may not use it.
    """

    def __init__(self, device: str, baud: int, clock: Clock) -> None:
        self.opened = 0
        self._device = device
        self._baud = baud
        self._clock = clock
        self._poll = select.poll()
        self._port: serial.Serial | None = None
        self._descriptor = -1
        self._retry_at_ns = 0
        self._pause_ns = _FIRST_PAUSE_NS
        self._open()

    def read(self) -> bytes:
        """Return what has arrived; never waits, and opens again what had gone."""
        if self._port is None and not self._reopened():
            return b""
        try:
            data = os.read(self._descriptor, _MOST_BYTES)
        except BlockingIOError:
            return b""
        except OSError as error:
            self._lose(error.strerror or "unreadable")
            return b""
        # A line that is quiet and one that has gone both read as nothing.
        if not data and any(events & _GONE for _, events in self._poll.poll(0)):
            self._lose("hung up")
        return data

    def wait_until_ns(self, t_ns: int) -> None:
        """Return when something has arrived or the line has gone, at `t_ns` at the latest."""
        if self._port is None:
            self._clock.sleep_until_ns(min(t_ns, self._retry_at_ns))
            return
        remaining_ns = t_ns - self._clock.now_ns()
        if remaining_ns > 0:
            select.select((self._descriptor,), (), (), remaining_ns * 1e-9)

    def write(self, data: bytes) -> None:
        """Send a few bytes; those that a line that has gone does not take are lost."""
        if self._port is None:
            return
        try:
            os.write(self._descriptor, data)
        except BlockingIOError:
            _log.warning("%s: takes no more bytes now; %d are lost", self._device, len(data))
        except OSError as error:
            self._lose(error.strerror or "not writable")

    def close(self) -> None:
        """Release the line."""
        if self._port is not None:
            self._poll.unregister(self._descriptor)
            self._port.close()
            self._port = None

    def _open(self) -> None:
        try:
            port = serial.Serial(self._device, self._baud, timeout=0, exclusive=True)
        except (OSError, ValueError, termios.error) as error:
            why = os.strerror(error.errno) if isinstance(error, OSError) and error.errno else str(error)
            raise HardwareError(
                f"{self._device}: {why}; `ls /dev/serial/by-id` shows what is there, nobody else may have it open, "
                "and the service's user belongs in group dialout"
            ) from error
        # Else an FTDI adapter keeps what it has for up to 16 ms (deploy/README.md); others know no such thing.
        with suppress(OSError, ValueError):
            port.set_low_latency_mode(True)
        self._port, self._descriptor = port, port.fileno()
        self._poll.register(self._descriptor, 0)
        self.opened += 1

    def _reopened(self) -> bool:
        """Try again when it is time, and tell whether the port is open."""
        if self._clock.now_ns() < self._retry_at_ns:
            return False
        try:
            self._open()
        except HardwareError:
            self._retry_at_ns = self._clock.now_ns() + self._pause_ns
            self._pause_ns = min(2 * self._pause_ns, _LONGEST_PAUSE_NS)
            return False
        self._pause_ns = _FIRST_PAUSE_NS
        _log.info("%s: there again", self._device)
        return True

    def _lose(self, why: str) -> None:
        self.close()
        self._retry_at_ns = self._clock.now_ns() + self._pause_ns
        _log.warning("%s: gone (%s); it is opened again when it comes back", self._device, why)
