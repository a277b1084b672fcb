"""Scanner of a bus whose converters run freely: bursts of results, their stamps, searches of missing legs, frames.

Nothing is triggered, and nothing waited for: a burst has the latest results of all elements of a leg. Each leg is read
twice for a frame where the bus carries it, else once. The status before and behind it shows which conversions they are
of (`boards/stage_tracker.py`). A burst that fails is made once more; after that the leg has no readings until the next.

A leg that is found is reset, converts its reference, while the others are read, and then its elements
(`boards/ad7147.py`). Its settings are read back in turn, one block of registers a scan, and at once if a status does
not fit. One that has lost them is started again; one that holds them and does not convert is reset. Each leg has an
address of its own, or a channel of a multiplexer, whose selection is read back once a scan.
"""

from collections.abc import Mapping
from operator import sub

import numpy as np

from firmware_interface.chips.ad7147 import RANGE_START_PF
from footsense.acquisition.boards import ad7147
from footsense.acquisition.boards.board import ReadBackCheck
from footsense.acquisition.boards.stage_tracker import Span, StageTracker
from footsense.acquisition.bus_timing import BusTiming, measure_bus_timing
from footsense.acquisition.leg_bus import MAX_ATTEMPTS, LegBus
from footsense.acquisition.leg_connection import (
    LegConnection,
    leave_out_mixed_up_legs,
    leave_out_stuck_legs,
    probe_due_legs,
    probe_leg,
)
from footsense.acquisition.scan_plan import FreeRunningPlan
from footsense.errors import I2cError, I2cTimeoutError
from footsense.frames import ELEMENTS, CapFrame, Reading
from footsense.ports import Clock, I2cBus

_OK = Reading.OK
#: Codes near the start of their range at which a foot is given other ranges: 0.12 pF, of a fast load in a scan.
_NEAR_RANGE_START = frozenset(range(1, 500))
#: Scans in a row with a missing reading before a leg is left out: 70 ms.
_MISSED_SCANS_BEFORE_LEAVING = 10
#: Times in a row that a status may not fit though the settings are held, before the chip is reset.
_MOST_DOUBTS = 3
#: Scans in which a leg is read and has no new result, after which conversions count as not finishing.
_SILENT_SCANS = 3
#: Stages from one read of a leg to the next, by the reads for a frame: few enough that none ends twice, and not a whole
#: number, so that reads at ever other times within a stage narrow when it ends.
_STAGES_PER_READ = {1: 7.4, 2: 4.4}
#: Of reads that are late so many in a row wait for a part of a stage, and as many do not, so that they come at other
#: times within a stage, and within a sequence, whatever their pace is.
_LATE_READS, _LATE_WAIT_STAGES = 5, 0.8
#: Shortest time of a bit of a bus over the measured one [1].
_BIT_MEASURED_REL = 0.85
#: Scans that a first frame and a leg that was found are waited for: of the reference, unused ones, and those that find
#: the time of a stage.
_START_SCANS = 30
#: Time from the reset of a chip until it takes settings [ns].
_RESET_NS = 1_000_000


