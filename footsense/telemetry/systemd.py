"""What the service tells systemd: ready, alive, stopping, and one line of status.

The protocol is one datagram per message to the socket that systemd names in the environment; without that
variable, as in a terminal, nothing is sent. A message that cannot be delivered is dropped: the loop does not
wait for its supervisor.

Source:
    sd_notify(3), sd_watchdog_enabled(3).
"""

import os
import socket
from collections.abc import Mapping

__all__ = ["SystemdNotifier", "watchdog_interval_ns"]


def watchdog_interval_ns(environment: Mapping[str, str] = os.environ) -> int | None:
    """Return how often to call `watchdog`: at half of the time after which systemd would restart the service.

    Returns:
        The interval [ns], or None if systemd watches no watchdog of this process.
    """
    if environment.get("WATCHDOG_PID", str(os.getpid())) != str(os.getpid()):
        return None  # meant for the process that started this one
    timeout_us = environment.get("WATCHDOG_USEC", "")
    if not timeout_us.isdecimal() or int(timeout_us) == 0:
        return None
    return int(timeout_us) * 1000 // 2


class SystemdNotifier:
    """The way to systemd.

    Args:
        environment: Where `NOTIFY_SOCKET` is looked up: a path, or an abstract socket's name behind an `@`.

    Timing:
        One system call a message, some microseconds; never waits.
    """

    def __init__(self, environment: Mapping[str, str] = os.environ) -> None:
        address = environment.get("NOTIFY_SOCKET", "")
        self._socket: socket.socket | None = None
        if address.startswith(("/", "@")):
            # Not connected: after systemd has been re-executed, another socket stands at the same address.
            self._address = "\0" + address[1:] if address.startswith("@") else address
            self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC)
            self._socket.setblocking(False)

    def ready(self, status: str) -> None:
        """Tell that forces are coming, and a line for `systemctl status`."""
        self._send(f"READY=1\nSTATUS={_one_line(status)}")

    def watchdog(self) -> None:
        """Tell that the loop turns."""
        self._send("WATCHDOG=1")

    def status(self, status: str) -> None:
        """Set the line that `systemctl status` shows."""
        self._send(f"STATUS={_one_line(status)}")

    def stopping(self) -> None:
        """Tell that the service ends because it was asked to."""
        self._send("STOPPING=1")

    def close(self) -> None:
        """Release the socket; later messages go nowhere."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _send(self, message: str) -> None:
        if self._socket is not None:
            try:
                self._socket.sendto(message.encode(), self._address)
            except OSError:
                return  # systemd is being re-executed or its queue is full; the next message will do


def _one_line(text: str) -> str:
    """Return a text that cannot end its assignment and begin another."""
    return " ".join(text.split())
