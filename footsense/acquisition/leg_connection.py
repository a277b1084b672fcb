"""Connection of one leg: finding and timing its chips, and whether it is part of the scan or left out of it.

A leg that fails for some scans in a row, about 70 ms, is left out, so that it costs the others no time, and tried again
with growing pauses, at most one leg per scan. By then it has been silent for
so long that it is tared again; a cable that breaks for 20 ms does not cost that. The same resets a converter that
answers but never finishes, which frees a hung FDC1004. A leg that holds a line low is left out at once and tried more
rarely: each try costs the others an adapter timeout.

The clock of a converter is inaccurate: the plan waits 2 % longer than the nominal time. A chip that needs more gets it,
and so do the legs that convert at the same time; else the lines of the next element would be switched before it has
finished, which nothing would show. A conversion is started while the result of the one before is still to be asked for:
whether a chip then still says that it was done is in no data sheet. Of a chip that does not, the question comes first
(`scanner.py`). A leg is timed when it is found, and again when it is late (`boards/chip_timing.py`). After it was left
out its results are read whole, as another chip may have come back, until it is timed again.
"""

import logging
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple, TypeVar

from firmware_interface.chips import tca9548a
from footsense.acquisition.boards import fdc1004
from footsense.acquisition.boards.board import ConversionStep
from footsense.acquisition.boards.chip_timing import ChipTiming, measure_chip_timing
from footsense.acquisition.leg_bus import LegBus, release_sda
from footsense.acquisition.scan_plan import ScanPlan
from footsense.errors import HardwareError, I2cError, I2cTimeoutError, WrongChipError
from footsense.frames import Reading
from footsense.leg_words import words_of_reading
from footsense.ports import Clock, I2cBus, Transaction

_log = logging.getLogger(__name__)

#: Scans in a row with a late conversion before a converter is timed: once may be a fault that has passed.
_LATE_SCANS_BEFORE_TIMING = 2
_FIRST_PAUSE_NS = 250_000_000
_MAX_PAUSE_NS = 4_000_000_000
_NS_PER_S = 1_000_000_000
#: Factor on the pause of a leg that holds a line low, and of a leg on a stuck bus, whose try costs no other leg.
_STUCK_LEG_PAUSE_FACTOR, _STUCK_BUS_PAUSE_FACTOR = 4.0, 0.25

#: Why a leg cannot be distinguished from the others.
_KEEPS_CHANNELS = (
    "its multiplexer acknowledges other channels than it connects: check its supply, or replace it"
)

#: Readings that count as a miss, the gravest first.
_MISSES = (
    Reading.NO_ANSWER,
    Reading.NOT_READY,
    Reading.MISCONFIGURED,
    Reading.CORRUPT,
    Reading.BUS_STUCK,
)


