"""The connection to one leg's chips: is it there, has it gone, when is it tried again.

A leg that fails for `MISSES_ALLOWED` scans in a row is left out, so that it costs the others nothing; it is tried
again with growing pauses, one leg per scan at most. A converter that answers but never finishes is reset the same
way, which is what frees a hung FDC1004.
"""

import logging
from enum import Enum

from firmware_interface import tca9548a
from footsense.drivers import fdc1004
from footsense.errors import HardwareError
from footsense.frames import Reading
from footsense.ports import I2cBus, Transaction

_log = logging.getLogger(__name__)

MISSES_ALLOWED = 3
_FIRST_PAUSE_NS = 250_000_000
_LONGEST_PAUSE_NS = 4_000_000_000


class LinkStatus(Enum):
    """Whether a leg takes part in the scan, and what its elements read as while it does not."""

    IN_SCAN = Reading.OK
    SILENT = Reading.NO_ANSWER
    STUCK = Reading.NOT_READY


class LegLink:
    """One leg behind one channel of a bus's mux.

    Args:
        name: Name of the leg, for messages.
        channel: Mux channel.
        mux_address: Address of the mux.
    """

    def __init__(self, name: str, channel: int, mux_address: int) -> None:
        self.name = name
        self.channel = channel
        self.connect = Transaction(mux_address, bytes((tca9548a.select((channel,)),)))
        self.status = LinkStatus.SILENT
        self.misses = 0
        self.retry_at_ns = 0
        self._pause_ns = _FIRST_PAUSE_NS

    def probe(self, bus: I2cBus, select_row: Transaction, now_ns: int) -> None:
        """Look for the leg's chips, set them up, and take the leg into the scan or put off the next try.

        The leg must be connected. `select_row` gives the switches the row that the other legs have now.
        Nothing is raised: a leg that is missing is a state.
        """
        try:
            fdc1004.identify(bus)
            fdc1004.configure(bus)
            bus.transfer(select_row)
        except HardwareError as error:
            if self._pause_ns == _FIRST_PAUSE_NS:
                _log.warning("leg %s: %s", self.name, error)
            self.retry_at_ns = now_ns + self._pause_ns
            self._pause_ns = min(2 * self._pause_ns, _LONGEST_PAUSE_NS)
        else:
            _log.info("leg %s: converter and row switches answer on channel %d", self.name, self.channel)
            self.status = LinkStatus.IN_SCAN
            self.misses = 0

    def note_scan(self, worst: Reading, now_ns: int) -> None:
        """Count scans without an answer; after too many, leave the leg out of the scan for a while."""
        if worst not in {Reading.NO_ANSWER, Reading.NOT_READY}:
            self.misses = 0
            self._pause_ns = _FIRST_PAUSE_NS
            return
        self.misses += 1
        if self.misses < MISSES_ALLOWED:
            return
        self.status = LinkStatus.SILENT if worst is Reading.NO_ANSWER else LinkStatus.STUCK
        what = "does not answer" if worst is Reading.NO_ANSWER else "does not finish its conversions"
        if self._pause_ns == _FIRST_PAUSE_NS:
            _log.warning("leg %s %s; left out of the scan and tried again later", self.name, what)
        self.retry_at_ns = now_ns + self._pause_ns
        self._pause_ns = min(2 * self._pause_ns, _LONGEST_PAUSE_NS)
