"""Scanners of a bus and of the robot: conversions in sequence, restarts, retries of missing legs, frames.

All legs of a bus are read together (`leg_group.py`). A line that is held low blocks the bus: the leg that holds it is
left out at once, and all conversions restart. Where a conversion leaves no time for the checks of lines and settings,
they are made in one step a scan, in turn. Once a second all legs are asked whether a conversion is done before the next
one starts: one that is late would get the lines of the next element, which nothing else shows. Its converter is timed
again between two scans. There temperature sensors are read every ten seconds, too; the converter that has one shows
only by a timing that it is late, and so one of them is timed with each.

Several buses convert at the same time, each in a thread of its own: the adapter's system call releases the interpreter.
A frame is complete when the slowest bus is. A bus that is later than the first one by a whole conversion, such as one
on which a line is held low, does not delay the others: they go on with its last readings, until it is there again.
"""

import contextlib
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ThreadPoolExecutor, wait
from typing import Any

import numpy as np

from footsense.acquisition.leg_bus import BusStuckError, BusTiming, LegBus, bus_timing, checks_that_fit
from footsense.acquisition.leg_connection import LegConnection, probe_due_legs, probe_leg
from footsense.acquisition.leg_group import LegGroup
from footsense.acquisition.scan_plan import ScanPlan
from footsense.frames import ROWS, CapFrame, Reading, Vector
from footsense.ports import Clock

#: Attempts of a conversion on a bus with stuck lines.
_CONVERSION_ATTEMPTS = 2
#: Period of the temperature readings, and least time between two timings of converters [ns]: each costs the legs of the
#: bus some conversions.
_TEMPERATURE_PERIOD_NS, _TIMING_PAUSE_NS = 10_000_000_000, 1_000_000_000
#: Time between two questions whether a leg is late [ns]: each takes as long as a transaction.
_LATENESS_PERIOD_NS = 1_000_000_000


