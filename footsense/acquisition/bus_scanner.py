"""Scans all legs of one I2C bus: every leg converts the same element at the same time.

One step of the plan, with what overlaps a conversion and what cannot:

      conversion k-1 runs                      conversion k runs
    ──────────────────────┤ lines, trigger k ├────────────────────────────────────────┤ lines, trigger k+1 ...
                                               done? (all) │ leg 1 │ ... │ leg 6 │ join, check (all)

`lines` (the element's row, and its column where that is switched) and `trigger` go to every leg at once through the
mux. Whether the conversions are done, if results do not tell, and whether lines and settings are held, is asked of all
legs in one read: their answers are a wired AND, so that one answer speaks for all. Only when it says otherwise is each
leg asked alone. A result is read while the next conversion runs. A leg that fails is left out for the rest of the scan,
so that it costs the others no more time.

A line of the bus that is held low blocks all legs. The leg that holds it is looked for at once (`leg_search.py`), and
what the others had been doing is begun anew without it.

Where the bus is slow, a conversion leaves no time for checks of lines and settings. They are then asked one a scan, in
turn, instead of all in each.

Converters with a temperature sensor are asked for it every ten seconds, all at once and between two scans.
"""

import logging

from footsense.acquisition.boards.board import CONVERTED, Check
from footsense.acquisition.boards.conversion import Conversion, channels
from footsense.acquisition.bus_readings import BusScan
from footsense.acquisition.bus_timing import Timing, checks_ns, measure, spare_ns, timing
from footsense.acquisition.leg_connection import TEMPERATURE_PERIOD_NS, LegLink
from footsense.acquisition.leg_search import leave_out_holders, probe, probe_due
from footsense.acquisition.scan_plan import ScanPlan, Step
from footsense.acquisition.upstream_bus import Trunk
from footsense.errors import BusError, BusTimeoutError, HardwareError, NackError
from footsense.frames import Reading
from footsense.ports import Clock, I2cBus, ResetLine, Transaction

_log = logging.getLogger(__name__)

_NAN = float("nan")
#: How often anything that fails is done before it counts as failed.
_TRIES = 2


class _HeldUpError(Exception):
    """A line was held low; whoever holds it is now left out, and what the others did has to be begun anew."""


