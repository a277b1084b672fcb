"""Group of legs on one bus whose converters are triggered together by one broadcast write.

One step of a group of six legs, with what overlaps a conversion and what cannot:

      conversion k-1 runs                      conversion k runs
    ──────────────────────┤ lines, trigger k ├────────────────────────────────────────┤ lines, trigger k+1 ...
                                               done? (all) │ leg 1 │ ... │ leg 6 │ check, rejoin (all)

`lines` (the element's row, and its column where that is switched) and `trigger` go to all legs at once. Whether the
conversions are done, and whether lines and settings are held, is asked of all legs in one read: the answers are a wired
AND, and only when the result differs is each leg asked alone. A result is read while the next conversion runs. A leg
that fails is left out for the rest of the scan, so that it costs the others no time.
"""

import logging
from typing import NamedTuple

import numpy as np

from footsense.acquisition.boards.board import (
    CONVERTED,
    ConversionStep,
    ElementResult,
    ReadBackCheck,
    Thermometer,
)
from footsense.acquisition.leg_bus import BusStuckError, LegBus
from footsense.acquisition.leg_connection import (
    STUCK_BUS_PAUSE_FACTOR,
    STUCK_LEG_PAUSE_FACTOR,
    LegConnection,
    measure_chip_timing,
)
from footsense.acquisition.scan_plan import ScanPlan
from footsense.errors import I2cError, I2cTimeoutError
from footsense.frames import ELEMENTS, CapFrame, Reading
from footsense.ports import Clock, Transaction

_log = logging.getLogger(__name__)

_NAN, _OK = float("nan"), Reading.OK
#: Attempts of a transaction before it counts as failed.
_MAX_ATTEMPTS = 2

Legs = tuple[LegConnection, ...]


class Conversion(NamedTuple):
    """A running conversion of a group of legs.

    Attributes:
        step: Its step of the plan.
        t_start_ns: Time at the end of its trigger [ns].
        legs: Legs that convert; none if a transaction failed, or if no leg is active.
        lines_selected: Whether lines were selected for it, or left from the step before.
    """

    step: ConversionStep
    t_start_ns: int
    legs: Legs
    lines_selected: bool


