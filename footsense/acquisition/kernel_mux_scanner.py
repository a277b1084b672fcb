"""Scans the legs of one bus whose mux the kernel switches: every leg is an adapter of its own.

The driver i2c-mux-pca954x gives each channel a device file and selects it by itself, so nothing can be said to all
legs at once. Each leg is visited once per step: its next conversion is started, then its last result read. The visits
of the others fill the time that it converts.

    leg 1  lines, trigger k │ done? │ result k-1 │          ...                  │ lines, trigger k+1 │ ...
    leg 2                                        │ lines, trigger k │ done? │ result k-1 │ ...

What becomes of a leg that fails is as in `bus_scanner`. Lines and settings are asked for of one leg at one step a scan,
in turn: each leg acknowledges its own lines here, so that no leg misses what another one has answered.
"""

from firmware_interface import adg715
from footsense.acquisition.boards.board import CONVERTED, Check
from footsense.acquisition.bus_readings import BusScan
from footsense.acquisition.bus_timing import Timing, measure, timing
from footsense.acquisition.leg_connection import TEMPERATURE_PERIOD_NS, LegLink
from footsense.acquisition.scan_plan import ScanPlan, Step
from footsense.errors import BusError, BusTimeoutError
from footsense.frames import Reading
from footsense.ports import Clock, I2cBus, Transaction

_NAN = float("nan")


