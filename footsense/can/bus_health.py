"""Disturbances of a CAN bus, counted, and logged once at their begin and end."""

import logging

from firmware_interface.can.socketcan import CONTROLLER_PASSIVE, ErrorClass
from footsense.frames import CanStatistics

_log = logging.getLogger(__name__)

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