class LegConnection:
    """Connection state of one leg behind one mux channel.

    Args:
        name: Name of the leg, for messages.
        channel: Mux channel.
        row: Row of the leg in the readings of its bus.
        harmless_read: Read of one of its chips that changes nothing.
        most_misses: Scans in a row with a missing reading after which it is left out.

    Attributes:
        name, row, harmless_read: As given.
        selection: Control byte of the mux that connects the leg alone.
        in_scan: Whether the leg takes part in the scans.
        outcome: OK, or why the leg gives no reading in this scan, or since it was left out.
        is_suspect: Whether `count_misses` needs the next scan even if no reading is missing.
        retry_at_ns: Time at which a leg that was left out is tried again [ns].
        timing: Timing of its converter.
        is_timed: Whether that was measured, and it has not been late since.
        unfinished: Step of the scan that had not finished when it was asked for; None for none.
        doubted: Step whose lines it did not read back alone, for the next try; None for none.
        why: Why it was last left out of the scan, in words; empty for the meaning of its outcome.
    """

    def __init__(
        self, name: str, channel: int, row: int, harmless_read: Transaction, most_misses: int
    ) -> None:
        self.name = name
        self.row = row
        self.harmless_read = harmless_read
        self.selection = tca9548a.channel_control_byte(channel)
        self.in_scan = False
        self.outcome = Reading.NO_ANSWER
        self.is_suspect = True
        self.retry_at_ns = 0
        self.timing = ChipTiming()
        self.is_timed = False
        self.unfinished: ConversionStep | None = None
        self._n_late_scans = 0
        self.doubted: ConversionStep | None = None
        self._misses = 0
        self._most_misses = most_misses
        self._pause_ns = _FIRST_PAUSE_NS
        self.why = ""

    def join_scan(self) -> None:
        """Add the leg to the scan, after its chips were found and set up."""
        _log.info("leg %s: its chips answer", self.name)
        self.doubted = None
        self.in_scan = True
        self.outcome = Reading.OK
        self._misses = 0

    def set_timing(self, timing: ChipTiming | None) -> None:
        """Store the measured timing of the leg's converter, None for as before; log a slow converter once."""
        measured = timing or self.timing
        if measured.wait_factor > 1.0 >= self.timing.wait_factor:
            _log.warning(
                "leg %s: its conversions take up to %.0f %% longer than the slowest converter may; those of the "
                "legs beside it wait for them",
                self.name,
                100 * (measured.wait_factor - 1),
            )
        self.timing = measured
        self.is_timed = True
        self._n_late_scans = 0

    def count_late_scan(self, *, is_late: bool) -> None:
        """Count consecutive scans in which a conversion finished, but late; after two, the converter is to be timed."""
        self._n_late_scans = self._n_late_scans + 1 if is_late else 0
        self.is_timed &= self._n_late_scans < _LATE_SCANS_BEFORE_TIMING

    def count_misses(self, readings: Iterable[int], now_ns: int) -> None:
        """Count consecutive scans with a missing reading; after a few, leave the leg out of the scan for a while.

        Args:
            readings: How each element answered, as `Reading`.
            now_ns: The time now [ns].
        """
        present = set(readings)
        missing = [reading for reading in _MISSES if reading in present]
        if not missing:
            self._misses = self._n_late_scans = 0
            self._pause_ns = _FIRST_PAUSE_NS
            self.is_suspect = False
            return
        self.is_suspect = True
        self._misses += 1
        if self._misses >= self._most_misses:
            self.leave_scan(missing[0], now_ns)

    def leave_scan(
        self, outcome: Reading, now_ns: int, why: str | None = "", pause_factor: float = 1.0
    ) -> None:
        """Leave the leg out of the scan, and delay the next try, twice as long each time.

        Args:
            outcome: Why.
            now_ns: The time now [ns].
            why: The same in words; by default the meaning of the reading. None for no line: its bus has one.
            pause_factor: Factor on the pause.
        """
        self.why = why or ""
        if why is not None and (outcome is not self.outcome or self._pause_ns == _FIRST_PAUSE_NS):
            _log.warning(
                "leg %s: %s; left out of the scan, and tried again at least every %g s",
                self.name,
                why or words_of_reading(outcome).meaning,
                pause_factor * _MAX_PAUSE_NS / _NS_PER_S,
            )
        self.in_scan = False
        self.is_suspect = True
        self.outcome = outcome
        # Another chip may come back.
        self.timing = self.timing._replace(reads_whole_result=True)
        self.retry_at_ns = now_ns + round(pause_factor * self._pause_ns)
        self._pause_ns = min(2 * self._pause_ns, _MAX_PAUSE_NS)


L = TypeVar("L", bound=LegConnection)
Legs = list[LegConnection]
Outcomes = dict["LegConnection", Reading]


class Conversion(NamedTuple):
    """A running conversion of the legs of a bus.

    Attributes:
        t_start_ns: Time at the end of its trigger [ns].
        legs: Legs that convert; none if a transaction failed, or if no leg is active.
        lines_selected: Whether lines were selected for it, or left from the step before.
    """

    t_start_ns: int
    legs: Legs
    lines_selected: bool