class LegGroup:
    """Legs of one bus whose converters run in parallel, as one I2C write reaches all of them.

    Args:
        legs: The legs, all of the bus.
        bus: The bus.
        clock: The time that the bus lives in.
        plan: The conversions of one scan.

    Attributes:
        latest: Latest readings of all elements, written over one by one.
        mux_read_back: Read of the mux's selection, done after a broadcast question and after every leg: another program
            may have switched it. None where that takes time from the scan, and without a mux.
        running: The conversion that runs; without legs if none of the group's is active, None after a restart.
    """

    def __init__(self, legs: Legs, bus: LegBus, clock: Clock, plan: ScanPlan) -> None:
        self.legs = legs
        self.running: Conversion | None = None
        self.mux_read_back: Transaction | None = None
        self._bus = bus
        self._clock = clock
        self._plan = plan
        shape = len(legs), ELEMENTS
        unread = np.full(shape, Reading.NO_ANSWER, np.uint8)
        self.latest = CapFrame(0, np.zeros(shape, np.int64), np.full(shape, _NAN), unread)

    def discard(self, rows: int | slice, elements: int | slice, reading: Reading) -> None:
        """Replace the latest readings of some legs and elements by NaN and the reason for it."""
        _, t_ns, capacitance_pf, readings = self.latest
        at = rows, elements
        t_ns[at], capacitance_pf[at], readings[at] = 0, _NAN, reading

    def active_legs(self) -> tuple[Legs, int]:
        """Return the legs without a failure in this scan, and the mux selection that connects all of them."""
        active, selection = [], 0
        for leg in self.legs:
            if leg.in_scan and leg.outcome is _OK:
                active.append(leg)
                selection |= leg.selection
        return tuple(active), selection

    def restart(self, step: ConversionStep) -> None:
        """Start a conversion after discarding any old results in the converters."""
        legs, selection = self.active_legs()
        if legs:
            self._exchange(selection, self._plan.board.make_ready)
        self.running = self._start_conversion(legs, selection, step, step.select)

    def finish_conversion_and_start_next(
        self,
        step: ConversionStep,
        following: ConversionStep,
        *,
        checked: bool,
        in_turn: bool,
        ask_first: bool,
        alone: LegConnection | None = None,
    ) -> None:
        """Wait for the running conversion, start the next one, and read the finished one meanwhile.

        Args:
            step: The step that is finished.
            following: The next step; the first one of the plan if `step` ends the scan.
            checked: Whether lines and settings are asked for.
            in_turn: Whether they are asked for in some steps only.
            ask_first: Whether all legs are asked whether they are done before the next trigger, and not after it.
            alone: Leg that is asked for its lines by itself; None for none.

        Raises:
            BusStuckError: A line was held low.
        """
        finished, ends = self.running, following is self._plan.steps[0]
        assert finished is not None
        if alone is not None:
            self._check_lines_of_leg(alone, step)
        if checked:
            self._check_settings(finished)
        legs, selection = self.active_legs()
        failed: dict[LegConnection, Reading] = {}
        if len(legs) < len(self.legs):
            failed = {leg: leg.outcome for leg in self.legs if leg.outcome is not _OK}
        if failed and ends:
            self._set_up_failed_legs(following)
            legs, selection = self.active_legs()
        if legs:  # connect them while they convert; if that fails, `_start_conversion` tries again
            self._exchange(selection, ())
        asks_first = self._wait_and_tell_if_poll_comes_first(finished, ask_first=ask_first)
        all_done = False
        if asks_first:
            all_done = self._mark_late_as_failed(step, legs, selection)
            failed |= {leg: leg.outcome for leg in legs if leg.outcome is not _OK}
            legs, selection = self.active_legs()
        select = following.select_changes if finished.legs else following.select
        running = self._start_conversion(legs, selection, following, select)
        checked_until_now = {
            leg
            for leg, outcome in failed.items()
            if ends or leg is alone or (in_turn and outcome is Reading.MISCONFIGURED)
        }
        self._discard_readings(step, failed, checked_until_now)
        read = finished.legs
        if failed:
            read = tuple(leg for leg in read if leg not in failed)
        if read:
            if not asks_first:
                all_done = self._all_done(step, selection) if running.legs else step.done is None
            self._read_out(step, following, read, finished.t_start_ns, all_done=all_done)
        self.running = running

    def _discard_readings(
        self,
        step: ConversionStep,
        failed: dict[LegConnection, Reading],
        checked_until_now: set[LegConnection],
    ) -> None:
        """Discard the readings of a step, and of failed legs whose check covers the scan all those before it."""
        for result in step.results:
            self.discard(slice(None), result.element, Reading.NO_ANSWER)
            for leg, outcome in failed.items():
                elements = slice(None) if leg in checked_until_now else result.element
                self.discard(leg.row, elements, outcome)

    def _wait_and_tell_if_poll_comes_first(self, conversion: Conversion, *, ask_first: bool) -> bool:
        """Wait until all legs have finished; return whether they are to be asked before the next trigger.

        It is so if a chip's DONE bit is cleared by that.
        """
        wait_factor, forgets = 1.0, ask_first
        for leg in conversion.legs:
            wait_factor = max(wait_factor, leg.timing.wait_factor)
            forgets |= not leg.timing.keeps_done_bit
        self._clock.sleep_until_ns(conversion.t_start_ns + round(self._plan.conversion_wait_ns * wait_factor))
        return forgets and conversion.step.done is not None

    def read_temperatures(self, thermometer: Thermometer) -> None:
        """Convert and store the temperature of each active leg [degC], of which there is one; end at a failure."""
        legs, selection = self.active_legs()
        self.running = None
        if self._exchange(selection, thermometer.start) is None:
            self._bus.forget_selection()
            return
        wait_factor = max(leg.timing.wait_factor for leg in legs)
        self._clock.sleep_until_ns(self._clock.now_ns() + round(wait_factor * thermometer.wait_ns))
        for leg in legs:
            answers = self._exchange(leg.selection, (thermometer.read, thermometer.read))
            if answers is None:
                self._bus.forget_selection()
                return
            leg.temperature_c = thermometer.decode(*answers)

    def measure_conversion_time(self, leg: LegConnection) -> None:
        """Measure and store the conversion time of a leg's converter; keep the old one if no conversion finishes."""
        self.running = None
        try:
            timing = measure_chip_timing(self._bus.connect(leg.selection), self._clock, self._plan)
        except I2cError as error:
            self._raise_if_stuck(error)
            self._bus.forget_selection()
        else:
            leg.set_timing(timing or leg.timing)

    def _exchange(self, selection: int, transactions: tuple[Transaction, ...]) -> list[bytes] | None:
        """Connect mux channels, do transactions, and return their answers; None if one failed."""
        try:
            bus = self._bus.connect(selection)
            return list(map(bus.transfer, transactions))
        except I2cError as error:
            self._raise_if_stuck(error)
            return None

    def _start_conversion(
        self, legs: Legs, selection: int, step: ConversionStep, select: tuple[Transaction, ...]
    ) -> Conversion:
        for _ in range(_MAX_ATTEMPTS if legs else 0):
            try:
                bus = self._bus.connect(selection)
                for write in (*select, step.trigger):
                    bus.transfer(write)
            except I2cError as error:
                self._raise_if_stuck(error)
                self._bus.forget_selection()  # a mux that has lost its selection connects no leg
            else:
                return Conversion(step, self._clock.now_ns(), legs, bool(select))
        return Conversion(step, self._clock.now_ns(), (), bool(select))

    def _read_out(
        self, step: ConversionStep, following: ConversionStep, legs: Legs, t_start_ns: int, *, all_done: bool
    ) -> None:
        _, t_ns, capacitance_pf, readings = self.latest
        plan = self._plan
        for leg in legs:
            if not leg.in_scan:  # left out since the conversion began
                continue
            for result in step.results:
                at = leg.row, result.element
                reading, capacitance_pf[at] = self._read_leg(leg, step, result, all_done=all_done)
                readings[at] = reading
                if reading in CONVERTED:
                    excess_ns = round((leg.timing.wait_factor - 1) * plan.conversion_wait_ns)
                    t_ns[at] = t_start_ns + (plan.conversion_ns + excess_ns) // 2
                else:
                    leg.outcome = reading
                    # It was triggered again before it was asked, and that conversion runs alone.
                    leg.unfinished = following if reading is Reading.NOT_READY else None

    def _mark_late_as_failed(self, step: ConversionStep, legs: Legs, selection: int) -> bool:
        """Mark each leg as failed whose conversion has not finished before the next trigger; return if the others have.

        A chip whose DONE bit that clears has to say it now. Of another one an answer that is lost is asked for again.
        """
        assert step.done is not None
        if not legs or self._all_done(step, selection):
            return True
        for leg in legs:
            answers = self._exchange(leg.selection, (step.done.read,))
            outcome = Reading.NO_ANSWER if answers is None else step.done.decode(answers[0])
            if outcome is Reading.NOT_READY or not leg.timing.keeps_done_bit:
                leg.outcome = outcome
                leg.unfinished = step
        return not all(leg.timing.keeps_done_bit for leg in legs)

    def _all_done(self, step: ConversionStep, selection: int) -> bool:
        if step.done is None:
            return True
        asks = (step.done.read,) if self.mux_read_back is None else (step.done.read, self.mux_read_back)
        answers = self._exchange(selection, asks)
        if answers is None or (len(asks) > 1 and answers[1][0] != selection):
            self._bus.forget_selection()
            return False
        return step.done.decode(answers[0]) is _OK

    def _read_leg(
        self, leg: LegConnection, step: ConversionStep, result: ElementResult, *, all_done: bool
    ) -> tuple[Reading, float]:
        reading = Reading.NO_ANSWER
        for _ in range(_MAX_ATTEMPTS):
            try:
                bus = self._bus.connect(leg.selection)
                if step.done and not all_done:
                    reading = step.done.decode(bus.transfer(step.done.read))
                    if reading is Reading.CORRUPT:
                        continue
                    if reading is Reading.NOT_READY:
                        break
                reading, capacitance_pf = self._plan.board.decode_result(list(map(bus.transfer, result.read)))
                if self.mux_read_back and bus.transfer(self.mux_read_back)[0] != leg.selection:
                    self._bus.forget_selection()
                    reading = Reading.DELAYED
                    continue
                return reading, capacitance_pf + leg.capdac_offset_pf
            except I2cError as error:
                self._raise_if_stuck(error)
                self._bus.forget_selection()
                reading = Reading.NO_ANSWER
        return reading, _NAN

    def _check_settings(self, running: Conversion) -> None:
        """Read back line and chip settings during a conversion; mark each leg as failed whose check fails."""
        checks = running.step.select_checks if running.lines_selected else ()
        for check in (*checks, *running.step.setting_checks):
            legs, selection = self.active_legs()
            if legs and self._read_check(selection, check) is not _OK:
                for leg in legs:
                    leg.outcome = self._read_check(leg.selection, check)

    def _check_lines_of_leg(self, leg: LegConnection, step: ConversionStep) -> None:
        if not leg.in_scan or leg.outcome is not _OK:
            return
        for check in step.select_checks:
            answer = self._read_check(leg.selection, check)
            if answer is not _OK and self._read_check(leg.selection, check) is Reading.MISCONFIGURED:
                leg.doubted = step
                leg.leave_scan(Reading.MISCONFIGURED, self._clock.now_ns())
                return

    def _read_check(self, selection: int, check: ReadBackCheck) -> Reading:
        answers = self._exchange(selection, (check.read,))
        if answers is None:
            return Reading.NO_ANSWER
        return _OK if answers[0] == check.expected else Reading.MISCONFIGURED

    def _set_up_failed_legs(self, first: ConversionStep) -> None:
        """Set up again the legs that failed in this scan, for the first conversion of the next scan.

        The others still convert: the leg's lines are set alone, and a result that its converter holds is discarded. A
        conversion that has finished by now was late; else the converter hangs.
        """
        for leg in self.legs:
            if not leg.in_scan or leg.outcome is _OK:
                continue
            if leg.unfinished is not None and leg.unfinished.done is not None:
                answers = self._exchange(leg.selection, (leg.unfinished.done.read,))
                leg.count_late_scan(
                    is_late=answers is not None and leg.unfinished.done.decode(answers[0]) is _OK
                )
                leg.unfinished = None
            if self._exchange(leg.selection, (*first.select, *self._plan.board.make_ready)) is not None:
                outcomes = (self._read_check(leg.selection, check) for check in first.select_checks)
                outcome = next((outcome for outcome in outcomes if outcome is not _OK), _OK)
                if outcome is not Reading.NO_ANSWER:
                    leg.outcome = outcome

    def _raise_if_stuck(self, error: I2cError) -> None:
        """After a bus timeout, leave out the leg that holds SDA or SCL low, and raise an error.

        Raises:
            BusStuckError: The error is a timeout.
        """
        if isinstance(error, I2cTimeoutError):
            self._leave_out_stuck_legs()
            raise BusStuckError from error

    def _leave_out_stuck_legs(self) -> None:
        """Leave out the legs that hold SDA or SCL low; all legs if the bus stays stuck.

        No answer shows which of the connected legs holds the line: the whole bus is blocked. So all are disconnected
        and asked one by one, by a read that changes nothing; the leg whose question times out is left out. Each costs
        one more adapter timeout.
        """
        read = self._plan.steps[0].select_checks[0].read
        free = self._bus.free_bus()
        for leg in self.legs:
            if not leg.in_scan:
                continue
            if not free:
                why = "the bus is held low and does not get free"
                leg.leave_scan(Reading.BUS_STUCK, self._clock.now_ns(), why, STUCK_BUS_PAUSE_FACTOR)
                continue
            try:
                self._bus.connect(leg.selection).transfer(read)
            except I2cTimeoutError:
                free = self._bus.free_bus()
                leg.leave_scan(Reading.BUS_STUCK, self._clock.now_ns(), pause_factor=STUCK_LEG_PAUSE_FACTOR)
            except I2cError as error:  # of this leg alone, and met by the scan too
                _log.debug("leg %s: %s", leg.name, error)