class FreeLeg(LegConnection):
    """Connection of a leg whose converter runs freely.

    Args:
        name, channel, row: As of `LegConnection`.
        address: Address of its converter.
        plan: The scan.

    Attributes:
        address: As given.
        places: Places of the elements that its stages convert in the entries of a frame.
        is_whole: Whether each of its elements has a reading.
        burst: Read of its results, status first.
        status: Read of the status.
        reference: Read of the results of its reference.
        checks: Checks of its settings.
        offset: Offset of its converter [steps], with which its reference is converted.
        offsets: Offset of each stage of its elements [steps].
        has_ranges: Whether its elements have been read, and given their ranges.
        calibration: What its codes are worth; None while it converts its reference.
        tracker: Counts its conversions.
        is_started: Whether it converts its elements, as far as is known.
        ready_ns: Time at which its reference or unused results have been converted, or of its latest result [ns].
        due_ns: Time from which on missing readings count: of its last status, or when results should be there [ns].
        converts: Whether its last status fitted: its conversions end, and missing readings do not count.
        n_doubts: Times in a row that its status did not fit.
        n_silent: Bursts in a row without a new result, when there should be one.
    """

    def __init__(self, name: str, channel: int, row: int, address: int, plan: FreeRunningPlan) -> None:
        offsets = (ad7147.FIRST_OFFSET,) * ELEMENTS
        checks = ad7147.element_sequence(offsets).checks(address)
        super().__init__(name, channel, row, checks[0].read, _MISSED_SCANS_BEFORE_LEAVING)
        self.offset, self.offsets, self.has_ranges = ad7147.FIRST_OFFSET, offsets, False
        self.address = address
        self.places = [row * ELEMENTS + element for element in ad7147.ORDER]
        self.is_whole = False
        self.burst = ad7147.read_results(address, ELEMENTS)
        self.status = ad7147.read_status(address)
        self.reference = ad7147.read_results(address, ad7147.N_REFERENCE_STAGES)
        self.checks = checks
        self.calibration: ad7147.Calibration | None = None
        self.tracker = StageTracker(
            plan.n_conversions,
            plan.conversion_ns,
            plan.conversion_wait_ns / plan.conversion_ns - 1,
            ad7147.N_UNUSED_SEQUENCES * plan.n_conversions,
        )
        self.is_started = self.converts = False
        self.ready_ns = self.due_ns = self.n_doubts = self.n_silent = 0