def time_converter(bus: LegBus, leg: LegConnection, clock: Clock) -> None:
    """Measure and store the timing of a leg's converter; keep the old one if it finishes no conversion.

    Raises:
        I2cTimeoutError: A line is held low.
    """
    try:
        timing = measure_chip_timing(bus.connect(leg.selection), clock)
    except I2cTimeoutError:
        raise
    except I2cError:
        bus.forget_selection()
    else:
        leg.set_timing(timing)


def probe_leg(
    bus: LegBus, leg: L, bus_legs: Sequence[L], set_up: Callable[[I2cBus, L], Reading], clock: Clock
) -> None:
    """Probe one leg's chips; add the leg to the scan, or delay the next try.

    Args:
        bus: The bus.
        leg: The leg.
        bus_legs: All legs of the bus. If the bus itself is stuck, the waiting ones are put off too: one of them is
            enough to find out when it gets free.
        set_up: Checks and sets up the chips of the leg that is connected alone; returns OK, or why it cannot be used.
            Raises WrongChipError, and HardwareError if one does not answer.
        clock: The time that the bus lives in.
    """
    try:
        bus.connect(leg.selection)
    except I2cTimeoutError as error:
        leg.leave_scan(Reading.BUS_STUCK, clock.now_ns(), str(error), _STUCK_BUS_PAUSE_FACTOR)
        for other in bus_legs:
            if not other.in_scan:
                other.retry_at_ns = max(other.retry_at_ns, leg.retry_at_ns)
    except I2cError as error:
        leg.leave_scan(Reading.NO_ANSWER, clock.now_ns(), str(error))
    else:
        _set_up_leg(bus, leg, set_up, clock)
        if leg.outcome is Reading.BUS_STUCK:
            bus.free_bus()


def _set_up_leg(bus: LegBus, leg: L, set_up: Callable[[I2cBus, L], Reading], clock: Clock) -> None:
    """Set up the chips of the only connected leg; add the leg to the scan, or delay the next try."""
    now_ns, why = clock.now_ns(), ""
    try:
        release_sda(bus.adapter)
        if bus.holds_selection(leg.selection):
            outcome = set_up(bus.adapter, leg)
        else:
            outcome, why = Reading.MISCONFIGURED, _KEEPS_CHANNELS
    except I2cTimeoutError as error:
        # Without a mux it is the bus of all legs, whichever of them holds it.
        factor = _STUCK_BUS_PAUSE_FACTOR if bus.mux_address is None else _STUCK_LEG_PAUSE_FACTOR
        leg.leave_scan(Reading.BUS_STUCK, now_ns, str(error), factor)
    except WrongChipError as error:
        leg.leave_scan(Reading.WRONG_CHIP, now_ns, str(error))
    except HardwareError as error:
        leg.leave_scan(Reading.NO_ANSWER, now_ns, str(error))
    else:
        if outcome is Reading.OK:
            leg.join_scan()
        else:
            leg.leave_scan(outcome, now_ns, why)


def set_up_triggered(plan: ScanPlan, bus: I2cBus, leg: LegConnection) -> Reading:
    """Check and set up the chips of the only connected leg, whose conversions are triggered: settings, first lines.

    Returns:
        OK; or MISCONFIGURED if a row switch does not hold lines that it has been doubted of.

    Raises:
        HardwareError: One does not answer.
        WrongChipError: Another chip answers.
        I2cError: A transaction failed otherwise.
    """
    fdc1004.check_identity(bus)
    for write in fdc1004.SET_UP:
        bus.transfer(write)
    is_set = True
    for step in filter(None, (leg.doubted, plan.steps[0])):
        bus.transfer(step.select)
        if step is leg.doubted:
            is_set = bus.transfer(step.select_check.read) == step.select_check.expected
    return Reading.OK if is_set else Reading.MISCONFIGURED


