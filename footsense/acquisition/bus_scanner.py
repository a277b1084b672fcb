"""Scanner of all legs of one I2C bus: conversions in sequence, restarts, and retries of missing legs.

Behind a mux that footsense drives, all legs are one group; behind a mux that the kernel drives, each leg is a group,
and the traffic of the others fills the time in which it converts. A group without a leg that converts waits as long as
the others do, so that a bus without legs keeps the pace of one with all.

A line that is held low blocks the bus: the leg that holds it is left out at once, and all conversions restart.

Where a conversion leaves no time for the checks of lines and settings, and always behind the kernel's mux, they are
made of one group in one step a scan, in turn. Every ten seconds, between two scans, temperature sensors are read, and
the converter of one leg is timed again, in turn: its clock may drift.
"""

import contextlib

import numpy as np

from footsense.acquisition.bus_timing import BusTiming, bus_timing, checks_that_fit
from footsense.acquisition.leg_connection import LegConnection
from footsense.acquisition.leg_group import BusReadings, BusStuckError, LegGroup
from footsense.acquisition.leg_search import probe_due_legs, probe_leg
from footsense.acquisition.scan_plan import ScanPlan
from footsense.acquisition.transports import Transport
from footsense.frames import ROWS, Reading
from footsense.ports import Clock

#: Attempts of a conversion on a bus with stuck lines.
_CONVERSION_ATTEMPTS = 2
#: Period of the temperature readings, and of the timing of a converter [ns]: each costs its legs two conversions.
_TEMPERATURE_PERIOD_NS = _TIMING_PERIOD_NS = 10_000_000_000


