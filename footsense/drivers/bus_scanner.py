"""Scans all legs of one I2C bus: every leg converts the same element at the same time.

One step of the plan, with what overlaps a conversion and what cannot:

      conversion k-1 runs                    conversion k runs
    ──────────────────────┤ row, trigger k ├──────────────────────────────────────────┤ row, trigger k+1 ...
                                             done? (all) │ leg 1 │ ... │ leg 6 │ join, check (all)

`row` and `trigger` go to every leg at once through the mux. Whether the conversions are done, and whether rows and
settings are held, is asked of all legs in one read: their answers are a wired AND, so that one answer speaks for all.
Only when it says otherwise is each leg asked alone. A result is read while the next conversion runs in another slot of
the converter. A leg that fails is left out for the rest of the scan, so that it costs the others no more time.

A line of the bus that is held low blocks all legs. The leg that holds it is looked for at once (`leg_search.py`), and
what the others had been doing is begun anew without it.

Where the bus is slow, a conversion leaves no time for checks of rows and settings. They are then asked one a scan, in
turn, instead of all in each.
"""

import logging
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from footsense.drivers import fdc1004
from footsense.drivers.bus_timing import Timing, measure, spare_ns, timing
from footsense.drivers.leg_link import LegLink
from footsense.drivers.leg_search import leave_out_holders, probe, probe_due
from footsense.drivers.scan_plan import Check, ScanPlan, Step
from footsense.drivers.trunk import Trunk
from footsense.errors import BusError, BusTimeoutError, HardwareError, NackError
from footsense.frames import ELEMENTS, Reading
from footsense.ports import Clock, I2cBus, ResetLine

_log = logging.getLogger(__name__)

_NAN = float("nan")
#: How often anything that fails is done before it counts as failed.
_TRIES = 2


class _HeldUpError(Exception):
    """A line was held low; whoever holds it is now left out, and what the others did has to be begun anew."""


class BusScan(NamedTuple):
    """The latest readings of one bus; arrays as in `CapFrame`, rows in the order of the bus's legs."""

    t_ns: NDArray[np.int64]
    capacitance_pf: NDArray[np.float64]
    reading: NDArray[np.uint8]