class BusScanner:
    """Scanner of all legs on one I2C bus: makes the next conversion of every leg per call.

    Args:
        bus: The bus.
        clock: The time that the bus lives in.
        channels: Channel of each leg by name, in the order of the rows of its scans.
        plan: The conversions of one scan.

    Attributes:
        clock: As given.
        plan: As given.
        legs: The connections to the legs, in the order of the rows.
        latest: Their latest readings, written over element by element.
        bus_timing: Cost of transactions and limits of the scan, measured by `start`; None if no leg answered.
        n_late_discards: Number of times that the loop was delayed for so long that conversions were discarded.
    """

    def __init__(self, bus: LegBus, clock: Clock, channels: dict[str, int], plan: ScanPlan) -> None:
        self._bus = bus
        self.clock = clock
        self.plan = plan
        self.legs = tuple(
            LegConnection(name, channel, row) for row, (name, channel) in enumerate(channels.items())
        )
        self._group = LegGroup(self.legs, bus, clock, plan)
        self.latest = self._group.latest
        self._sequence = 0
        self._position = 0
        self._n_scans = 0
        self._check_all = True
        self._late_ns = 2 * plan.conversion_wait_ns
        self._asked_alone: LegConnection | None = None
        self._asked_element = 0
        self._temperature_due_ns = self._timing_due_ns = self._lateness_due_ns = 0
        self._n_temperatures = 0
        self._timed: LegConnection | None = None  # last
        self.bus_timing: BusTiming | None = None
        self.n_late_discards = 0

    def start(self) -> None:
        """Measure the bus timing, and set up every leg's chips; missing legs are tried again later.

        Raises:
            HardwareError: The mux does not answer, or a line is stuck: no leg can be reached.
        """
        costs = self._bus.measure_costs(self.clock)
        if costs is not None:
            self.bus_timing = bus_timing(costs, self.plan, len(self.legs))
            self._late_ns = 2 * self.bus_timing.lower_bounds.scan_period_bound_ns // len(self.plan.steps)
            self._check_all, read_back = checks_that_fit(costs, self.plan, len(self.legs))
            self._group.mux_read_back = self._bus.read_back if read_back else None
        for leg in self.legs:
            leg.retry_at_ns = 0
            probe_leg(self._bus, leg, self.legs, self.plan, self.clock)
            if leg.in_scan:
                with contextlib.suppress(BusStuckError):  # the leg is left out
                    self._group.measure_conversion_time(leg)

    def read_next_step(self) -> CapFrame:
        """Finish the next conversion of every leg; return its frame, with a copy of the latest readings.

        The conversion after it is then running.
        """
        position = self._position
        for _ in range(_CONVERSION_ATTEMPTS):
            try:
                if position == 0:
                    self._read_temperatures()
                    self._time_late_leg()
                self._start_missing_conversion()
                self._finish_conversion()
            except BusStuckError:
                self._position = position
                self._group.running = None
            else:
                break
        else:
            for leg in self.legs:
                reason = Reading.DELAYED if leg.in_scan else leg.outcome
                for result in self.plan.steps[position].results:
                    self._group.discard(leg.row, result.element, reason)
        _, t_ns, capacitance_pf, reading = self.latest
        frame = CapFrame(self._sequence, t_ns.copy(), capacitance_pf.copy(), reading.copy())
        self._sequence += 1
        return frame

    def disconnect_legs(self) -> None:
        """Disconnect all legs from the bus: select no mux channel."""
        self._bus.disconnect_legs()

    def _start_missing_conversion(self) -> None:
        """Start a conversion if none runs, or if the loop was delayed for too long."""
        running = self._group.running
        is_late = running is not None and self.clock.now_ns() > running.t_start_ns + self._late_ns
        self.n_late_discards += is_late
        if running is None or is_late:
            self._group.restart(self.plan.steps[self._position])

    def _finish_conversion(self) -> None:
        steps, n = self.plan.steps, self._position
        self._position = (n + 1) % len(steps)
        ask_first = n == 0 and self.clock.now_ns() >= self._lateness_due_ns
        if ask_first:
            self._lateness_due_ns = self.clock.now_ns() + _LATENESS_PERIOD_NS
        alone = None
        if len(self.legs) > 1 and any(result.element == self._asked_element for result in steps[n].results):
            alone = self._asked_alone
        self._group.finish_conversion_and_start_next(
            steps[n],
            steps[self._position],
            checked=self._check_all or n == self._n_scans % len(steps),
            in_turn=not self._check_all,
            ask_first=ask_first,
            alone=alone,
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
            probe_due_legs(self._bus, self.legs, self.plan, self.clock)
        running = self._group.running
        if running is not None and not running.legs:
            # A leg that was found meanwhile begins with a whole conversion, not with the rest of a wait.
            self._group.running = None

    def _read_temperatures(self) -> None:
        """Read the temperature of all converters if that is due; discards running conversions.

        The converters lose their settings by it, and get them again when conversions restart.
        """
        thermometer = self.plan.board.thermometer
        if thermometer is None or self.clock.now_ns() < self._temperature_due_ns:
            return
        if not self._group.active_legs()[0]:
            return
        self._temperature_due_ns = self.clock.now_ns() + _TEMPERATURE_PERIOD_NS
        self._group.read_temperatures(thermometer)
        self.legs[self._n_temperatures % len(self.legs)].is_timed = False
        self._n_temperatures += 1

    def _time_late_leg(self) -> None:
        """Time the converter of a leg that was late or has just been found; discards running conversions.

        At most one leg a second, and the same one twice in a row only if it is the only one.
        """
        if self.clock.now_ns() < self._timing_due_ns:
            return
        late = [leg for leg in self.legs if leg.in_scan and not leg.is_timed]
        if late:
            self._timing_due_ns = self.clock.now_ns() + _TIMING_PAUSE_NS
            self._timed = next((leg for leg in late if leg is not self._timed), late[0])
            self._group.measure_conversion_time(self._timed)


class _SequentialExecutor(Executor):
    """Executor that runs each task at once in the calling thread: for one bus, and for simulated buses."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:  # noqa: ANN401 - as its base
        done: Future[Any] = Future()
        done.set_result(fn(*args, **kwargs))
        return done


class RobotScanner:
    """Frame source of a robot whose chips are on one or more I2C buses.

    Args:
        buses: One scanner a bus; the rows of a frame are the legs of the first bus, then of the second, and so on.
        threads: Whether each bus gets a thread; without, they are read in turn, as in virtual time.
    """

    def __init__(self, buses: Sequence[BusScanner], *, threads: bool = False) -> None:
        self._buses = tuple(buses)
        self._sequence = 0
        self._pool: Executor = _SequentialExecutor()
        if threads and len(self._buses) > 1:
            self._pool = ThreadPoolExecutor(len(self._buses), thread_name_prefix="i2c")
        # Readings on their way, with the time at which they are complete [ns], and the last that have arrived.
        self._pending: list[Future[tuple[CapFrame, int]] | None] = [None] * len(self._buses)
        self._latest = [bus.latest for bus in self._buses]
        self._grace_ns = (
            0 if len(self._buses) == 1 else max(bus.plan.conversion_wait_ns for bus in self._buses)
        )

    @property
    def legs(self) -> list[LegConnection]:
        """Connection states of all legs, in the order of the frame's rows."""
        return [leg for bus in self._buses for leg in bus.legs]

    @property
    def n_late_discards(self) -> int:
        """Number of times that conversions were discarded because the loop was delayed."""
        return sum(bus.n_late_discards for bus in self._buses)

    def temperature_c(self) -> Vector:
        """Return the temperature of each leg's converter [degC], shape (legs,), at most ten seconds old.

        NaN for a board without a sensor, and for a leg that is out of the scan.
        """
        return np.array([leg.temperature_c for leg in self.legs])

    def start(self) -> None:
        """Find and set up the chips of all buses.

        Raises:
            HardwareError: The mux of a bus does not answer.
        """
        for bus in self._buses:
            bus.start()
        if isinstance(self._pool, _SequentialExecutor):
            ready_ns = max(bus.clock.now_ns() for bus in self._buses)
            for bus in self._buses:
                bus.clock.sleep_until_ns(ready_ns)

    def read(self) -> CapFrame:
        """Make the next conversion of every leg; return its readings with the latest ones of all other elements.

        The first frame is a whole scan.
        """
        for _ in range(1 if self._sequence else len(self._buses[0].plan.steps)):
            if len(self._buses) == 1:
                self._latest[0] = self._buses[0].read_next_step()
            else:
                self._read_buses()
        _, *of_buses = zip(*self._latest, strict=True)
        t_ns, capacitance_pf, reading = map(np.concatenate, of_buses)
        frame = CapFrame(self._sequence, t_ns, capacitance_pf, reading)
        self._sequence += 1
        return frame

    def _read_buses(self) -> None:
        """Start reading all buses that are not busy, and copy the readings that are complete."""
        fresh = []
        for n, bus in enumerate(self._buses):
            if self._pending[n] is None:
                self._pending[n] = self._pool.submit(_read_with_completion_time, bus)
                fresh.append(n)
        running = [pending for n in fresh if (pending := self._pending[n]) is not None]
        _, others = wait(running, return_when=FIRST_COMPLETED)
        wait(others, timeout=self._grace_ns * 1e-9 if self._sequence else None)
        ready_ns = {
            n: each.result()[1] for n, each in enumerate(self._pending) if each is not None and each.done()
        }
        latest_ns = min(ready_ns[n] for n in fresh if n in ready_ns) + self._grace_ns
        now_ns = max(
            t_ns for n, t_ns in ready_ns.items() if n in fresh and (t_ns <= latest_ns or not self._sequence)
        )
        for n, t_ns in ready_ns.items():
            pending = self._pending[n]
            if t_ns <= now_ns and pending is not None:
                self._latest[n] = pending.result()[0]
                self._pending[n] = None

    def close(self) -> None:
        """End the threads of the buses, and disconnect all legs."""
        self._pool.shutdown()
        for bus in self._buses:
            bus.disconnect_legs()


def _read_with_completion_time(bus: BusScanner) -> tuple[CapFrame, int]:
    """Return the next readings of a bus, and the time at which they were complete [ns]."""
    return bus.read_next_step(), bus.clock.now_ns()
