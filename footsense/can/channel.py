"""One CAN interface: sends and receives frames, reopens the interface after a failure, logs sent frames.

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

from firmware_interface.can.socketcan import (
    CONTROLLER_PASSIVE,
    ErrorClass,
    is_error,
    is_standard_data,
    unpack_frame,
)
from footsense.can.frame_log import CanFrameLog
from footsense.can.wire import Can, error_text, open_wire
from footsense.errors import CanError
from footsense.frames import CanStatistics
from footsense.ports import CanWire

_log = logging.getLogger(__name__)

#: Shortest and longest time between two attempts to reopen an interface [ns].
_MIN_BACK_OFF_NS = 50_000_000
_MAX_BACK_OFF_NS = 250_000_000
#: Without an error frame, or a full queue, for so long, a bus counts as healthy again [ns].
_RECOVERED_AFTER_NS = 2_000_000_000


class BusHealth:
    """Counts CAN error frames and full transmit queues, and logs the start and end of each disturbance.

    A broken bus is bus-off ten times a second, and a slow one fills its queue with every force; one line tells the
    begin and one the end.

    Args:
        channel: Name of the channel, for the journal.
        stats: Statistics; counts error frames.

    Attributes:
        last_error_ns: Time of the last error frame of a disturbance that was logged [ns]; None: healthy.
        last_full_ns: Time of the last frame for which there was no room [ns]; None: there was room.
    """

    def __init__(self, channel: str, stats: CanStatistics) -> None:
        self._channel = channel
        self._stats = stats
        self._bus_off_logged = False
        self._first_bus_off = 0
        self._first_dropped = 0
        self.last_error_ns: int | None = None
        self.last_full_ns: int | None = None

    def log_queue_full(self, t_ns: int) -> None:
        """Log once that the transmit queue is full; call it before the dropped frames are counted."""
        if self.last_full_ns is None:
            self._first_dropped = self._stats.dropped
            _log.warning(
                "CAN %s: its queue is full, frames are dropped: nobody acknowledges, other nodes load the bus, or "
                "there are more forces than it carries (publish_every)",
                self._channel,
            )
        self.last_full_ns = t_ns

    def count_error_frame(self, can_id: int, data: bytes, t_ns: int) -> None:
        """Count one error frame received at a time [ns], and log a new disturbance."""
        stats = self._stats
        stats.bus_errors += 1
        bus_off = bool(can_id & ErrorClass.BUS_OFF)
        passive = bool(can_id & ErrorClass.CONTROLLER) and bool(data[1:2] and data[1] & CONTROLLER_PASSIVE)
        stats.bus_off += bus_off
        stats.error_passive += passive
        if self.last_error_ns is None:
            if not (bus_off or passive):
                return
            self._bus_off_logged, self._first_bus_off = False, stats.bus_off - bus_off
            if passive:
                _log.warning(
                    "CAN %s: error passive: nobody acknowledges, or the wires are bad", self._channel
                )
        self.last_error_ns = t_ns
        if bus_off and not self._bus_off_logged:
            self._bus_off_logged = True
            _log.warning(
                "CAN %s: bus-off: the wires are shorted, or the bit rates differ; frames are lost until the "
                "controller restarts",
                self._channel,
            )

    def check_recovery(self, t_ns: int) -> None:
        """Log the end of each disturbance that has not recurred for two seconds; `t_ns` is the present time [ns]."""
        if self.last_error_ns is not None and t_ns - self.last_error_ns >= _RECOVERED_AFTER_NS:
            self.last_error_ns = None
            n_bus_off = self._stats.bus_off - self._first_bus_off
            _log.warning("CAN %s: no more errors; bus-off %d times until then", self._channel, n_bus_off)
        if self.last_full_ns is not None and t_ns - self.last_full_ns >= _RECOVERED_AFTER_NS:
            self.last_full_ns = None
            n_dropped = self._stats.dropped - self._first_dropped
            _log.warning(
                "CAN %s: takes all frames again; %d were dropped until then", self._channel, n_dropped
            )


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
        log_file: File for every frame that a simulation sends: candump `.log`, `.asc` or `.blf`; None for none.
        connect: Opens another interface than the named one, such as a simulated one, and does not wait; None for
            python-can's way.

    Raises:
        RecordingError: The log cannot be opened.
        CanError: The channel is missing or down.
    """

    def __init__(
        self,
        can: Can,
        accept: Collection[int],
        first_frames: Sequence[bytes],
        stats: CanStatistics,
        *,
        log_file: Path | None = None,
        connect: Callable[[], CanWire] | None = None,
    ) -> None:
        self.stats = stats
        self._accept = frozenset(accept)
        self._explained = partial(error_text, can)
        self._connect: Callable[[], CanWire] = connect or partial(open_wire, can, self._accept)
        self._name = f"CAN channel {can.channel} ({can.interface})"
        self._health = BusHealth(can.channel, stats)
        self._t_ns = 0
        self._back_off_ns = 0  # 0: the interface is open
        self._due_ns = 0
        self._lost_ns = 0
        self._gone: CanWire | None = None  # lost, and not closed yet
        self._log: CanFrameLog | None = None
        self._is_real = connect is None
        self._opening: _OpenAttempt | None = None
        self._wire: CanWire | None = self._connect()
        try:
            # Sent before the log is open, and before the first force defines the time.
            self._unlogged = self._send_first_frames(first_frames)
            if log_file is not None:
                self._log = CanFrameLog(log_file, can.channel)
        except BaseException:
            self._close_socket()
            raise

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
                    self._log_recovery_and_reset_back_off()
                if taken < n:
                    self._health.log_queue_full(t_ns)
        self.stats.sent += taken
        self.stats.dropped += n - taken
        if self._log is not None and taken:
            self._log.add(t_ns, [*self._unlogged, *frames[:taken]])
            self._unlogged = ()
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
        self.stats.received_commands += len(arrived)
        if self._health.last_error_ns is not None or self._health.last_full_ns is not None:
            self._health.check_recovery(self._t_ns)
        return arrived

    def close(self) -> None:
        """Close the CAN socket, and finish the log file.

        Raises:
            RecordingError: The log is incomplete.
        """
        self._close_socket()
        if self._log is not None:
            log, self._log = self._log, None
            log.close()

    def _send_first_frames(self, frames: Sequence[bytes]) -> Sequence[bytes]:
        """Send as many of the frames as the socket accepts; return those that were accepted.

        Raises:
            CanError: The channel is down. A full queue is no error: without a listener it fills at once.
        """
        assert self._wire is not None
        try:
            taken = self._wire.send(frames, 0)
        except OSError as error:
            raise CanError(self._explained(error)) from error
        self.stats.sent += taken
        self.stats.dropped += len(frames) - taken
        return frames[:taken]

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

    def _log_recovery_and_reset_back_off(self) -> None:
        """Log that the interface works again, and reset the back-off."""
        self._back_off_ns = 0
        self.stats.reopened += 1
        _log.warning("%s is back after %.1f s", self._name, (self._t_ns - self._lost_ns) / 1e9)

    def _close_socket(self) -> None:
        """Close the socket, if one is open."""
        if self._wire is not None:
            self._wire.close()
            self._wire = None
