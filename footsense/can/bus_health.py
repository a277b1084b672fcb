"""What the error frames of a CAN controller say, as counts and as few lines in the journal.

A broken bus is bus-off ten times a second; one line tells that it began and one that it is over.
"""

import logging

from firmware_interface.socketcan import CONTROLLER_PASSIVE, ErrorClass
from footsense.frames import CanStatistics

__all__ = ["BusHealth"]

_log = logging.getLogger(__name__)

#: So long without an error frame, a bus is taken for well again [ns].
_WELL_AFTER_NS = 2_000_000_000


class BusHealth:
    """Listens to error frames.

    Args:
        channel: Name of the channel, for the journal.
        stats: Where to count.
    """

    def __init__(self, channel: str, stats: CanStatistics) -> None:
        self._channel = channel
        self._stats = stats
        self._ill_ns: int | None = None  # time of the last error frame of an illness that was told
        self._told_bus_off = False
        self._first_bus_off = 0

    def note(self, can_id: int, data: bytes, t_ns: int) -> None:
        """Take note of one error frame."""
        stats = self._stats
        stats.bus_errors += 1
        bus_off = bool(can_id & ErrorClass.BUS_OFF)
        passive = bool(can_id & ErrorClass.CONTROLLER) and bool(data[1] & CONTROLLER_PASSIVE)
        stats.bus_off += bus_off
        stats.error_passive += passive
        if self._ill_ns is None:
            if not (bus_off or passive):
                return
            self._told_bus_off, self._first_bus_off = False, stats.bus_off - bus_off
            if passive:
                _log.warning(
                    "CAN %s: error passive: nobody acknowledges, or the wires are bad", self._channel
                )
        self._ill_ns = t_ns
        if bus_off and not self._told_bus_off:
            self._told_bus_off = True
            _log.warning(
                "CAN %s: bus-off: the wires are shorted, or the bit rates differ; frames are lost until the "
                "controller restarts",
                self._channel,
            )

    def watch(self, t_ns: int) -> None:
        """Say that the bus is well again once it has been silent about errors for long enough."""
        if self._ill_ns is not None and t_ns - self._ill_ns >= _WELL_AFTER_NS:
            self._ill_ns = None
            n_bus_off = self._stats.bus_off - self._first_bus_off
            _log.warning("CAN %s: no more errors; bus-off %d times until then", self._channel, n_bus_off)
