"""One CAN interface: sends and receives frames through a socket of Linux, and reopens it after a failure.

A frame that the channel does not accept at once is dropped and counted, never sent later: by then there is a newer one.
An interface that goes down is tried again with its socket, and one that disappears is opened again, at growing
intervals, without end. Opening and closing wait for the kernel's lock of all network interfaces (RTNL), for seconds if
another program configures one: a thread does both beside the loop. Nothing else here waits, and once the channel is
open nothing here raises.

How long a frame may stay between the kernel's queue and the wire depends on the interface's settings
(`deploy/80-can0.network`).
"""

import errno
import logging
import threading
from collections.abc import Callable, Collection, Sequence
from functools import partial
from pathlib import Path

from firmware_interface.can.socketcan import is_error, is_standard_data, unpack_frame
from footsense.can.bus_health import BusHealth
from footsense.can.interface import Can
from footsense.errors import CanError
from footsense.frames import CanStatistics
from footsense.ports import CanWire
from footsense.wires.address import error_text
from footsense.wires.socket_wire import open_socket

_log = logging.getLogger(__name__)

#: Shortest and longest time between two attempts to reopen an interface [ns].
_MIN_BACK_OFF_NS = 50_000_000
_MAX_BACK_OFF_NS = 250_000_000

#: Where Linux shows its network interfaces.
NETWORK_DEVICES_FOLDER = Path("/sys/class/net")
#: What the file `type` of a CAN interface holds there. Source: Linux, include/uapi/linux/if_arp.h.
_ARPHRD_CAN = "280\n"


class _OpenAttempt(threading.Thread):
    """One try to close the old socket of an interface and open a new one, in a thread of its own if that may wait.

    Args:
        old: The last socket; None if it is closed.
        connect: Opens the interface.
        in_thread: Whether that may wait, and is therefore done in this thread; otherwise it is done here.

    Attributes:
        wire: The open interface; None as long as it is not open.
        error: Why it is not.
    """

    def __init__(self, old: CanWire | None, connect: Callable[[], CanWire], *, in_thread: bool) -> None:
        super().__init__(name="can", daemon=True)
        self._old, self._connect = old, connect
        self.wire: CanWire | None = None
        self.error = ""
        if in_thread:
            self.start()
        else:
            self.run()

    def run(self) -> None:
        """Close the old socket, and try to open a new one."""
        if self._old is not None:
            self._old.close()
        try:
            self.wire = self._connect()
        except CanError as error:
            self.error = str(error)


class CanChannel:
    """Open CAN interface that sends and receives frames, and reopens itself after a failure.

    Args:
        can: The interface.
        accept: CAN ids that `receive` returns.
        first_frames: First frames; sending them also tests whether the channel is up.
        stats: Statistics of the channel.
        connect: Opens an interface of a simulation, and does not wait; None for a socket of Linux.

    Raises:
        CanError: The channel is missing or down.
    """

    def __init__(
        self,
        can: Can,
        accept: Collection[int],
        first_frames: Sequence[bytes],
        stats: CanStatistics,
        *,
        connect: Callable[[], CanWire] | None = None,
    ) -> None:
        self.stats = stats
        self._accept = frozenset(accept)
        self._explained = partial(error_text, can.address)
        self._connect: Callable[[], CanWire] = connect or partial(open_socket, can.address, self._accept)
        self._name = f"CAN channel {can.channel} ({can.interface})"
        self._health = BusHealth(can.channel, stats)
        self._t_ns = 0
        self._back_off_ns = 0  # 0: the interface is open
        self._due_ns = 0
        self._lost_ns = 0
        self._gone: CanWire | None = None  # lost, and not closed yet
        self._is_real = connect is None
        self._opening: _OpenAttempt | None = None
        wire = self._connect()
        try:
            # Without a listener the queue is full at once, which is no error.
            taken = wire.send(first_frames, 0)
        except OSError as error:
            wire.close()
            raise CanError(self._explained(error)) from error
        self._wire: CanWire | None = wire
        stats.sent += taken
        stats.dropped += len(first_frames) - taken

    def send(self, frames: Sequence[bytes], t_ns: int) -> int:
        """Send frames without waiting, and drop those that do not fit; return the number accepted.

        Args:
            frames: Frames as in `firmware_interface.can.socketcan`.
            t_ns: The present time [ns].
        """
        self._t_ns = t_ns
        n, taken = len(frames), 0
        wire = None if self._back_off_ns and t_ns < self._due_ns else self._wire or self._try_reopen()
        if wire is not None:
            try:
                taken = wire.send(frames, t_ns)
            except OSError as error:
                self._back_off_after_failure(error)
            else:
                if self._back_off_ns:
                    self._back_off_ns = 0
                    self.stats.reopened += 1
                    _log.warning("%s is back after %.1f s", self._name, (t_ns - self._lost_ns) / 1e9)
                if taken < n:
                    self._health.log_queue_full(t_ns)
        self.stats.sent += taken
        self.stats.dropped += n - taken
        return taken

    def receive(self) -> list[tuple[int, bytes]]:
        """Return CAN id and data of each received frame with an accepted id, oldest first; discard the others."""
        if self._wire is None:
            return []
        try:
            frames = self._wire.receive()
        except OSError as error:
            self._back_off_after_failure(error)
            return []
        arrived = []
        for frame in frames:
            can_id, data = unpack_frame(frame)
            if is_error(can_id):
                self._health.count_error_frame(can_id, data, self._t_ns)
            elif is_standard_data(can_id) and can_id in self._accept:
                arrived.append((can_id, data))
        if self._health.last_error_ns is not None or self._health.last_full_ns is not None:
            self._health.check_recovery(self._t_ns)
        return arrived

    def close(self) -> None:
        """Close the CAN socket, if one is open."""
        if self._wire is not None:
            self._wire.close()
            self._wire = None

    def _back_off_after_failure(self, error: OSError) -> None:
        """Double the time until the next attempt to reopen; close the socket unless the interface is only down."""
        if error.errno != errno.ENETDOWN and self._wire is not None:
            self._gone, self._wire = self._wire, None
        if not self._back_off_ns:
            self._lost_ns = self._t_ns
            _log.warning("%s; no frame goes out until it is back", self._explained(error))
        self._back_off_ns = min(max(2 * self._back_off_ns, _MIN_BACK_OFF_NS), _MAX_BACK_OFF_NS)
        self._due_ns = self._t_ns + self._back_off_ns

    def _try_reopen(self) -> CanWire | None:
        """Start an attempt to reopen the interface, or return a finished one's socket; None while there is none."""
        if self._opening is None:
            self._opening = _OpenAttempt(self._gone, self._connect, in_thread=self._is_real)
            self._gone = None
        if self._opening.is_alive():
            return None
        opening, self._opening = self._opening, None
        self._wire = opening.wire
        if self._wire is None:
            self._back_off_after_failure(OSError(None, opening.error))
        return self._wire


def can_interfaces(folder: Path = NETWORK_DEVICES_FOLDER) -> list[str]:
    """Return the names of a computer's CAN interfaces, virtual ones last."""
    names = [path.parent.name for path in folder.glob("*/type") if path.read_text() == _ARPHRD_CAN]
    return sorted(names, key=lambda name: (name.startswith("vcan"), name))
