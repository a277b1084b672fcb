"""Scanner of a bus: conversions of all its legs in sequence, restarts, searches of missing legs, frames.

One conversion of six legs, with what overlaps it and what cannot:

      conversion k-1 runs                      conversion k runs
    ──────────────────────┤ lines, trigger k ├────────────────────────────────────────┤ lines, trigger k+1 ...
                                               done? (all) │ leg 1 │ ... │ leg 6 │ check, rejoin (all)

`lines` (the element's row) and `trigger` go to all legs at once. Whether the
conversions are done, and whether lines and settings are held, is asked of all legs in one read: the answers are a wired
AND, and only when the result differs is each leg asked alone. A result is read while the next conversion runs. A leg
that fails is left out for the rest of the scan, so that it costs the others no time.

A line that is held low blocks the bus: the leg that holds it is left out, and all conversions restart. Where a
conversion leaves no time for the checks of lines and settings, they are made in one step a scan, in turn. Once a second
all legs are asked whether they are done before the next conversion starts: one that is late would get the lines of the
next element, which nothing else shows. It is timed again between two scans. The control byte of the mux is read back
once a scan, or in four where that takes time, one leg connected in turn: one that keeps its channels would give every
leg the readings of one.
"""

from functools import partial
from operator import is_

import numpy as np

from footsense.acquisition.boards import fdc1004
from footsense.acquisition.boards.board import CONVERTED, ConversionStep
from footsense.acquisition.bus_timing import BusTiming, measure_bus_timing
from footsense.acquisition.leg_bus import MAX_ATTEMPTS, LegBus
from footsense.acquisition.leg_connection import (
    Conversion,
    LegConnection,
    Legs,
    Outcomes,
    leave_out_mixed_up_legs,
    leave_out_stuck_legs,
    probe_due_legs,
    probe_leg,
    set_up_failed_legs,
    set_up_triggered,
    time_converter,
)
from footsense.acquisition.scan_plan import ScanPlan
from footsense.errors import I2cTimeoutError
from footsense.frames import ELEMENTS, ROWS, CapFrame, Reading
from footsense.ports import Clock, Transaction

_NAN, _OK = float("nan"), Reading.OK
#: Scans in a row with a missing reading before a leg is left out.
_MISSED_SCANS_BEFORE_LEAVING = 3
#: Scans between two questions of a leg alone, where they take time.
_ALONE_EVERY = 4
#: Period of the question whether a leg is late, and least time between two timings of converters [ns]: each costs the
#: legs of the bus a transaction, or some conversions.
_LATENESS_PERIOD_NS, _TIMING_PAUSE_NS = 1_000_000_000, 1_000_000_000


