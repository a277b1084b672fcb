"""What a bus really costs, measured at start, and what follows from it for the scan.

A Linux adapter does not tell its clock, and often does not keep the one that it was set to: on a Raspberry Pi it
follows the processor's. So two reads of the mux, a short and a long one, are timed: their difference is the clock,
the rest is what interpreter, system call and interrupts add to every transaction.
"""

from collections.abc import Iterable
from statistics import median
from typing import NamedTuple

from firmware_interface.i2c_timing import BUS_FREE_NS, transaction_bits
from firmware_interface.schedule import ScanLimits, scan_limits
from footsense.acquisition.scan_plan import ScanPlan
from footsense.errors import NackError
from footsense.frames import ELEMENTS
from footsense.ports import Clock, I2cBus, Transaction

_SHORT, _LONG = 1, 33  # bytes read
_TRIES = 9


class BusCosts(NamedTuple):
    """What a transaction on one bus costs.

    Attributes:
        rate_hz: Clock of the bus [Hz].
        host_cost_ns: What the host adds to each transaction [ns].
    """

    rate_hz: float
    host_cost_ns: float

    def lasts_ns(self, n_write: int, n_read: int = 0) -> float:
        """Return how long a transaction takes [ns]."""
        return transaction_bits(n_write, n_read) * 1e9 / self.rate_hz + BUS_FREE_NS + self.host_cost_ns

    def of_ns(self, transactions: Iterable[Transaction]) -> float:
        """Return how long some transactions take [ns]."""
        return sum(self.lasts_ns(len(each.write), each.n_read) for each in transactions)


def measure(bus: I2cBus, clock: Clock, address: int) -> BusCosts:
    """Return what transactions cost, from reads of a chip with a single byte, which it repeats as long as it is read.

    Args:
        bus: The adapter.
        clock: The time that it lives in.
        address: Of a TCA9548A, or of an ADG715.

    Raises:
        BusError: The chip does not answer.
    """

    def lasts_ns(n_read: int) -> float:
        transaction = Transaction(address, b"", n_read)
        durations_ns = []
        lost = None
        for _ in range(_TRIES):
            start_ns = clock.now_ns()
            try:
                bus.transfer(transaction)
            except NackError as error:  # one acknowledge that is lost changes no median
                lost = error
            else:
                durations_ns.append(clock.now_ns() - start_ns)
        if lost is not None and not durations_ns:
            raise lost
        return median(durations_ns)

    short_ns, long_ns = lasts_ns(_SHORT), lasts_ns(_LONG)
    bits = transaction_bits(0, _LONG) - transaction_bits(0, _SHORT)
    bit_ns = max(long_ns - short_ns, 1.0) / bits
    host_cost_ns = short_ns - BUS_FREE_NS - transaction_bits(0, _SHORT) * bit_ns
    return BusCosts(1e9 / bit_ns, max(host_cost_ns, 0.0))


class Timing(NamedTuple):
    """What is to be expected of a bus.

    Attributes:
        costs: What its transactions cost.
        limits: The shortest scans that its limits allow.
        floor_ns: Nine bare conversions [ns].
    """

    costs: BusCosts
    limits: ScanLimits
    floor_ns: int

    @property
    def late_ns(self) -> int:
        """Return the age of a conversion at which the loop must have been held up [ns]: two steps."""
        return 2 * self.limits.scan_ns // ELEMENTS

    def __str__(self) -> str:
        """Return one line for the journal."""
        rate_hz, host_cost_ns = self.costs
        return (
            f"{rate_hz * 1e-3:.0f} kHz and {host_cost_ns * 1e-3:.0f} us of host per transaction; the best scan takes "
            f"{self.limits.scan_ns * 1e-6:.1f} ms, {self.limits.scan_ns / self.floor_ns:.2f} x its conversions; "
            f"the limit is the {self.limits.holds}"
        )


def timing(costs: BusCosts, plan: ScanPlan, n_legs: int, *, kernel_mux: bool) -> Timing:
    """Return what to expect of a bus with these costs."""
    limits = scan_limits(
        n_legs=n_legs,
        conversion_ns=plan.conversion_ns,
        rate_hz=costs.rate_hz,
        host_cost_ns=costs.host_cost_ns,
        n_result_reads=len(plan.steps[0].read),
        kernel_mux=kernel_mux,
        traffic=plan.board.traffic,
    )
    return Timing(costs, limits, len(plan.steps) * plan.conversion_ns)


def has_time_for_checks(costs: BusCosts, plan: ScanPlan, n_legs: int) -> bool:
    """Return whether a conversion, after the read-out of all legs, leaves time to ask for lines and settings."""
    step, select_ns = plan.steps[0], costs.lasts_ns(1)
    checks = (*step.select_checks, plan.board.setting_check)
    ask_ns = costs.of_ns([step.done.ask] if step.done else [])
    spare_ns = plan.wait_ns - ask_ns - select_ns - n_legs * (select_ns + costs.of_ns(step.read))
    return spare_ns >= costs.of_ns(check.ask for check in checks)