class KernelMuxScanner:
    """The legs behind one mux that the kernel drives.

    Args:
        adapters: Adapter of each leg by name, in the order of the rows of its scans.
        clock: The time that they live in.
        plan: What to do in one scan.

    Attributes:
        timing: What the bus costs and allows; None until a leg has answered.
        late_ticks: How often the scanner was held up for so long that what ran was thrown away and begun anew.
    """

    def __init__(self, adapters: dict[str, I2cBus], clock: Clock, plan: ScanPlan) -> None:
        self._legs = tuple(LegLink(name, channel) for channel, name in enumerate(adapters))
        self._adapters = tuple(adapters.values())
        self._clock = clock
        self._plan = plan
        n_legs = len(self._legs)
        self._latest = BusScan.unread(n_legs)
        self._started_ns: list[int | None] = [None] * n_legs  # of the conversion that runs on each leg
        self._position = 0
        self._n_scans = 0
        self._temperature_due_ns = 0
        self.timing: Timing | None = None
        self.late_ticks = 0

    @property
    def temperature_c(self) -> tuple[float, ...]:
        """Return what the legs' converters said last of their temperature [deg C], NaN for nothing."""
        return tuple(leg.temperature_c for leg in self._legs)

    def start(self) -> None:
        """Look for every leg's chips and set them up. A leg that is missing is tried again later."""
        for row, leg in enumerate(self._legs):
            leg.retry_at_ns = 0
            self._probe(row)
            if leg.in_scan and self.timing is None:
                costs = measure(self._adapters[row], self._clock, adg715.ADDRESS)
                self.timing = timing(costs, self._plan, len(self._legs), kernel_mux=True)

    def scan(self) -> BusScan:
        """Run the plan once and return what it read; the first conversions of the next scan are then running."""
        self._take_temperatures()
        self._refuse_old()
        for _ in self._plan.steps:
            self._step()
        return self._latest.copied()

    def step(self) -> BusScan:
        """Read one element of every leg, the next one of the plan, and return it among the latest of the others."""
        if self._position == 0:
            self._take_temperatures()
        self._refuse_old()
        self._step()
        return self._latest.copied()

    def stop(self) -> None:
        """Nothing is held: the kernel owns the mux."""

    def _take_temperatures(self) -> None:
        """Ask every leg's converter for its temperature if that is due; what runs is thrown away, and begun anew."""
        thermometer = self._plan.board.thermometer
        if thermometer is None or self._clock.now_ns() < self._temperature_due_ns:
            return
        self._temperature_due_ns = self._clock.now_ns() + TEMPERATURE_PERIOD_NS
        asked = [row for row, leg in enumerate(self._legs) if leg.in_scan]
        for row in asked:
            self._started_ns[row] = None
            for write in thermometer.start:
                self._ask(row, write)
        self._clock.sleep_until_ns(self._clock.now_ns() + thermometer.wait_ns)
        for row in asked:
            answer, again = self._ask(row, thermometer.read), self._ask(row, thermometer.read)
            if answer and again:
                self._legs[row].temperature_c = thermometer.decode(answer, again)

    def _ask(self, row: int, transaction: Transaction) -> bytes:
        """Return what a leg answers; nothing if it is given up for not answering."""
        leg = self._legs[row]
        try:
            return _persist(self._adapters[row], transaction) if leg.in_scan else b""
        except BusError as error:
            leg.outcome = self._give_up(leg, error)
            return b""

    def _refuse_old(self) -> None:
        """Begin anew on legs where nothing runs yet, or whose conversions are too old: the loop was held up."""
        late_ns = 2 * self._plan.wait_ns if self.timing is None else self.timing.late_ns + self._plan.wait_ns
        now_ns = self._clock.now_ns()
        late = any(since_ns is not None and now_ns > since_ns + late_ns for since_ns in self._started_ns)
        self.late_ticks += late
        for row, since_ns in enumerate(self._started_ns):
            if late or (since_ns is None and self._position == 0):
                self._begin_anew(row, self._plan.steps[self._position])

    def _step(self) -> None:
        step = self._plan.steps[self._position]
        self._position = (self._position + 1) % len(self._plan.steps)
        ends = self._position == 0
        following = self._plan.steps[self._position]
        asked, checks = self._checks(step, following)
        for row, leg in enumerate(self._legs):
            reading, capacitance_pf, t_ns = self._visit(row, step, following, checks if row == asked else ())
            self._latest.reading[row, step.element] = reading
            self._latest.capacitance_pf[row, step.element] = capacitance_pf
            self._latest.t_ns[row, step.element] = t_ns
            if leg.in_scan and reading not in CONVERTED:
                leg.outcome = reading
            if reading is Reading.MISCONFIGURED:
                # Nothing that it said since the check before counts.
                self._latest.void((row, slice(None)), reading)
        if ends:
            self._n_scans += 1
            self._end_scan()

    def _checks(self, step: Step, following: Step) -> tuple[int, tuple[Check, ...]]:
        """Return which leg is asked in this step, and what: in the last step of a scan also for its settings."""
        turn, asked = divmod(self._n_scans, len(self._legs))
        if step is not self._plan.steps[turn % len(self._plan.steps)]:
            return asked, ()
        held = following.select_checks
        return asked, held if step.setting_check is None else (*held, step.setting_check)

    def _visit(
        self, row: int, step: Step, following: Step, checks: tuple[Check, ...]
    ) -> tuple[Reading, float, int]:
        """Start the next conversion of a leg, then read its last one.

        Returns:
            How it answered, the capacitance [pF], and the middle of the conversion [ns].
        """
        leg, adapter, started_ns = self._legs[row], self._adapters[row], self._started_ns[row]
        if not leg.in_scan or leg.outcome is not Reading.OK or started_ns is None:
            return (leg.outcome if leg.outcome is not Reading.OK else Reading.NO_ANSWER), _NAN, 0
        self._started_ns[row] = None
        try:
            self._clock.sleep_until_ns(started_ns + self._plan.wait_ns)
            for write in (*following.changes, following.trigger):
                _persist(adapter, write)
            self._started_ns[row] = self._clock.now_ns()
            if step.done:
                reading = step.done.says(_persist(adapter, step.done.ask))
                if reading is not Reading.OK:
                    return reading, _NAN, 0
            answers = [_persist(adapter, read) for read in step.read]
            reading, capacitance_pf = self._plan.board.decode_result(answers)
            if any(_persist(adapter, check.ask) != check.expected for check in checks):
                return Reading.MISCONFIGURED, _NAN, 0
        except BusError as error:
            return self._give_up(leg, error), _NAN, 0
        middle_ns = started_ns + self._plan.conversion_ns // 2
        return reading, capacitance_pf + leg.offset_pf, middle_ns if reading in CONVERTED else 0

    def _give_up(self, leg: LegLink, error: BusError) -> Reading:
        """Say what an error means; a leg that holds a line is left alone for a while: each try costs a timeout."""
        if not isinstance(error, BusTimeoutError):
            return Reading.NO_ANSWER
        leg.leave(Reading.BUS_STUCK, str(error), self._clock.now_ns())
        return Reading.BUS_STUCK

    def _begin_anew(self, row: int, step: Step) -> None:
        """Start a conversion on a leg of which nothing is known; what its converter has left is read away first."""
        leg, adapter = self._legs[row], self._adapters[row]
        self._started_ns[row] = None
        if not leg.in_scan:
            return
        try:
            for transaction in (*step.select, *self._plan.board.afresh, step.trigger):
                adapter.transfer(transaction)
        except BusError as error:
            leg.outcome = self._give_up(leg, error)
        else:
            leg.outcome = Reading.OK
            self._started_ns[row] = self._clock.now_ns()

    def _end_scan(self) -> None:
        """Count the scan of every leg, take those that failed in again, and look for one that was left out."""
        now_ns = self._clock.now_ns()
        for row, leg in enumerate(self._legs):
            if leg.in_scan:
                leg.note_scan(self._latest.reading[row], now_ns)
                if leg.outcome is not Reading.OK:
                    self._started_ns[row] = None
        due = [row for row, leg in enumerate(self._legs) if not leg.in_scan and leg.retry_at_ns <= now_ns]
        if due:
            self._probe(min(due, key=lambda row: self._legs[row].retry_at_ns))

    def _probe(self, row: int) -> None:
        self._started_ns[row] = None
        select = self._plan.steps[0].select
        self._legs[row].probe(self._adapters[row], self._plan.board, select, self._clock)


def _persist(adapter: I2cBus, transaction: Transaction) -> bytes:
    """Do a transaction, once more if it is not acknowledged; none of them does harm twice.

    Raises:
        BusTimeoutError: A line is held.
        BusError: It fails again.
    """
    try:
        return adapter.transfer(transaction)
    except BusTimeoutError:
        raise
    except BusError:
        return adapter.transfer(transaction)