class BusScanner:
    """Frame source of all legs on one I2C bus, whose converters run in parallel: one write reaches all of them.

    Args:
        bus, clock: The bus, and the time that it lives in.
        channels: Channel of each leg by name, in the order of the rows of its frames.
        plan: The conversions of one scan.

    Attributes:
        clock, plan: As given.
        legs: The connections to the legs, in the order of the rows.
        latest: Their latest readings, written over element by element.
        bus_timing: Cost of transactions and limits of the scan, measured by `start`; None if no leg answered.
        n_late_discards: Number of times that the loop was delayed for so long that conversions were discarded.
        complete_ns: Time at which the last frame was complete [ns].
        frames_per_scan: Frames in a scan: one for each conversion.
    """

    def __init__(self, bus: LegBus, clock: Clock, channels: dict[str, int], plan: ScanPlan) -> None:
        self._bus = bus
        self.clock = clock
        self.plan = plan
        self._set_up = partial(set_up_triggered, plan)
        self.legs = tuple(
            LegConnection(name, channel, row, plan.harmless_read, _MISSED_SCANS_BEFORE_LEAVING)
            for row, (name, channel) in enumerate(channels.items())
        )
        shape = len(self.legs), ELEMENTS
        unread = np.full(shape, Reading.NO_ANSWER, np.uint8)
        self.latest = CapFrame(0, np.zeros(shape, np.int64), np.full(shape, _NAN), unread)
        self.bus_timing: BusTiming | None = None
        self.n_late_discards = self.complete_ns = 0
        self.frames_per_scan = len(plan.steps)
        # The conversion that runs, and its step; None after a restart.
        self._running: Conversion | None = None
        self._position = self._sequence = self._n_scans = 0
        self._check_all = True
        self._late_ns = 2 * plan.conversion_wait_ns
        self._timing_due_ns = self._lateness_due_ns = 0

    def start(self) -> None:
        """Measure the bus timing, and set up every leg's chips; missing legs are tried again later.

        Raises:
            HardwareError: The mux does not answer, or a line is stuck: no leg can be reached.
        """
        addresses = (self.plan.harmless_read.address,)
        timing = measure_bus_timing(self._bus, self.clock, self.plan, len(self.legs), addresses)
        if timing is not None:
            self.bus_timing = timing
            self._late_ns = 2 * timing.lower_bounds.scan_period_bound_ns // len(self.plan.steps)
            self._check_all = timing.all_checks_fit
        for leg in self.legs:
            probe_leg(self._bus, leg, self.legs, self._set_up, self.clock)
            if leg.in_scan:
                try:
                    time_converter(self._bus, leg, self.clock)
                except I2cTimeoutError:
                    self._leave_out_stuck_legs()
        if timing is not None and any(leg.is_timed and leg.timing.reads_whole_result for leg in self.legs):
            self.bus_timing = timing = timing.with_whole_results(self.plan, len(self.legs))
            self._check_all = timing.all_checks_fit

    def read(self) -> CapFrame:
        """Finish the next conversion of every leg; return its readings with the latest ones of all other elements.

        The conversion after it is then running. The first frame is a whole scan.
        """
        for _ in range(1 if self._sequence else len(self.plan.steps)):
            self._convert()
        _, t_ns, capacitance_pf, reading = self.latest
        frame = CapFrame(self._sequence, t_ns.copy(), capacitance_pf.copy(), reading.copy())
        self._sequence, self.complete_ns = self._sequence + 1, self.clock.now_ns()
        return frame

    def close(self) -> None:
        """Disconnect all legs from the bus: select no mux channel."""
        self._bus.disconnect_legs()

    def _convert(self) -> None:
        """Finish a conversion, again from its start if a line was held low meanwhile; then it has no readings."""
        for _ in range(MAX_ATTEMPTS):
            try:
                if self._position == 0:
                    self._time_late_leg()
                self._start_missing_conversion()
                self._finish_conversion_and_start_next()
            except I2cTimeoutError:
                self._leave_out_stuck_legs()
            else:
                return
        for leg in self.legs:
            lost = Reading.DELAYED if leg.in_scan else leg.outcome
            self._discard(leg.row, self.plan.steps[self._position], lost)

    def _leave_out_stuck_legs(self) -> None:
        self._running = None
        leave_out_stuck_legs(self._bus, self.legs, self.clock)

    def _discard(self, rows: int | slice, step: ConversionStep | None, reading: Reading) -> None:
        """Replace the latest readings of some legs in a step, or in all, by NaN and the reason for it."""
        _, t_ns, capacitance_pf, readings = self.latest
        at = rows, slice(None) if step is None else step.element
        t_ns[at], capacitance_pf[at], readings[at] = 0, _NAN, reading

    def _active_legs(self) -> tuple[Legs, int]:
        """Return the legs without a failure in this scan, and the mux selection that connects all of them."""
        active: Legs = []
        selection = 0
        for leg in self.legs:
            if leg.in_scan and leg.outcome is _OK:
                active.append(leg)
                selection |= leg.selection
        return active, selection

    def _start_missing_conversion(self) -> None:
        """Start a conversion if none runs, or if the loop was delayed for too long; old results are read away."""
        running = self._running
        is_late = running is not None and self.clock.now_ns() > running.t_start_ns + self._late_ns
        self.n_late_discards += is_late
        # A trigger that failed may have been taken all the same.
        if running is None or is_late or not running.legs:
            legs, selection = self._active_legs()
            if legs:
                self._bus.exchange(selection, fdc1004.MAKE_READY)
            step, self._running = self.plan.steps[self._position], None
            self._running = self._start_conversion(legs, selection, step, (step.select,))

    def _start_conversion(
        self, legs: Legs, selection: int, step: ConversionStep, select: tuple[Transaction, ...]
    ) -> Conversion:
        """Select lines and start the converters of the legs."""
        for _ in range(MAX_ATTEMPTS if legs else 0):
            if self._bus.exchange(selection, (*select, step.trigger)) is not None:
                return Conversion(self.clock.now_ns(), legs, bool(select))
        return Conversion(self.clock.now_ns(), [], bool(select))

    def _finish_conversion_and_start_next(self) -> None:
        """Wait for the running conversion, start the next one, and read the finished one meanwhile."""
        steps, position, finished = self.plan.steps, self._position, self._running
        assert finished is not None
        following_position = (position + 1) % len(steps)
        step, following, ends = steps[position], steps[following_position], following_position == 0
        alone = self._check_while_converting(step, finished)
        legs, selection = self._active_legs()
        all_active = len(legs) == len(self.legs)
        failed = {} if all_active else {leg: leg.outcome for leg in self.legs if leg.outcome is not _OK}
        if failed and ends:
            set_up_failed_legs(self._bus, self.legs, following)
            legs, selection = self._active_legs()
        if legs:  # connect them while they convert; if that fails, `_start_conversion` tries again
            self._bus.exchange(selection, ())
        asks_first = self._wait_and_tell_if_poll_comes_first(finished)
        all_done = False
        if asks_first:
            converting = [leg for leg in finished.legs if leg not in failed]
            all_done = self._mark_late_as_failed(step, converting)
            failed |= {leg: leg.outcome for leg in converting if leg.outcome is not _OK}
            legs, selection = self._active_legs()
        select = following.select_changes if finished.legs else (following.select,)
        self._running = self._start_conversion(legs, selection, following, select)
        self._discard(slice(None), step, Reading.NO_ANSWER)
        read = finished.legs
        if failed:
            self._discard_failed(step, failed, alone)
            read = [leg for leg in finished.legs if leg not in failed]
        if read:
            if not asks_first and self._running.legs:
                all_done = self._bus.poll(selection, step.done) is _OK
            if ends:  # the one whose channel is read back is still connected then
                read = sorted(read, key=partial(is_, self._leg_of_mux_check()))
            self._read_out(step, following, read, finished.t_start_ns, all_done=all_done)
        self._position = following_position
        if ends:
            self._end_scan()

    def _check_while_converting(self, step: ConversionStep, running: Conversion) -> LegConnection | None:
        """Read back lines and settings in their turn; return the leg that was asked alone for its lines."""
        alone = self._leg_asked_alone(step)
        if alone is not None:
            self._check_lines_of_leg(alone, step)
        is_turn = self._position == self._n_scans % len(self.plan.steps)
        if self._check_all or is_turn:
            self._check_settings(step, running)
        return alone

    def _leg_of_mux_check(self) -> LegConnection | None:
        """Return the leg with which the mux is read back in this scan; None for none."""
        turn, skipped = divmod(self._n_scans, 1 if self._check_all else _ALONE_EVERY)
        return None if skipped or len(self.legs) == 1 else self.legs[turn % len(self.legs)]

    def _discard_failed(self, step: ConversionStep, failed: Outcomes, alone: LegConnection | None) -> None:
        """Discard the readings of failed legs in a step, and all before it of those whose check covers the scan."""
        ends = step is self.plan.steps[-1]
        for leg, outcome in failed.items():
            checked = ends or leg is alone or (not self._check_all and outcome is Reading.MISCONFIGURED)
            self._discard(leg.row, None if checked else step, outcome)

    def _wait_and_tell_if_poll_comes_first(self, running: Conversion) -> bool:
        """Wait for the end; return whether to ask before the next trigger: if it clears DONE bits, or once a second."""
        wait_factor, asks_first = 1.0, False
        if self._position == 0 and (now_ns := self.clock.now_ns()) >= self._lateness_due_ns:
            self._lateness_due_ns, asks_first = now_ns + _LATENESS_PERIOD_NS, True
        for leg in running.legs:
            wait_factor = max(wait_factor, leg.timing.wait_factor)
            asks_first |= not leg.timing.keeps_done_bit
        self.clock.sleep_until_ns(running.t_start_ns + round(self.plan.conversion_wait_ns * wait_factor))
        return asks_first

    def _read_out(
        self, step: ConversionStep, following: ConversionStep, legs: Legs, t_start_ns: int, *, all_done: bool
    ) -> None:
        _, t_ns, capacitance_pf, readings = self.latest
        asked, answers = Legs(), list[bytes]()
        for leg in legs if all_done else ():
            by_value = leg.in_scan and not leg.timing.reads_whole_result
            if by_value and (answer := self._bus.exchange(leg.selection, step.read_value)) is not None:
                asked.append(leg)
                answers += answer
        values = iter(fdc1004.decode_results(answers, len(asked)))
        for leg in legs:
            if not leg.in_scan:  # left out since the conversion began
                continue
            if leg in asked:
                reading, pf = next(values)
            else:  # failed, or has to be asked first, or read whole; a second time if that fails
                whole = leg.timing.reads_whole_result
                reading, pf = self._bus.read_result(leg.selection, step, whole=whole, is_done=all_done)
            at = leg.row, step.element
            capacitance_pf[at] = pf
            readings[at] = reading
            if reading in CONVERTED:
                excess_ns = round((leg.timing.wait_factor - 1) * self.plan.conversion_wait_ns)
                t_ns[at] = t_start_ns + (self.plan.conversion_ns + excess_ns) // 2
            else:
                leg.outcome = reading
                leg.unfinished = following if reading is Reading.NOT_READY else None

    def _mark_late_as_failed(self, step: ConversionStep, legs: Legs) -> bool:
        """Mark each leg as failed whose conversion has not finished before the next trigger; return if the others have.

        A chip that clears DONE on a trigger is polled before it. If another chip's answer is lost, it is polled again.
        """
        selection = sum(leg.selection for leg in legs)
        if not legs or self._bus.poll(selection, step.done) is _OK:
            return True
        for leg in legs:
            outcome = self._bus.poll(leg.selection, step.done)
            if leg.outcome is _OK and (outcome is Reading.NOT_READY or not leg.timing.keeps_done_bit):
                leg.outcome = outcome
                leg.unfinished = step
        return not all(leg.timing.keeps_done_bit for leg in legs)

    def _check_settings(self, step: ConversionStep, running: Conversion) -> None:
        """Read back line and chip settings during a conversion; mark each leg as failed whose check fails."""
        checks = (step.select_check,) if running.lines_selected else ()
        for check in (*checks, *step.setting_checks):
            legs, selection = self._active_legs()
            if legs and self._bus.check(selection, check) is not _OK:
                for leg in legs:
                    leg.outcome = self._bus.check(leg.selection, check)

    def _leg_asked_alone(self, step: ConversionStep) -> LegConnection | None:
        """Return the leg that is asked for the lines of a step by itself, as a wired AND may hide wrong ones.

        One leg a scan, or in four where that takes time, in a diagonal element: these have all rows and columns.
        """
        turn, skipped = divmod(self._n_scans, 1 if self._check_all else _ALONE_EVERY)
        visit, row = divmod(turn, len(self.legs))
        element = visit % ROWS * (ROWS + 1)
        if skipped or len(self.legs) == 1 or element != step.element:
            return None
        return self.legs[row]

    def _check_lines_of_leg(self, leg: LegConnection, step: ConversionStep) -> None:
        """Ask a leg alone for its lines; leave it out if they are wrong twice."""
        if not leg.in_scan or leg.outcome is not _OK:
            return
        check = step.select_check
        if (
            self._bus.check(leg.selection, check) is not _OK
            and self._bus.check(leg.selection, check) is Reading.MISCONFIGURED
        ):
            leg.doubted = step
            leg.leave_scan(Reading.MISCONFIGURED, self.clock.now_ns())

    def _end_scan(self) -> None:
        """Read back the mux, count the readings missed in the scan, and search for legs that were left out of it."""
        in_turn = self._leg_of_mux_check()
        if in_turn is not None and in_turn.in_scan and in_turn.outcome is _OK:
            try:
                leave_out_mixed_up_legs(self._bus, in_turn, self.legs, self.clock)
            except I2cTimeoutError:
                self._leave_out_stuck_legs()
        self._n_scans += 1
        all_in_scan = True
        for leg, readings in zip(self.legs, self.latest.reading, strict=True):
            if leg.in_scan and (leg.is_suspect or readings.any()):
                leg.count_misses(readings.tolist(), self.clock.now_ns())
            if not leg.in_scan:
                self._discard(leg.row, None, leg.outcome)
                all_in_scan = False
        if not all_in_scan:
            probe_due_legs(self._bus, self.legs, self._set_up, self.clock)

    def _time_late_leg(self) -> None:
        """Time the converter of a leg that was late or has just been found; discards running conversions.

        At most one leg a second. One that is late again and again is left out soon, and keeps no other waiting.
        """
        if self.clock.now_ns() < self._timing_due_ns:
            return
        late = next((leg for leg in self.legs if leg.in_scan and not leg.is_timed), None)
        if late is not None:
            self._timing_due_ns = self.clock.now_ns() + _TIMING_PAUSE_NS
            self._running = None
            time_converter(self._bus, late, self.clock)
