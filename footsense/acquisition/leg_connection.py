"""Connection state of one leg: part of the scan, or left out of it and tried again later.

A leg that fails for three scans in a row is left out, so that it costs the others no time, and tried again with growing
pauses, at most one leg per scan. The same resets a converter that answers but never finishes, which frees a hung
FDC1004. A leg that holds a line low is left out at once and tried more rarely: each try costs the others an adapter
timeout.
"""

import logging
from typing import TYPE_CHECKING

from firmware_interface.chips import tca9548a
from footsense.acquisition.chip_timing import ChipTiming
from footsense.frames import Codes, Reading
from footsense.leg_words import words_of_reading

if TYPE_CHECKING:
    from footsense.acquisition.boards.board import ConversionStep

_log = logging.getLogger(__name__)

#: Scans in a row with a missing reading before a leg is left out.
_MISSED_SCANS_BEFORE_LEAVING = 3
_FIRST_PAUSE_NS = 250_000_000
_MAX_PAUSE_NS = 4_000_000_000
#: Factor on the pause of a leg that holds a line low, and of a leg on a stuck bus, whose try costs no other leg.
STUCK_LEG_PAUSE_FACTOR, STUCK_BUS_PAUSE_FACTOR = 4.0, 0.25

#: Readings that count as a miss, the gravest first.
_MISSES = (
    Reading.NO_ANSWER,
    Reading.NOT_READY,
    Reading.MISCONFIGURED,
    Reading.CORRUPT,
    Reading.BUS_STUCK,
    Reading.EXCITATION,
)


class LegConnection:
    """Connection state of one leg behind one mux channel.

    Args:
        name: Name of the leg, for messages.
        channel: Mux channel.
        row: Row of the leg in the readings of its bus.

    Attributes:
        selection: Control byte of the mux that connects the leg alone.
        in_scan: Whether the leg takes part in the scans.
        outcome: OK, or why the leg gives no reading in this scan, or since it was left out.
        is_suspect: Whether `count_misses` needs the next scan even if no reading is missing.
        retry_at_ns: Time at which a leg that was left out is tried again [ns].
        capdac_offset_pf: Capacitance that the converter's CAPDAC subtracts from each result [pF].
        timing: Timing of its converter.
        is_timed: Whether that was measured, and its conversions have finished since.
        doubted: Step whose lines it did not read back alone, for the next try; None for none.
        temperature_c: Last temperature of the converter [degC]; NaN without one.
    """

    def __init__(self, name: str, channel: int, row: int) -> None:
        self.name = name
        self.row = row
        self.selection = tca9548a.channel_control_byte(channel)
        self._channel = channel
        self.in_scan = False
        self.outcome = Reading.NO_ANSWER
        self.is_suspect = True
        self.retry_at_ns = 0
        self.capdac_offset_pf = 0.0
        self.timing = ChipTiming()
        self.is_timed = False
        self.doubted: ConversionStep | None = None
        self.temperature_c = float("nan")
        self._misses = 0
        self._pause_ns = _FIRST_PAUSE_NS

    def join_scan(self, offset_pf: float) -> None:
        """Add the leg to the scan, after its chips were found and set up.

        Args:
            offset_pf: Capacitance that the converter's CAPDAC subtracts from each result [pF].
        """
        _log.info("leg %s: converter and line switches answer on channel %d", self.name, self._channel)
        self.capdac_offset_pf = offset_pf
        self.doubted = None
        self.in_scan = True
        self.outcome = Reading.OK
        self._misses = 0

    def set_timing(self, timing: ChipTiming) -> None:
        """Store the measured timing of the leg's converter; log a slow converter once."""
        if timing.wait_factor > 1.0 >= self.timing.wait_factor:
            _log.warning(
                "leg %s: its conversions take up to %.0f %% longer than the slowest converter may; those of the legs "
                "beside it wait for them",
                self.name,
                100 * (timing.wait_factor - 1),
            )
        self.timing = timing
        self.is_timed = True

    def count_misses(self, readings: Codes, now_ns: int) -> None:
        """Count consecutive scans with a missing reading; after three, leave the leg out of the scan for a while.

        Args:
            readings: How each element answered, shape (elements,), uint8 of `Reading`.
            now_ns: The time now [ns].
        """
        present = set(readings.tolist())
        missing = [reading for reading in _MISSES if reading in present]
        if not missing:
            self._misses = 0
            self._pause_ns = _FIRST_PAUSE_NS
            self.is_suspect = False
            return
        self.is_suspect = True
        self._misses += 1
        if self._misses >= _MISSED_SCANS_BEFORE_LEAVING:
            self.leave_scan(missing[0], now_ns)

    def leave_scan(self, outcome: Reading, now_ns: int, why: str = "", pause_factor: float = 1.0) -> None:
        """Leave the leg out of the scan, and delay the next try, twice as long each time.

        Args:
            outcome: Why.
            now_ns: The time now [ns].
            why: The same in words; by default the meaning of the reading.
            pause_factor: Factor on the pause.
        """
        if outcome is not self.outcome or self._pause_ns == _FIRST_PAUSE_NS:
            _log.warning(
                "leg %s: %s; left out of the scan and tried again later",
                self.name,
                why or words_of_reading(outcome).meaning,
            )
        self.in_scan = False
        self.is_suspect = True
        self.is_timed &= outcome is not Reading.NOT_READY
        self.outcome = outcome
        self.temperature_c = float("nan")
        self.retry_at_ns = now_ns + round(pause_factor * self._pause_ns)
        self._pause_ns = min(2 * self._pause_ns, _MAX_PAUSE_NS)
