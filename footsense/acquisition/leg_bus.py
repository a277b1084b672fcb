"""I2C adapter with the legs on it, and the duration of its transactions.

The legs are behind a mux that footsense switches; or one leg is directly on the adapter, as on a channel of a mux that
the kernel drives, which is an adapter of its own. A *selection* is a bit mask of mux channels, bit n for channel n, as
in the control byte of a TCA9548A; a leg without a mux has bit 0.

A Linux adapter does not report its clock, and often does not keep the configured one: on a Raspberry Pi it follows the
processor's. So two reads of one chip, a short and a long one, are timed at start: their difference gives the clock, the
rest is the time that interpreter, system call and interrupts add to every transaction.
"""

import contextlib
import logging
from collections.abc import Iterable
from statistics import median
from typing import NamedTuple

from firmware_interface.chips import adg715
from firmware_interface.schedule import ScanLowerBounds, scan_lower_bounds
from firmware_interface.wire_timing import BUS_FREE_NS, transaction_bits
from footsense.acquisition.scan_plan import ScanPlan
from footsense.errors import HardwareError, I2cError, I2cTimeoutError, NackError
from footsense.ports import Clock, I2cBus, MuxResetLine, Transaction

_log = logging.getLogger(__name__)

#: Nine clocks with SDA released: address 0x7F and the bit to read are eight ones, and no chip may acknowledge them.
#: Source: UM10204, section 3.1.16 (bus clear) and table 4 (reserved addresses).
NINE_CLOCKS = Transaction(0x7F, b"", 1)
_SHORT_READ_BYTES, _LONG_READ_BYTES = 1, 33
_N_TIMED_READS = 9


def release_sda(bus: I2cBus) -> None:
    """Clock out the byte in which a chip was interrupted; until then it holds SDA low.

    An adapter that compares SDA with what it sends times out instead; its driver clears the bus, or nothing does. One
    that does not, as that of a Raspberry Pi 0 to 4, reads a line that stays low as an acknowledge of any address.

    Raises:
        I2cTimeoutError: SDA stays low.
        I2cError: The transaction failed otherwise.
    """
    for _ in range(2):
        try:
            bus.transfer(NINE_CLOCKS)
        except NackError:
            return
    raise I2cTimeoutError("SDA is held low: an address that no chip has is acknowledged")


class BusCosts(NamedTuple):
    """Duration of a transaction on one bus: bus clock rate, and fixed cost on the host.

    Attributes:
        bus_hz: Clock of the bus [Hz].
        host_ns_per_transaction: Time that the host adds to each transaction [ns].
    """

    bus_hz: float
    host_ns_per_transaction: float

    def total_ns(self, transactions: Iterable[Transaction]) -> float:
        """Return the total duration of several transactions [ns]."""
        fixed_ns = BUS_FREE_NS + self.host_ns_per_transaction
        return sum(
            transaction_bits(len(each.write), each.n_read) * 1e9 / self.bus_hz + fixed_ns
            for each in transactions
        )


class BusStuckError(Exception):
    """SDA or SCL is held low; the leg that holds it is left out, the other legs restart their scan."""


class LegBus:
    """I2C adapter with its legs behind a TCA9548A, or one leg without; an unchanged selection is not written again.

    Args:
        adapter: The adapter.
        mux_address: Address of the mux; None for a leg directly on the adapter.
        reset_line: The mux's RESET pin; None if nothing drives it. Without it, a leg that holds a line low stops all
            legs of its bus for as long as it does.

    Attributes:
        adapter: As given.
        mux_address: As given.
        read_back: Read of the present selection; None without a mux.
    """

    def __init__(
        self, adapter: I2cBus, mux_address: int | None, reset_line: MuxResetLine | None = None
    ) -> None:
        self.adapter = adapter
        self.mux_address = mux_address
        self._reset_line = reset_line
        self._selection: int | None = None
        self.read_back: Transaction | None = None
        self._writes: list[Transaction] = []
        if mux_address is not None:
            self.read_back = Transaction(mux_address, b"", n_read=1)
            self._writes = [Transaction(mux_address, bytes((selection,))) for selection in range(256)]

    def connect(self, selection: int) -> I2cBus:
        """Connect exactly these mux channels; return the bus on which their chips answer.

        Raises:
            I2cError: The mux did not take it; which channels are connected is then unknown.
        """
        if selection != self._selection:
            self._selection = None
            if self._writes:
                self.adapter.transfer(self._writes[selection])
            self._selection = selection
        return self.adapter

    def forget_selection(self) -> None:
        """Discard the stored selection, so that the next one is written even if unchanged."""
        self._selection = None

    def free_bus(self) -> bool:
        """Disconnect all legs from a possibly stuck bus; return whether it is free again.

        A leg that holds SDA low blocks the write that would disconnect it, so that only the RESET pin helps. Without
        one, nine clocks and that write are tried all the same: the line may be released.
        """
        self._selection = None
        with contextlib.suppress(I2cError):
            if self._reset_line is not None:
                self._reset_line.pulse()
            else:
                release_sda(self.adapter)
            self.connect(0)
        return self._selection is not None

    def disconnect_legs(self) -> None:
        """Disconnect all mux channels."""
        try:
            self.connect(0)
        except I2cError as error:
            _log.info("the mux at %#04x was not released: %s", self.mux_address, error)

    def measure_costs(self, clock: Clock) -> BusCosts | None:
        """Measure the duration of transactions by reads of the mux, or of the line switch of a leg without one.

        Returns:
            The costs; None if a leg without a mux does not answer.

        Raises:
            HardwareError: The mux does not answer, or a line is stuck: no leg can be reached.
        """
        if self.mux_address is None:
            with contextlib.suppress(I2cError):
                return _measure_costs(self.adapter, clock, adg715.ADDRESS)
            return None
        mux = f"the mux (TCA9548A) at {self.mux_address:#04x}"
        try:
            if not self.free_bus():
                self.connect(0)
            return _measure_costs(self.adapter, clock, self.mux_address)
        except NackError as error:
            raise HardwareError(
                f"no answer from {mux}: check its power, its wires and its address straps A0..A2"
            ) from error
        except I2cError as error:
            raise HardwareError(f"{mux} cannot be reached: {error}") from error