class BusScanner:
    """Scanner of all legs on one I2C bus: reads one element of every leg per call.

    Args:
        transport: The way to their chips.
        clock: The time that the bus lives in.
        channels: Channel of each leg by name, in the order of the rows of its scans.
        plan: The conversions of one scan.

    Attributes:
        clock: As given.
        legs: The connections to the legs, in the order of the rows.
        latest: Their latest readings, written over element by element.
        bus_timing: Cost of transactions and limits of the scan, measured by `start`; None if no leg answered.
        n_late_discards: Number of times that the loop was delayed for so long that conversions were discarded.
    """

    def __init__(self, transport: Transport, clock: Clock, channels: dict[str, int], plan: ScanPlan) -> None:
        self._transport = transport
        self.clock = clock
        self._plan = plan
        self.legs = tuple(
            LegConnection(name, channel, row) for row, (name, channel) in enumerate(channels.items())
        )
        shape = len(self.legs), len(plan.steps)
        self.latest = BusReadings(np.zeros(shape, np.int64), np.zeros(shape), np.zeros(shape, np.uint8))
        self.latest.discard((slice(None), slice(None)), Reading.NO_ANSWER)
        groups = (self.legs,) if transport.broadcasts else tuple((leg,) for leg in self.legs)
        self._groups = tuple(LegGroup(legs, transport, clock, plan, self.latest) for legs in groups)
        self._position = 0
        self._n_scans = 0
        self._check_all = transport.broadcasts
        self._late_ns = 2 * plan.conversion_wait_ns
        self._asked_alone: LegConnection | None = None
        self._asked_element = 0
        self._temperature_due_ns = 0
        self._timing_due_ns = 0
        self._timed: LegConnection | None = None  # last
        self._last_row = -1  # of the last one that was timed in its turn
        self.bus_timing: BusTiming | None = None
        self.n_late_discards = 0

    @property
    def conversion_wait_ns(self) -> int:
        """Conversion time of the slowest converter within its clock tolerance [ns]."""
        return self._plan.conversion_wait_ns

    def start(self) -> None:
        """Measure the bus timing, and set up every leg's chips; missing legs are tried again later.

        Raises:
            HardwareError: The mux does not answer, or a line is stuck: no leg can be reached.
        """
        costs = self._transport.measure_bus_costs(self.clock)
        if costs is not None:
            broadcasts = self._transport.broadcasts
            self.bus_timing = bus_timing(costs, self._plan, len(self.legs), kernel_mux=not broadcasts)
            self._late_ns = self.bus_timing.conversion_age_limit_ns + (
                0 if broadcasts else self._plan.conversion_wait_ns
            )
            checks, read_back = checks_that_fit(costs, self._plan, len(self.legs))
            self._check_all = broadcasts and checks
            if self._transport.reads_back is not None:
                read_back = self._transport.reads_back
            for group in self._groups:
                group.mux_read_back = self._transport.read_back if read_back else None
        for leg in self.legs:
            leg.retry_at_ns = 0
            probe_leg(self._transport, leg, self.legs, self._plan, self.clock)
            if leg.in_scan:
                with contextlib.suppress(BusStuckError):  # the leg is left out
                    self._group_of(leg).measure_conversion_time(leg)
        # Half a period beside the temperatures.
        self._timing_due_ns = self.clock.now_ns() + _TIMING_PERIOD_NS * 3 // 2

    def read_next_element(self) -> BusReadings:
        """Read the next element of every leg; return a copy of the latest readings of all elements.

        The conversion after it is then running.
        """
        position = self._position
        for _ in range(_CONVERSION_ATTEMPTS):
            try:
                if position == 0:
                    self._read_temperatures()
                    self._measure_conversion_time_if_due()
                self._start_missing_conversions()
                self._convert_next_element()
            except BusStuckError:
                self._position = position
                for group in self._groups:
                    group.running = None
            else:
                break
        else:
            for leg in self.legs:
                reason = Reading.DELAYED if leg.in_scan else leg.outcome
                self.latest.discard((leg.row, self._plan.steps[position].element), reason)
        t_ns, capacitance_pf, reading = self.latest
        return BusReadings(t_ns.copy(), capacitance_pf.copy(), reading.copy())

    def disconnect_legs(self) -> None:
        """Disconnect all legs from the bus: select no mux channel."""
        self._transport.disconnect_legs()

    def _start_missing_conversions(self) -> None:
        """Start conversions in groups without one; in all groups if the loop was delayed for too long."""
        now_ns, late = self.clock.now_ns(), False
        for group in self._groups:
            late |= group.running is not None and now_ns > group.running.t_start_ns + self._late_ns
        self.n_late_discards += late
        for group in self._groups:
            if late or group.running is None:
                group.restart(self._plan.steps[self._position])

    def _convert_next_element(self) -> None:
        """Read one element of every leg."""
        steps, n = self._plan.steps, self._position
        self._position = (n + 1) % len(steps)
        turn, due = divmod(self._n_scans, len(self._groups))
        alone = self._asked_alone if steps[n].element == self._asked_element else None
        in_turn = not self._check_all
        for number, group in enumerate(self._groups):
            checked = self._check_all or (number == due and n == turn % len(steps))
            together = alone if len(group.legs) > 1 else None
            group.finish_conversion_and_start_next(
                steps[n], steps[self._position], checked=checked, in_turn=in_turn, alone=together
            )
        if self._position == 0:
            self._n_scans += 1
            self._end_scan()

    def _end_scan(self) -> None:
        """Count the readings missed in the scan, and search for legs that were left out of it.

        Choose the leg that is asked for its lines by itself in the next scan: one a scan, in one of the diagonal
        elements, which have all rows and columns; one in four scans where that takes time.
        """
        turn, skipped = divmod(self._n_scans, 1 if self._check_all else 4)
        visit, row = divmod(turn, len(self.legs))
        self._asked_alone = None if skipped else self.legs[row]
        self._asked_element = visit % ROWS * (ROWS + 1)
        now_ns, missing = self.clock.now_ns(), False
        any_bad: list[bool] = np.any(self.latest.reading, axis=1).tolist()
        for leg, bad in zip(self.legs, any_bad, strict=True):
            if leg.in_scan and (bad or leg.is_suspect):
                leg.count_misses(self.latest.reading[leg.row], now_ns)
            missing |= not leg.in_scan
        if missing:
            probe_due_legs(self._transport, self.legs, self._plan, self.clock)
        for group in self._groups:
            if group.running is not None and not group.running.legs:
                # A leg that was found meanwhile begins with a whole conversion, not with the rest of a wait.
                group.running = None

    def _read_temperatures(self) -> None:
        """Read the temperature of all converters if that is due; discards running conversions.

        The converters lose their settings by it, and get them again when conversions restart.
        """
        thermometer = self._plan.board.thermometer
        if thermometer is None or self.clock.now_ns() < self._temperature_due_ns:
            return
        if not any(group.active_legs()[0] for group in self._groups):
            return
        self._temperature_due_ns = self.clock.now_ns() + _TEMPERATURE_PERIOD_NS
        started = [(group, group.start_temperatures(thermometer)) for group in self._groups]
        if any(legs for _, legs in started):
            wait_factor = max(leg.timing.wait_factor for _, legs in started for leg in legs)
            self.clock.sleep_until_ns(self.clock.now_ns() + round(wait_factor * thermometer.wait_ns))
        for group, legs in started:
            group.read_temperatures(thermometer, legs)

    def _measure_conversion_time_if_due(self) -> None:
        """Measure the conversion time of one converter, in turn, if that is due; discards running conversions.

        One that is not timed, or that does not finish since it was, is preferred, but not twice in a row.
        """
        if self.clock.now_ns() < self._timing_due_ns:
            return
        self._timing_due_ns = self.clock.now_ns() + _TIMING_PERIOD_NS
        present = [leg for leg in self.legs if leg.outcome in {Reading.OK, Reading.NOT_READY}]
        untimed = [leg for leg in present if not leg.is_timed and leg is not self._timed]
        others = [leg for leg in present if leg.row > self._last_row] or present
        if not present:
            return
        self._timed = untimed[0] if untimed else others[0]
        if not untimed:
            self._last_row = self._timed.row
        self._group_of(self._timed).measure_conversion_time(self._timed)

    def _group_of(self, leg: LegConnection) -> LegGroup:
        """Return the group of legs to which a leg belongs."""
        return next(group for group in self._groups if leg in group.legs)