class BusScanner:
    """The legs behind one mux.

    Args:
        bus: The adapter.
        clock: The time that the adapter lives in.
        channels: Mux channel of each leg by name, in the order of the rows of its scans.
        mux_address: Address of the TCA9548A.
        plan: What to do in one scan.
        reset_line: The RESET pin of the mux; None if nothing drives it. Without it, a leg that holds a line low stops
            all legs of its bus for as long as it does.

    Attributes:
        timing: What the bus costs and allows; measured by `start`.
        late_ticks: How often the scanner was held up for so long that what ran was thrown away and begun anew.
    """

    def __init__(
        self,
        bus: I2cBus,
        clock: Clock,
        channels: dict[str, int],
        mux_address: int,
        plan: ScanPlan,
        reset_line: ResetLine | None = None,
    ) -> None:
        self._trunk = Trunk(bus, mux_address, reset_line)
        self._clock = clock
        self._plan = plan
        self._legs = tuple(LegLink(name, channel) for name, channel in channels.items())
        self._latest = BusScan.unread(len(channels))
        self._running: Conversion | None = None
        self._position = 0
        self._check_all = True
        self._n_scans = 0
        self._temperature_due_ns = 0
        self.timing: Timing | None = None
        self.late_ticks = 0

    @property
    def temperature_c(self) -> tuple[float, ...]:
        """Return what the legs' converters said last of their temperature [deg C], NaN for nothing."""
        return tuple(leg.temperature_c for leg in self._legs)

    def start(self) -> None:
        """Find the mux and every leg's chips, and set them up. A leg that is missing is tried again later.

        Raises:
            HardwareError: The mux does not answer, or a line is stuck: then no leg can.
        """
        mux = f"the mux (TCA9548A) at {self._trunk.mux_address:#04x}"
        try:
            if not self._trunk.free():
                self._trunk.connect(())
            costs = measure(self._trunk.bus, self._clock, self._trunk.mux_address)
        except NackError as error:
            raise HardwareError(
                f"no answer from {mux}: check its power, its wires and its address straps A0..A2"
            ) from error
        except BusError as error:
            raise HardwareError(f"{mux} cannot be reached: {error}") from error
        self.timing = timing(costs, self._plan, len(self._legs), kernel_mux=False)
        self._check_all = spare_ns(costs, self._plan, len(self._legs)) >= checks_ns(costs, self._plan)
        first = self._plan.steps[0]
        for leg in self._legs:
            leg.retry_at_ns = 0
            probe(self._trunk, leg, self._legs, self._plan.board, first.select, self._clock)

    def scan(self) -> BusScan:
        """Run the plan once and return what it read; the first conversion of the next scan is then running."""
        for _ in range(_TRIES):
            try:
                self._take_temperatures()
                self._refuse_old(self._plan.steps[0])
                for _ in self._plan.steps:
                    self._step()
            except _HeldUpError:
                self._running, self._position = None, 0
            else:
                return self._latest.copied()
        return self._held_up(slice(None))

    def step(self) -> BusScan:
        """Read the next element of every leg, and return it among the latest of the others."""
        position = self._position
        for _ in range(_TRIES):
            try:
                if position == 0:
                    self._take_temperatures()
                self._refuse_old(self._plan.steps[position])
                self._step()
            except _HeldUpError:
                self._running, self._position = None, position
            else:
                return self._latest.copied()
        return self._held_up(self._plan.steps[position].element)

    def _held_up(self, elements: int | slice) -> BusScan:
        """Return the latest readings without those of these elements, which could not be read in time."""
        for row, leg in enumerate(self._legs):
            self._latest.void((row, elements), Reading.DELAYED if leg.in_scan else leg.outcome)
        return self._latest.copied()

    def _take_temperatures(self) -> None:
        """Ask all converters for their temperature if that is due; what runs is thrown away.

        They are then set to it, and have to be set up afresh: so they are wherever conversions begin anew.
        """
        thermometer, legs = self._plan.board.thermometer, self._active()
        if thermometer is None or not legs or self._clock.now_ns() < self._temperature_due_ns:
            return
        self._temperature_due_ns = self._clock.now_ns() + TEMPERATURE_PERIOD_NS
        self._running = None
        try:
            self._trunk.connect(channels(legs))
            for write in thermometer.start:
                self._trunk.bus.transfer(write)
            self._clock.sleep_until_ns(self._clock.now_ns() + thermometer.wait_ns)
            for leg in legs:
                self._trunk.connect((leg.channel,))
                answers = [self._trunk.bus.transfer(thermometer.read) for _ in range(2)]
                leg.temperature_c = thermometer.decode(*answers)
        except (
            BusError
        ) as error:  # whoever fails here fails in the scan too; the others are asked again later
            self._look_for_holder(error)
            self._trunk.doubt()

    def _refuse_old(self, step: Step) -> None:
        """Begin anew if nothing runs yet, or if the loop was held up: a result from before that comes too late."""
        running = self._running
        if running is not None and self.timing is not None:
            if self._clock.now_ns() <= running.t_start_ns + self.timing.late_ns:
                return
            self.late_ticks += 1
        self._set_afresh()
        self._running = self._begin(step, step.select)

    def _step(self) -> None:
        """Wait for the conversion that runs, start the next one, and read the finished one meanwhile."""
        running = self._running
        assert running is not None
        step = self._plan.steps[self._position]
        self._position = (self._position + 1) % len(self._plan.steps)
        following = self._plan.steps[self._position]
        ends = self._position == 0
        if self._is_checked(running):
            self._check(running)
        failed: dict[LegLink, Reading] = {
            leg: leg.outcome for leg in self._legs if leg.outcome is not Reading.OK
        }
        if ends:
            self._rejoin(following)
        self._prepare(following)
        self._clock.sleep_until_ns(running.t_start_ns + self._plan.wait_ns)
        finished = running
        running = self._begin(following, following.changes if finished.legs else following.select)
        self._latest.void((slice(None), step.element), finished.unread)
        for leg, outcome in failed.items():
            # The settings are checked in the last step: a leg that was not there has nothing that counts.
            self._latest.void((self._legs.index(leg), slice(None) if ends else step.element), outcome)
        self._read_out(finished, failed)
        self._running = running
        if ends:
            self._n_scans += 1
            self._note()
            probe_due(self._trunk, self._legs, self._plan.board, running.step.select, self._clock)
            if not running.legs:
                # Nobody converts: who was found meanwhile begins with a conversion of its own, not with what is left of
                # a wait for none.
                self._running = None

    def stop(self) -> None:
        """Disconnect every leg from the trunk."""
        try:
            self._trunk.connect(())
        except BusError as error:
            _log.info("the mux at %#04x was not released: %s", self._trunk.mux_address, error)

    def _begin(self, step: Step, select: tuple[Transaction, ...]) -> Conversion:
        """Start one conversion on every leg at once."""
        legs = self._active()
        unread = Reading.NO_ANSWER
        for _ in range(_TRIES if legs else 0):
            try:
                self._trigger(step, legs, select)
            except BusError as error:
                self._look_for_holder(error)
                self._trunk.doubt()  # the mux may have lost its selection: then nobody is there to answer
                unread = Reading.NO_ANSWER if isinstance(error, NackError) else Reading.DELAYED
            else:
                return Conversion(step, self._clock.now_ns(), legs, bool(select), Reading.NO_ANSWER)
        return Conversion(step, self._clock.now_ns(), (), bool(select), unread)

    def _trigger(self, step: Step, legs: tuple[LegLink, ...], select: tuple[Transaction, ...]) -> None:
        self._trunk.connect(channels(legs))
        for write in select:
            self._trunk.bus.transfer(write)
        self._trunk.bus.transfer(step.trigger)

    def _read_out(self, conversion: Conversion, failed: dict[LegLink, Reading]) -> None:
        """Read one finished conversion from every leg that did it, into the element's column."""
        step, into = conversion.step, self._latest
        legs = [leg for leg in conversion.legs if leg not in failed]
        all_done = bool(legs) and self._all_done(conversion)
        t_middle_ns = conversion.t_start_ns + self._plan.conversion_ns // 2
        for leg in legs:
            if not leg.in_scan:  # given up since the conversion began
                continue
            row = self._legs.index(leg)
            reading, capacitance_pf = self._read_leg(leg, step, all_done=all_done)
            into.reading[row, step.element] = reading
            into.capacitance_pf[row, step.element] = capacitance_pf
            if reading in CONVERTED:
                into.t_ns[row, step.element] = t_middle_ns
            else:
                leg.outcome = reading

    def _all_done(self, conversion: Conversion) -> bool:
        """Ask all legs at once, if their results do not tell; False also when not all of them could be asked."""
        done = conversion.step.done
        if done is None:
            return True
        if not self._trunk.is_connected(channels(self._active())):
            return False
        try:
            return done.says(self._trunk.bus.transfer(done.ask)) is Reading.OK
        except BusError as error:
            self._look_for_holder(error)
            return False

    def _read_leg(self, leg: LegLink, step: Step, *, all_done: bool) -> tuple[Reading, float]:
        reading = Reading.NO_ANSWER
        for _ in range(_TRIES):
            try:
                self._trunk.connect((leg.channel,))
                if step.done and not all_done:
                    reading = step.done.says(self._trunk.bus.transfer(step.done.ask))
                    if reading is Reading.CORRUPT:
                        continue
                    if reading is Reading.NOT_READY:
                        return reading, _NAN
                answers = [self._trunk.bus.transfer(read) for read in step.read]
                reading, capacitance_pf = self._plan.board.decode_result(answers)
                return reading, capacitance_pf + leg.offset_pf
            except BusError as error:
                self._look_for_holder(error)
                self._trunk.doubt()
                reading = Reading.NO_ANSWER if isinstance(error, NackError) else Reading.DELAYED
        return reading, _NAN

    def _is_checked(self, conversion: Conversion) -> bool:
        """Tell whether lines and settings are asked for during this conversion."""
        return self._check_all or conversion.step is self._plan.steps[self._n_scans % len(self._plan.steps)]

    def _check(self, conversion: Conversion) -> None:
        """Make sure, while a conversion runs, that every leg converts what it was told; note those that do not."""
        for check in conversion.step.select_checks if conversion.selected else ():
            self._ask_all(self._active(), check)
        if conversion.step.setting_check is not None:
            self._ask_all(self._active(), conversion.step.setting_check)

    def _ask_all(self, legs: tuple[LegLink, ...], check: Check) -> None:
        """Leave those of the legs that answer otherwise than they should out of the rest of the scan."""
        if not legs or self._holds(legs, check):
            return
        for leg in legs:
            if leg.in_scan and not self._holds((leg,), check):
                leg.outcome = Reading.MISCONFIGURED

    def _holds(self, legs: tuple[LegLink, ...], check: Check) -> bool:
        try:
            return self._trunk.holds(channels(legs), check)
        except BusError as error:
            self._look_for_holder(error)
            return False

    def _set_afresh(self) -> None:
        """Read away what the converters hold, or it would speak for a conversion that is yet to come."""
        if legs := self._active():
            try:
                self._trunk.connect(channels(legs))
                for transaction in self._plan.board.afresh:
                    self._trunk.bus.transfer(transaction)
            except BusError as error:
                self._look_for_holder(error)

    def _rejoin(self, first: Step) -> None:
        """Bring every leg that failed in this scan to where the others are, so that it takes part in the next one.

        The others are still converting: the leg gets its lines alone, and what its converter may have left is read
        away, or it would speak for a result of this scan in the next.
        """
        for leg in self._legs:
            if not leg.in_scan or leg.outcome is Reading.OK:
                continue
            try:
                self._trunk.connect((leg.channel,))
                self._restore(leg)
                for transaction in (*first.select, *self._plan.board.afresh):
                    self._trunk.bus.transfer(transaction)
                # The lines need not change for the first step, and are not asked for then.
                held = all(self._trunk.holds((leg.channel,), check) for check in first.select_checks)
            except BusError as error:
                self._look_for_holder(error)
            else:
                leg.outcome = Reading.OK if held else Reading.MISCONFIGURED

    def _restore(self, leg: LegLink) -> None:
        """Put the settings of a leg that is connected alone back to what the others have; here it never leaves them."""

    def _note(self) -> None:
        now_ns = self._clock.now_ns()
        for row, leg in enumerate(self._legs):
            if leg.in_scan:
                leg.note_scan(self._latest.reading[row], now_ns)

    def _look_for_holder(self, error: BusError) -> None:
        """Do nothing about an error but if a line is held low: then leave out who holds it.

        Raises:
            _HeldUpError: All have lost time, and the mux its selection.
        """
        if isinstance(error, BusTimeoutError):
            in_scan = [leg for leg in self._legs if leg.in_scan]
            leave_out_holders(self._trunk, in_scan, self._plan.steps[0].select_checks[0].ask, self._clock)
            raise _HeldUpError from error

    def _prepare(self, following: Step) -> None:
        """Connect all legs while the conversion still runs; if that fails, `_begin` tries once more."""
        del following
        if legs := self._active():
            try:
                self._trunk.connect(channels(legs))
            except BusError as error:
                self._look_for_holder(error)

    def _active(self) -> tuple[LegLink, ...]:
        """Return the legs that take part in this scan and have not failed in it."""
        return tuple(leg for leg in self._legs if leg.in_scan and leg.outcome is Reading.OK)