def _measure_costs(bus: I2cBus, clock: Clock, address: int) -> BusCosts:
    """Return a bus's costs, measured by short and long reads of a chip; raise its error if none passes."""

    def median_ns(n_read: int) -> float:
        durations_ns, lost = [], None
        for _ in range(_N_TIMED_READS):
            start_ns = clock.now_ns()
            try:
                bus.transfer(Transaction(address, b"", n_read))
            except NackError as error:  # one acknowledge that is lost changes no median
                lost = error
            else:
                durations_ns.append(clock.now_ns() - start_ns)
        if lost is not None and not durations_ns:
            raise lost
        return median(durations_ns)

    short_ns, long_ns = median_ns(_SHORT_READ_BYTES), median_ns(_LONG_READ_BYTES)
    short_bits = transaction_bits(0, _SHORT_READ_BYTES)
    bit_ns = max(long_ns - short_ns, 1.0) / (transaction_bits(0, _LONG_READ_BYTES) - short_bits)
    return BusCosts(1e9 / bit_ns, max(short_ns - BUS_FREE_NS - short_bits * bit_ns, 0.0))


class BusTiming(NamedTuple):
    """Transaction costs and scan period limits of one I2C bus.

    Attributes:
        costs: Cost of its transactions.
        lower_bounds: The shortest scans that they allow.
        conversions_ns: Time of all conversions of a scan without any transaction [ns].
    """

    costs: BusCosts
    lower_bounds: ScanLowerBounds
    conversions_ns: int

    def __str__(self) -> str:
        """Return the timing as one line of text for the log."""
        rate_hz, host_cost_ns = self.costs
        bound_ns = self.lower_bounds.scan_period_bound_ns
        return (
            f"{rate_hz * 1e-3:.0f} kHz and {host_cost_ns * 1e-3:.0f} us of host per transaction; the best scan takes "
            f"{bound_ns * 1e-6:.1f} ms, {bound_ns / self.conversions_ns:.2f} x its conversions; the limit is the "
            f"{self.lower_bounds.limiting_factor}"
        )


def bus_timing(costs: BusCosts, plan: ScanPlan, n_legs: int) -> BusTiming:
    """Return the scan limits of a bus with so many legs."""
    limits = scan_lower_bounds(
        n_legs=n_legs,
        conversion_ns=plan.conversion_ns,
        bus_hz=costs.bus_hz,
        host_cost_ns=costs.host_ns_per_transaction,
        n_result_reads=len(plan.steps[0].results[0].read),
        traffic=plan.board.traffic,
    )
    return BusTiming(costs, limits, len(plan.steps) * plan.conversion_ns)


def checks_that_fit(costs: BusCosts, plan: ScanPlan, n_legs: int) -> tuple[bool, bool]:
    """Return which read-back checks fit into a conversion beside the read-out of all legs.

    Returns:
        Whether there is time to ask for lines and settings, and then to read the mux back after every leg.
    """
    step = plan.steps[0]
    select, ask = Transaction(0, b"\0"), [step.done.read] if step.done else []
    each_leg = [select, *(read for result in step.results for read in result.read)]
    checks = [check.read for check in (*step.select_checks, plan.board.setting_check)]
    spare_ns = plan.conversion_wait_ns - costs.total_ns([*ask, select, *each_leg * n_legs, *checks])
    return spare_ns >= 0, spare_ns >= (1 + n_legs) * costs.total_ns([Transaction(0, b"", 1)])