class FreeScanner:
    """Frame source of all legs on one I2C bus whose converters run freely.

    Args:
        bus, clock: The bus, and the time that it lives in.
        channels: Channel of each leg by name, in the order of the rows of its frames.
        addresses: Address of the converter of each leg.
        plan: The scan.

    Attributes:
        clock, plan: As given.
        legs: The connections to the legs, in the order of the rows.
        bus_timing: Cost of transactions and limits of the scan, measured by `start`; None if no leg answered.
        frames_per_scan: Frames in a scan: one.
        reads_per_frame: Reads of each leg for a frame: two where the bus carries that.
        complete_ns: Time at which the last frame was complete [ns].
        n_late_discards: Number of times that the loop was delayed by more than a scan, so that results were lost.
    """

    def __init__(
        self,
        bus: LegBus,
        clock: Clock,
        channels: Mapping[str, int],
        addresses: Mapping[str, int],
        plan: FreeRunningPlan,
    ) -> None:
        self._bus = bus
        self.clock = clock
        self.plan = plan
        self.legs = tuple(
            FreeLeg(name, channel, row, addresses[name], plan)
            for row, (name, channel) in enumerate(channels.items())
        )
        # Middles of their latest conversions [ns], their codes, and for an element without one the reason; and the same
        # memory as arrays of numpy, in which to set an entry takes longer.
        n = len(self.legs) * ELEMENTS
        self._entries = (
            memoryview(bytearray(8 * n)).cast("d"),
            memoryview(bytearray(2 * n)).cast("H"),
            memoryview(bytearray([Reading.NO_ANSWER] * n)),
        )
        self._middle_ns, self._codes, self._missing = (
            np.asarray(each).reshape(-1, ELEMENTS) for each in self._entries
        )
        self._gain_rel, self._offset_pf = np.ones((len(self.legs), 1)), np.ones((len(self.legs), ELEMENTS))
        self.bus_timing: BusTiming | None = None
        self.frames_per_scan = self.reads_per_frame = 1
        self.complete_ns = self.n_late_discards = 0
        self._longest_delay_ns = plan.scan_ns
        self._bit_ns: float = ad7147.SHORTEST_BIT_NS
        self._read_ns = {n: round(stages * plan.conversion_ns) for n, stages in _STAGES_PER_READ.items()}
        self._due_ns = self._sequence = self._n_reads = self._n_scans = 0

    def start(self) -> None:
        """Measure the bus timing, and find the legs; missing ones are tried again later.

        Raises:
            HardwareError: The multiplexer does not answer, or a line is stuck: no leg can be reached.
        """
        addresses = [leg.address for leg in self.legs]
        self.bus_timing = measure_bus_timing(self._bus, self.clock, self.plan, len(self.legs), addresses)
        if self.bus_timing is not None:
            self.reads_per_frame = 2 if self.bus_timing.all_checks_fit else 1
            self._longest_delay_ns = self.bus_timing.lower_bounds.scan_period_bound_ns
            self._bit_ns = max(_BIT_MEASURED_REL * 1e9 / self.bus_timing.bus_hz, ad7147.SHORTEST_BIT_NS)
        for leg in self.legs:
            probe_leg(self._bus, leg, self.legs, self._set_up, self.clock)
        self._due_ns = self.clock.now_ns()

    def read(self) -> CapFrame:
        """Return the latest readings of every leg, after the next bursts of each.

        Before the first frame each leg has been waited for that answers.
        """
        for _ in range(self.reads_per_frame):
            self._read_legs()
        if self._sequence == 0:
            end_ns = self.clock.now_ns() + _START_SCANS * self.plan.scan_ns
            while self.clock.now_ns() < end_ns and any(map(self._has_no_reading, self.legs)):
                self._read_legs()
        frame = self.latest
        self._sequence, self.complete_ns = self._sequence + 1, self.clock.now_ns()
        return frame

    @property
    def latest(self) -> CapFrame:
        """Latest readings of all elements."""
        reading, capacitance_pf = ad7147.decode(self._codes, self._gain_rel, self._offset_pf)
        if not all(leg.is_whole for leg in self.legs):
            np.copyto(reading, self._missing, where=self._missing > 0)
        return CapFrame(self._sequence, np.rint(self._middle_ns).astype(np.int64), capacitance_pf, reading)

    def close(self) -> None:
        """Disconnect all legs from the bus: select no channel."""
        self._bus.disconnect_legs()

    def _has_no_reading(self, leg: FreeLeg) -> bool:
        return leg.in_scan and not leg.is_whole

    def _read_legs(self) -> None:
        """Read each leg when that is due; at the end of a scan make the checks and searches."""
        now_ns, first = self.clock.now_ns(), 0
        if now_ns > self._due_ns:  # a pace that the bus sets may be one of whole stages
            self.n_late_discards += now_ns - self._due_ns > self._longest_delay_ns
            waits = self._n_reads // _LATE_READS % 2
            self._due_ns = now_ns + waits * round(_LATE_WAIT_STAGES * self.plan.conversion_ns)
            first = self._n_reads % len(self.legs)
        self.clock.sleep_until_ns(self._due_ns)
        self._due_ns += self._read_ns[self.reads_per_frame]
        try:
            for leg in self.legs[first:] + self.legs[:first]:
                if leg.in_scan:
                    self._read_leg(leg)
            self._n_reads += 1
            if self._n_reads % self.reads_per_frame == 0:
                self._end_scan()
        except I2cTimeoutError:
            leave_out_stuck_legs(self._bus, self.legs, self.clock)
        for leg in self.legs:
            if not leg.in_scan:
                self._discard(leg, leg.outcome)

    def _discard(self, leg: FreeLeg, reading: Reading) -> None:
        """Discard the readings of a leg, and keep the reason for it; a code of 0 has no capacitance."""
        leg.outcome, leg.is_whole = reading, False
        self._middle_ns[leg.row], self._codes[leg.row], self._missing[leg.row] = 0, 0, reading

    def _read_leg(self, leg: FreeLeg) -> None:
        """Read the results of a leg, or its reference if that has been converted.

        Raises:
            I2cTimeoutError: A line is held low.
        """
        if leg.calibration is None:
            if self.clock.now_ns() >= leg.ready_ns:
                self._measure_reference(leg)
            return
        if not leg.is_started:
            self._start_elements(leg)
            return
        burst, status_ns = None, ad7147.STATUS_AFTER_BITS * self._bit_ns
        for _ in range(MAX_ATTEMPTS):
            try:
                connected, begin_ns = self._bus.connect(leg.selection), self.clock.now_ns()
                if burst is None:  # it clears the status
                    burst, between_ns = connected.transfer(leg.burst), self.clock.now_ns()
                    results_ns = ad7147.RESULTS_AFTER_STATUS_BITS * self._bit_ns
                    before_at = begin_ns + status_ns, between_ns - results_ns
                    begin_ns = between_ns
                status, end_ns = connected.transfer(leg.status), self.clock.now_ns()
            except I2cTimeoutError:
                raise
            except I2cError:
                self._bus.forget_selection()
            else:
                self._take(leg, burst, before_at, status, (begin_ns + status_ns, end_ns))
                return
        leg.tracker.miss(self.clock.now_ns())
        leg.converts = False
        self._discard(leg, Reading.NO_ANSWER)

    def _take(
        self,
        leg: FreeLeg,
        burst: bytes,
        before_at: tuple[float, float],
        status: bytes,
        behind_at: tuple[float, float],
    ) -> None:
        """Store the results of a burst whose conversions are known; check the settings if its status does not fit.

        Spans as of the tracker's `results`.
        """
        before, codes, behind = ad7147.read_words(burst, status)
        numbers, time_ns, stage_ns = leg.tracker.results(before, before_at, behind, behind_at)
        leg.converts = not leg.tracker.is_doubtful
        if leg.tracker.is_doubtful:
            self._check_doubtful(leg)
            return
        leg.due_ns = round(behind_at[1])
        if not numbers:
            # Time in which nobody asked it does not count.
            leg.n_silent += behind_at[1] > leg.ready_ns
            if leg.n_silent > _SILENT_SCANS * self.reads_per_frame:
                self._discard(leg, Reading.NOT_READY)
            return
        places, (middles_ns, latest_codes, missing) = leg.places, self._entries
        for number in numbers:
            stage = number % ELEMENTS
            at = places[stage]
            middles_ns[at], latest_codes[at] = time_ns + number * stage_ns, codes[stage]
        if not leg.is_whole:
            for number in numbers:
                missing[places[number % ELEMENTS]] = _OK
            leg.is_whole = not self._missing[leg.row].any()
        leg.outcome, leg.n_doubts, leg.n_silent = _OK, 0, 0
        leg.ready_ns = leg.due_ns

    def _check_doubtful(self, leg: FreeLeg) -> None:
        """Ask a leg whose status did not fit for its power settings, and start it again if they are lost.

        One that holds them and does not convert is left out: it is reset when it is tried again.
        """
        leg.n_doubts += 1
        held = self._check(leg, leg.checks[0])
        if held is Reading.MISCONFIGURED:
            return
        if leg.n_doubts > _MOST_DOUBTS:
            leg.leave_scan(Reading.NOT_READY, self.clock.now_ns())
        elif held is _OK:
            leg.tracker.trust()

    def _check(self, leg: FreeLeg, check: ReadBackCheck) -> Reading:
        """Read back settings of a leg, and start it again if they are others, twice; return whether they are held."""
        held = _OK
        for _ in range(MAX_ATTEMPTS):
            held = self._bus.check(leg.selection, check)
            if held is not Reading.MISCONFIGURED:
                return held
        self._discard(leg, held)
        self._start_elements(leg)
        return held

    # ------------------------------------------------------------ starting a leg

    def _set_up(self, bus: I2cBus, leg: FreeLeg) -> Reading:
        """Check and reset the chip of a leg, and let it convert its reference."""
        ad7147.check_identity(bus, leg.address)
        bus.transfer(ad7147.reset(leg.address))
        self.clock.sleep_until_ns(self.clock.now_ns() + _RESET_NS)
        for write in ad7147.reference_sequence(leg.offset).start(leg.address):
            bus.transfer(write)
        self._await_reference(leg)
        return _OK

    def _await_reference(self, leg: FreeLeg) -> None:
        leg.calibration, leg.is_started = None, False
        n_stages = (ad7147.N_UNUSED_SEQUENCES + 1) * ad7147.N_REFERENCE_STAGES
        leg.ready_ns = self.clock.now_ns() + n_stages * self.plan.conversion_wait_ns
        leg.due_ns = leg.ready_ns + _START_SCANS * self.plan.scan_ns

    def _measure_reference(self, leg: FreeLeg) -> None:
        """Read what the codes of a chip are worth, and start the conversion of its elements."""
        answers = self._bus.exchange(leg.selection, (leg.reference,))
        measured = (
            Reading.NO_ANSWER if answers is None else ad7147.reference_calibration(answers[0], leg.offset)
        )
        if isinstance(measured, Reading):  # with the next sequence
            self._discard(leg, measured)
            n_stages = ad7147.N_REFERENCE_STAGES
            leg.ready_ns = self.clock.now_ns() + (n_stages + 1) * self.plan.conversion_wait_ns
        elif why := ad7147.reference_fault(measured):
            leg.leave_scan(Reading.MISCONFIGURED, self.clock.now_ns(), why)
        elif abs((offset := ad7147.best_offset(measured)) - leg.offset) > 1:
            leg.offset, leg.has_ranges = offset, False
            self._set_offsets(leg, (offset,) * ELEMENTS)
            self._bus.exchange(leg.selection, ad7147.reference_sequence(offset).start(leg.address))
            self._await_reference(leg)
        else:
            leg.calibration = measured
            self._decode_by(leg, measured)
            self._start_elements(leg)

    def _start_elements(self, leg: FreeLeg) -> None:
        """Configure the sequence of the elements, and start it; if that fails, the next frame tries again."""
        leg.is_started = False
        *settings, restart = ad7147.element_sequence(leg.offsets).start(leg.address)
        if self._bus.exchange(leg.selection, tuple(settings)) is None:
            return
        begin_ns = self.clock.now_ns()
        if self._bus.exchange(leg.selection, (restart,)) is None:
            return
        leg.tracker.start(Span(begin_ns, self.clock.now_ns()))
        # The status still has bits of the sequence before.
        if self._bus.exchange(leg.selection, (leg.status,)) is None:
            return
        leg.tracker.miss(self.clock.now_ns())
        n_unused = ad7147.N_UNUSED_SEQUENCES * self.plan.n_conversions
        leg.ready_ns = self.clock.now_ns() + n_unused * self.plan.conversion_wait_ns
        leg.is_started, leg.n_doubts, leg.n_silent = True, 0, 0

    def _set_offsets(self, leg: FreeLeg, offsets: tuple[int, ...]) -> None:
        leg.offsets, leg.checks = offsets, ad7147.element_sequence(offsets).checks(leg.address)

    def _set_ranges(self, leg: FreeLeg) -> None:
        """Let the range of each stage begin well below its element, and start anew with it.

        An element below its range when the leg is read first is taken as at the start of the range; later, as open.
        """
        measured, row = leg.calibration, leg.row
        own = self._entries[1][row * ELEMENTS : (row + 1) * ELEMENTS]
        is_near = not leg.has_ranges or not _NEAR_RANGE_START.isdisjoint(own)
        if measured is None or not is_near or not leg.is_whole:
            return
        read_pf = self.latest.capacitance_pf[row]
        if not leg.has_ranges:
            read_pf = np.where(np.asarray(own) == 0, RANGE_START_PF, read_pf)
        leg.has_ranges = True
        pairs = zip(leg.offsets, read_pf[list(ad7147.ORDER)].tolist(), strict=True)
        offsets = tuple(ad7147.lower_offset(measured, *pair) for pair in pairs)
        if max(map(sub, leg.offsets, offsets)) > 1:
            self._discard(leg, Reading.NOT_READY)
            self._set_offsets(leg, offsets)
            self._decode_by(leg, measured)
            self._start_elements(leg)

    def _decode_by(self, leg: FreeLeg, measured: ad7147.Calibration) -> None:
        self._gain_rel[leg.row] = measured.gain_rel
        self._offset_pf[leg.row, list(ad7147.ORDER)] = measured.step_pf * np.array(leg.offsets)

    # ------------------------------------------------------------ the end of a scan

    def _end_scan(self) -> None:
        """Make the checks in turn, count missed readings, and search for legs that were left out."""
        turn, row = divmod(self._n_scans, len(self.legs))
        self._n_scans += 1
        leg = self.legs[row]
        if leg.in_scan:
            leave_out_mixed_up_legs(self._bus, leg, self.legs, self.clock)
        if leg.in_scan and leg.is_started:
            self._check(leg, leg.checks[turn % len(leg.checks)])
            self._set_ranges(leg)
        now_ns, all_in_scan = self.clock.now_ns(), True
        for each in self.legs:
            if each.in_scan and now_ns > each.due_ns and (each.is_suspect or not each.is_whole):
                each.count_misses(() if each.converts else self._missing[each.row].tolist(), now_ns)
            all_in_scan &= each.in_scan
        if not all_in_scan:
            probe_due_legs(self._bus, self.legs, self._set_up, self.clock)
