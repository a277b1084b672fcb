"""Scans all legs of one I2C bus: every leg converts the same element at the same time.

One step of the plan, with what overlaps a conversion and what cannot:

      conversion k-1 runs                    conversion k runs
    ──────────────────────┤ row, trigger k ├──────────────────────────────────────────┤ row, trigger k+1 ...
                                             done? (all) │ leg 1 │ ... │ leg 6 │ join

`row` and `trigger` go to every leg at once through the mux. Whether the conversions are done is asked of all legs
in one read: their answers are a wired AND, so a one means that every leg has finished. Only when it says otherwise
is each leg asked alone. A result is read while the next conversion runs in another slot of the converter.
"""

import contextlib
import logging
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from firmware_interface import tca9548a
from footsense.drivers import fdc1004
from footsense.drivers.leg_link import LegLink, LinkStatus
from footsense.drivers.scan_plan import ScanPlan, Step
from footsense.errors import BusError, HardwareError, NackError
from footsense.frames import ELEMENTS, Reading
from footsense.ports import Clock, I2cBus, Transaction

_log = logging.getLogger(__name__)

_NAN = float("nan")


class BusScan(NamedTuple):
    """What one bus saw in one scan; arrays as in `CapFrame`, rows in the order of the bus's legs."""

    t_ns: NDArray[np.int64]
    capacitance_pf: NDArray[np.float64]
    reading: NDArray[np.uint8]


class _Conversion(NamedTuple):
    """A conversion that runs on all legs; `started` is False when its trigger was not acknowledged."""

    step: Step
    t_start_ns: int
    started: bool