class Conversion(NamedTuple):
    """A conversion that was triggered on some legs.

    Attributes:
        step: Which.
        t_start_ns: When its trigger had gone out [ns].
        legs: The legs that were told to convert; none if a transaction failed.
        row_selected: Whether the row was selected for it, or left from the step before.
        unread: What a leg that gives no reading of it has to say.
    """

    step: Step
    t_start_ns: int
    legs: tuple[LegLink, ...]
    row_selected: bool
    unread: Reading


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
        self._latest = BusScan(
            np.zeros((len(channels), ELEMENTS), np.int64),
            np.full((len(channels), ELEMENTS), _NAN),
            np.full((len(channels), ELEMENTS), Reading.NO_ANSWER, np.uint8),
        )
        self._running: Conversion | None = None
        self._position = 0
        self._check_all = True
        self._n_scans = 0
        self.timing: Timing | None = None
        self.late_ticks = 0

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
        # The most that a step asks for besides the read-out: one row and once a scan the settings.
        self._check_all = spare_ns(costs, self._plan, len(self._legs)) >= costs.lasts_ns(1) + costs.lasts_ns(
            1, 2
        )
        for leg in self._legs:
            leg.retry_at_ns = 0
            probe(self._trunk, leg, self._legs, self._plan.steps[0].select_row, self._clock)

    def scan(self) -> BusScan:
        """Run the plan once and return what it read; the first conversion of the next scan is then running."""
        for _ in range(_TRIES):
            try:
                self._refuse_old(self._plan.steps[0])
                for _ in self._plan.steps:
                    self._step()
            except _HeldUpError:
                self._running, self._position = None, 0
            else:
                return self._copy()
        return self._held_up(slice(None))

    def step(self) -> BusScan:
        """Read one element of every leg, the next one of the plan, and return it among the latest of the others."""
        position = self._position
        for _ in range(_TRIES):
            try:
                self._refuse_old(self._plan.steps[position])
                self._step()
            except _HeldUpError:
                self._running, self._position = None, position
            else:
                return self._copy()
        return self._held_up(self._plan.steps[position].element)

    def _held_up(self, elements: int | slice) -> BusScan:
        """Return the latest readings without those of these elements, which could not be read in time."""
        t_ns, capacitance_pf, reading = self._latest
        t_ns[:, elements], capacitance_pf[:, elements] = 0, _NAN
        for row, leg in enumerate(self._legs):
            reading[row, elements] = Reading.HELD_UP if leg.in_scan else leg.outcome
        return self._copy()

    def _copy(self) -> BusScan:
        t_ns, capacitance_pf, reading = self._latest
        return BusScan(t_ns.copy(), capacitance_pf.copy(), reading.copy())

    def _refuse_old(self, step: Step) -> None:
        """Begin anew if nothing runs yet, or if the loop was held up: a result from before that comes too late."""
        running = self._running
        if running is not None and self.timing is not None:
            if self._clock.now_ns() <= running.t_start_ns + self.timing.late_ns:
                return
            self.late_ticks += 1
        self._discard_results()
        self._running = self._begin(step, select_row=True)

    def _step(self) -> None:
        """Wait for the conversion that runs, start the next one, and read the finished one meanwhile."""
        running, into = self._running, self._latest
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
        running = self._begin(following, select_row=following.row_changes or not finished.legs)
        into.t_ns[:, step.element], into.capacitance_pf[:, step.element] = 0, _NAN
        into.reading[:, step.element] = finished.unread
        for leg, outcome in failed.items():
            # The settings are checked in the last step: a leg that was not there has nothing that counts.
            elements = slice(None) if ends else step.element
            row = self._legs.index(leg)
            into.t_ns[row, elements], into.capacitance_pf[row, elements] = 0, _NAN
            into.reading[row, elements] = outcome
        self._read_out(finished, failed, into)
        self._running = running
        if ends:
            self._n_scans += 1
            self._note(into)
            probe_due(self._trunk, self._legs, running.step.select_row, self._clock)

    def stop(self) -> None:
        """Disconnect every leg from the trunk."""
        try:
            self._trunk.connect(())
        except BusError as error:
            _log.info("the mux at %#04x was not released: %s", self._trunk.mux_address, error)

    def _begin(self, step: Step, *, select_row: bool) -> Conversion:
        """Start one conversion on every leg at once."""
        legs = self._active()
        unread = Reading.NO_ANSWER
        for _ in range(_TRIES if legs else 0):
            try:
                self._trigger(step, legs, select_row=select_row)
            except BusError as error:
                self._look_for_holder(error)
                self._trunk.doubt()  # the mux may have lost its selection: then nobody is there to answer
                unread = Reading.NO_ANSWER if isinstance(error, NackError) else Reading.HELD_UP
            else:
                return Conversion(step, self._clock.now_ns(), legs, select_row, Reading.NO_ANSWER)
        return Conversion(step, self._clock.now_ns(), (), select_row, unread)

    def _trigger(self, step: Step, legs: tuple[LegLink, ...], *, select_row: bool) -> None:
        self._trunk.connect(channels(legs))
        if select_row:
            self._trunk.bus.transfer(step.select_row)
        self._trunk.bus.transfer(step.trigger)

    def _read_out(self, conversion: Conversion, failed: dict[LegLink, Reading], into: BusScan) -> None:
        """Read one finished conversion from every leg that did it, into the element's column."""
        step = conversion.step
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
            if reading in {Reading.OK, Reading.GANGED, Reading.OVER_RANGE}:
                into.t_ns[row, step.element] = t_middle_ns
            else:
                leg.outcome = reading

    def _all_done(self, conversion: Conversion) -> bool:
        """Ask all legs at once; False also when the question failed or was not put to all of them."""
        if not self._trunk.is_connected(channels(self._active())):
            return False
        try:
            return fdc1004.is_done(self._trunk.bus.transfer(fdc1004.READ_CONF), conversion.step.slot)
        except BusError as error:
            self._look_for_holder(error)
            return False

    def _read_leg(self, leg: LegLink, step: Step, *, all_done: bool) -> tuple[Reading, float]:
        reading = Reading.NO_ANSWER
        for _ in range(_TRIES):
            try:
                self._trunk.connect((leg.channel,))
                if not all_done:
                    conf = self._trunk.bus.transfer(fdc1004.READ_CONF)
                    if fdc1004.is_garbled(conf):
                        reading = Reading.GARBLED
                        continue
                    if not fdc1004.is_done(conf, step.slot):
                        return Reading.NOT_READY, _NAN
                return fdc1004.decode_result([self._trunk.bus.transfer(read) for read in step.read])
            except BusError as error:
                self._look_for_holder(error)
                self._trunk.doubt()
                reading = Reading.NO_ANSWER if isinstance(error, NackError) else Reading.HELD_UP
        return reading, _NAN

    def _is_checked(self, conversion: Conversion) -> bool:
        """Tell whether rows and settings are asked for during this conversion."""
        return self._check_all or conversion.step is self._plan.steps[self._n_scans % len(self._plan.steps)]

    def _check(self, conversion: Conversion) -> None:
        """Make sure, while a conversion runs, that every leg converts what it was told; note those that do not."""
        if conversion.row_selected:
            self._ask_all(self._active(), conversion.step.row_check)
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

    def _discard_results(self) -> None:
        """Read away what the converters hold, or its DONE would speak for a conversion that is yet to come."""
        if legs := self._active():
            try:
                self._trunk.connect(channels(legs))
                for read in fdc1004.ALL_RESULTS:
                    self._trunk.bus.transfer(read)
            except BusError as error:
                self._look_for_holder(error)

    def _rejoin(self, first: Step) -> None:
        """Bring every leg that failed in this scan to where the others are, so that it takes part in the next one.

        The others are still converting: the leg gets its row alone, and what its converter may have left is read away,
        or its DONE would speak for a result of this scan in the next.
        """
        for leg in self._legs:
            if not leg.in_scan or leg.outcome is Reading.OK:
                continue
            try:
                self._trunk.connect((leg.channel,))
                self._restore(leg)
                self._trunk.bus.transfer(first.select_row)
                for read in fdc1004.ALL_RESULTS:
                    self._trunk.bus.transfer(read)
                # The row need not change for the first step, and is not asked for then.
                held = self._trunk.holds((leg.channel,), first.row_check)
            except BusError as error:
                self._look_for_holder(error)
            else:
                leg.outcome = Reading.OK if held else Reading.MISCONFIGURED

    def _restore(self, leg: LegLink) -> None:
        """Put the settings of a leg that is connected alone back to what the others have; here it never leaves them."""

    def _note(self, scan: BusScan) -> None:
        now_ns = self._clock.now_ns()
        for row, leg in enumerate(self._legs):
            if leg.in_scan:
                leg.note_scan(scan.reading[row], now_ns)

    def _look_for_holder(self, error: BusError) -> None:
        """Do nothing about an error but if a line is held low: then leave out who holds it.

        Raises:
            _HeldUpError: All have lost time, and the mux its selection.
        """
        if isinstance(error, BusTimeoutError):
            in_scan = [leg for leg in self._legs if leg.in_scan]
            leave_out_holders(self._trunk, in_scan, self._plan.steps[0].row_check.ask, self._clock)
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


def channels(legs: tuple[LegLink, ...]) -> list[int]:
    """Return the mux channels of some legs."""
    return [leg.channel for leg in legs]