def probe_due_legs(
    bus: LegBus, legs: Sequence[L], set_up: Callable[[I2cBus, L], Reading], clock: Clock
) -> None:
    """Probe the leg that has waited longest, if one is due; at most one per scan, to keep the scan's pace.

    If no leg is in the scan, all that are due are tried, until one finds the bus stuck.
    """
    now_ns = clock.now_ns()
    alone = not any(leg.in_scan for leg in legs)
    due = [leg for leg in legs if not leg.in_scan and leg.retry_at_ns <= now_ns]
    if alone and due:
        bus.free_bus()  # any leg may hold the lines
    for leg in sorted(due, key=lambda leg: leg.retry_at_ns)[: len(due) if alone else 1]:
        outcome = leg.outcome
        probe_leg(bus, leg, legs, set_up, clock)
        if leg.in_scan:
            # It does not take part in the conversion that runs, and joins with the next scan.
            leg.outcome = outcome
        elif leg.outcome is Reading.BUS_STUCK:
            return


def set_up_failed_legs(bus: LegBus, legs: Sequence[LegConnection], first: ConversionStep) -> None:
    """Set up again the legs that failed in this scan, for the first conversion of the next scan.

    The others still convert: the leg's lines are set alone, and a result that its converter holds is discarded. A
    conversion that has finished by now was late; else the converter hangs, or was reset: then its settings are lost.

    Raises:
        I2cTimeoutError: A line is held low.
    """
    for leg in legs:
        if not leg.in_scan or leg.outcome is Reading.OK:
            continue
        if leg.unfinished is not None:
            leg.count_late_scan(is_late=bus.poll(leg.selection, leg.unfinished.done) is Reading.OK)
            leg.unfinished = None
        if bus.exchange(leg.selection, (first.select, *fdc1004.MAKE_READY)) is None:
            continue
        checks = first.select_check, fdc1004.SETTING_CHECK
        held = bus.exchange(leg.selection, tuple(check.read for check in checks))
        if held is not None:
            is_set = held == [check.expected for check in checks]
            leg.outcome = Reading.OK if is_set else Reading.MISCONFIGURED


def leave_out_mixed_up_legs(
    bus: LegBus, leg: LegConnection, legs: Sequence[LegConnection], clock: Clock
) -> None:
    """Leave out all legs of a bus if its mux connects others than the leg that it is told to, twice.

    One that acknowledges and keeps its channels gives every leg the readings of one. A leg that it does connect is
    found again.

    Args:
        bus: The bus.
        leg: The leg that is connected.
        legs: All legs of the bus.
        clock: The time that the bus lives in.

    Raises:
        I2cTimeoutError: A line is held low.
    """
    if bus.holds_selection(leg.selection) or bus.holds_selection(leg.selection):
        return
    for each in legs:
        if each.in_scan:
            each.leave_scan(Reading.MISCONFIGURED, clock.now_ns(), _KEEPS_CHANNELS)


def leave_out_stuck_legs(bus: LegBus, legs: Sequence[LegConnection], clock: Clock) -> None:
    """Leave out the legs that hold SDA or SCL low, after a transaction timed out; all legs if the bus stays stuck.

    No answer shows which of the connected legs holds the line: the whole bus is blocked. So all are disconnected and
    asked one by one; the leg whose question times out is left out. Each costs one more adapter timeout.

    Args:
        bus: The bus.
        legs: All legs of the bus.
        clock: The time that the bus lives in.
    """
    free, behind = bus.free_bus(), []
    for leg in legs:
        if not leg.in_scan:
            continue
        if not free:
            leg.leave_scan(Reading.BUS_STUCK, clock.now_ns(), None, _STUCK_BUS_PAUSE_FACTOR)
            behind.append(leg.name)
            continue
        try:
            bus.exchange(leg.selection, (leg.harmless_read,))
        except I2cTimeoutError:
            free = bus.free_bus()
            leg.leave_scan(Reading.BUS_STUCK, clock.now_ns(), pause_factor=_STUCK_LEG_PAUSE_FACTOR)
    if behind:
        _log.warning(
            "the bus of %s is held low and does not get free; they are left out of the scan, and tried again at least "
            "every %g s",
            ", ".join(behind),
            _STUCK_BUS_PAUSE_FACTOR * _MAX_PAUSE_NS / _NS_PER_S,
        )