class BusScanner:
    """The legs behind one mux.

    Args:
        bus: The adapter.
        clock: The time that the adapter lives in.
        channels: Mux channel of each leg by name, in the order of the rows of its scans.
        mux_address: Address of the TCA9548A.
        plan: What to do in one scan.
    """

    def __init__(
        self, bus: I2cBus, clock: Clock, channels: dict[str, int], mux_address: int, plan: ScanPlan
    ) -> None:
        self._bus = bus
        self._clock = clock
        self._mux_address = mux_address
        self._plan = plan
        self._legs = tuple(LegLink(name, channel, mux_address) for name, channel in channels.items())
        self._connected: Transaction | None = None
        #: Legs that have failed in this scan: they are left out for its rest, so that they cost the others no more.
        self._failed: dict[LegLink, Reading] = {}
        self._running: _Conversion | None = None

    def start(self) -> None:
        """Find the mux and every leg's chips, and set them up. A leg that is missing is tried again later.

        Raises:
            HardwareError: The mux does not answer: then no leg can.
        """
        try:
            self._connect(self._join(()))
        except NackError as error:
            raise HardwareError(
                f"no mux (TCA9548A) at {self._mux_address:#04x}: "
                "check its power, its wires and its address straps A0..A2 against the configuration"
            ) from error
        for leg in self._legs:
            self._connect(leg.connect)
            leg.probe(self._bus, self._plan.steps[0].select_row, self._clock.now_ns())

    def scan(self) -> BusScan:
        """Run the plan once and return what it read; the first conversion of the next scan is then running."""
        shape = (len(self._legs), ELEMENTS)
        result = BusScan(
            np.zeros(shape, np.int64), np.full(shape, _NAN), np.full(shape, Reading.NO_ANSWER, np.uint8)
        )
        steps = self._plan.steps
        running = self._running or self._begin(steps[0], select_row=True)
        for position in range(len(steps)):
            finished, following = running, steps[(position + 1) % len(steps)]
            failed = self._failed
            if following is steps[0]:
                self._failed = {}  # the next scan begins with this step, and every leg gets its chance in it
            self._prepare()
            self._clock.sleep_until_ns(finished.t_start_ns + self._plan.wait_ns)
            running = self._begin(following, select_row=following.row_changes or not finished.started)
            self._read_out(finished, result, failed)
        self._running = running
        self._note(result)
        self._probe_one(running.step.select_row)
        return result

    def stop(self) -> None:
        """Disconnect every leg from the trunk."""
        try:
            self._connect(self._join(()))
        except BusError as error:
            _log.info("the mux at %#04x was not released: %s", self._mux_address, error)

    def _begin(self, step: Step, *, select_row: bool) -> _Conversion:
        """Start one conversion on every leg at once."""
        active = self._active()
        started = bool(active)
        try:
            if started:
                self._connect(self._join(active))
                if select_row:
                    self._bus.transfer(step.select_row)
                self._bus.transfer(step.trigger)
        except BusError:
            started = False
        return _Conversion(step, self._clock.now_ns(), started)

    def _read_out(self, conversion: _Conversion, into: BusScan, failed: dict[LegLink, Reading]) -> None:
        """Read one finished conversion from every leg, into the element's column; note who fails."""
        step = conversion.step
        all_done = conversion.started and self._all_done(step)
        t_middle_ns = conversion.t_start_ns + self._plan.conversion_ns // 2
        for row, leg in enumerate(self._legs):
            if leg.status is not LinkStatus.IN_SCAN or leg in failed:
                into.reading[row, step.element] = failed.get(leg, leg.status.value)
                continue
            if not conversion.started:
                continue
            reading, capacitance_pf = self._read_leg(leg, step, all_done=all_done)
            into.reading[row, step.element] = reading
            into.capacitance_pf[row, step.element] = capacitance_pf
            if reading is Reading.OK:
                into.t_ns[row, step.element] = t_middle_ns
            elif reading is not Reading.OVER_RANGE:
                failed[leg] = reading

    def _all_done(self, step: Step) -> bool:
        """Ask all legs at once; False also when the question failed."""
        try:
            return fdc1004.is_done(self._bus.transfer(fdc1004.READ_CONF), step.slot)
        except BusError:
            return False

    def _read_leg(self, leg: LegLink, step: Step, *, all_done: bool) -> tuple[Reading, float]:
        try:
            self._connect(leg.connect)
            if not all_done and not fdc1004.is_done(self._bus.transfer(fdc1004.READ_CONF), step.slot):
                return Reading.NOT_READY, _NAN
            return fdc1004.decode_result([self._bus.transfer(read) for read in step.read])
        except BusError:
            return Reading.NO_ANSWER, _NAN

    def _note(self, result: BusScan) -> None:
        now_ns = self._clock.now_ns()
        for row, leg in enumerate(self._legs):
            if leg.status is LinkStatus.IN_SCAN:
                readings = set(result.reading[row].tolist())
                missing = readings & {Reading.NO_ANSWER, Reading.NOT_READY}
                leg.note_scan(Reading(min(missing, default=Reading.OK)), now_ns)

    def _probe_one(self, select_row: Transaction) -> None:
        """Try the leg that has waited longest, if one is due; one a scan, so that the others keep their time."""
        now_ns = self._clock.now_ns()
        due = [
            leg for leg in self._legs if leg.status is not LinkStatus.IN_SCAN and leg.retry_at_ns <= now_ns
        ]
        if not due:
            return
        leg = min(due, key=lambda leg: leg.retry_at_ns)
        try:
            self._connect(leg.connect)
        except BusError:
            return
        leg.probe(self._bus, select_row, now_ns)

    def _prepare(self) -> None:
        """Connect all legs while the conversion still runs; if that fails, `_begin` tries once more."""
        with contextlib.suppress(BusError):
            self._connect(self._join(self._active()))

    def _active(self) -> tuple[int, ...]:
        """Return the channels of the legs that convert now."""
        return tuple(
            leg.channel for leg in self._legs if leg.status is LinkStatus.IN_SCAN and leg not in self._failed
        )

    def _join(self, channels: tuple[int, ...]) -> Transaction:
        return Transaction(self._mux_address, bytes((tca9548a.select(channels),)))

    def _connect(self, selection: Transaction) -> None:
        """Set the mux, unless it stands so already."""
        if selection == self._connected:
            return
        self._connected = None
        self._bus.transfer(selection)
        self._connected = selection
