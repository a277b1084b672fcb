"""Notification of systemd: ready after the first forces, watchdog, stopping, and a status text.

A message is one datagram to the socket that systemd names in the environment; without that variable, as in a terminal,
nothing is sent. A message that cannot be delivered is dropped: the loop does not wait for its supervisor.

Source:
    sd_notify(3), sd_watchdog_enabled(3).
"""

import os
import socket
from collections.abc import Mapping
from contextlib import suppress

from footsense.frames import Cycle, Flag, State
from footsense.ports import Observer

_STATUS_PERIOD_NS = 10_000_000_000


def watchdog_ping_interval_ns(environment: Mapping[str, str] = os.environ) -> int | None:
    """Return the interval of watchdog messages [ns], half of systemd's timeout; None without a watchdog.

    Returns:
        The interval [ns], or None if systemd expects no watchdog messages of this process.
    """
    if environment.get("WATCHDOG_PID", str(os.getpid())) != str(os.getpid()):
        return None  # meant for the process that started this one
    timeout_us = environment.get("WATCHDOG_USEC", "")
    if not timeout_us.isdecimal() or int(timeout_us) == 0:
        return None
    return int(timeout_us) * 1000 // 2


class SystemdNotifier(Observer):
    """Observer that notifies systemd of readiness, watchdog and status; does nothing without systemd.

    Args:
        legs: Name of the leg in each row of the frames.
        environment: Environment with `NOTIFY_SOCKET`: a path, or an abstract socket's name behind an `@`.

    Timing:
        One system call a message, some microseconds; never waits.
    """

    def __init__(self, legs: tuple[str, ...], environment: Mapping[str, str] = os.environ) -> None:
        self._legs = legs
        self._interval_ns = watchdog_ping_interval_ns(environment)
        self._alive_ns: int | None = None
        self._status_ns = 0
        address = environment.get("NOTIFY_SOCKET", "")
        self._socket: socket.socket | None = None
        if address.startswith(("/", "@")):
            # Not connected: after systemd has been re-executed, another socket stands at the same address.
            self._address = "\0" + address[1:] if address.startswith("@") else address
            self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC)
            self._socket.setblocking(False)

    def observe(self, cycle: Cycle) -> None:
        """Notify readiness at the first cycle, and watchdog and status when due."""
        now_ns = cycle.forces.t_sent_ns
        if self._alive_ns is None:
            self.send(READY="1", STATUS=self._status_line(cycle))
            self._alive_ns = self._status_ns = now_ns
        if self._interval_ns is not None and now_ns - self._alive_ns >= self._interval_ns:
            self.send(WATCHDOG="1")
            self._alive_ns = now_ns
        if now_ns - self._status_ns >= _STATUS_PERIOD_NS:
            self.send(STATUS=self._status_line(cycle))
            self._status_ns = now_ns

    def send(self, **assignments: str) -> None:
        """Send assignments such as `READY="1"` as one message; newlines in values become blanks."""
        if self._socket is not None:
            lines = (f"{name}={' '.join(value.split())}" for name, value in assignments.items())
            # Fails while systemd is re-executed or its queue is full; the next message will do.
            with suppress(OSError):
                self._socket.sendto("\n".join(lines).encode(), self._address)

    def close(self) -> None:
        """Notify that the service is stopping; later messages are dropped."""
        self.send(STOPPING="1")
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _status_line(self, cycle: Cycle) -> str:
        """Return the status text: the state of each leg."""
        states = zip(self._legs, cycle.forces.state.tolist(), strict=True)
        status = ", ".join(f"{leg} {State(state).name.lower()}" for leg, state in states)
        degraded = any(flags & Flag.DEGRADED_TIMING for flags in cycle.forces.flags.tolist())
        return f"degraded timing; {status}" if degraded else status
