"""Duration of I2C transactions on a bus, measured at start, and the scan limits that follow from it.

A Linux adapter does not report its clock, and often does not keep the configured one: on a Raspberry Pi it follows the
processor's. So two reads of one chip, a short and a long one, are timed: their difference gives the clock, the rest is
the time that interpreter, system call and interrupts add to every transaction.
"""

from collections.abc import Iterable
from statistics import median
from typing import NamedTuple

from firmware_interface.schedule import ScanLowerBounds, scan_lower_bounds
from firmware_interface.wire_timing import BUS_FREE_NS, transaction_bits
from footsense.acquisition.scan_plan import ScanPlan
from footsense.errors import NackError
from footsense.frames import ELEMENTS
from footsense.ports import Clock, I2cBus, Transaction

_SHORT_READ_BYTES, _LONG_READ_BYTES = 1, 33  # bytes read
_N_TIMED_READS = 9


class BusCosts(NamedTuple):
    """Duration of a transaction on one bus: bus clock rate, and fixed cost on the host.

    Attributes:
        bus_hz: Clock of the bus [Hz].
        host_ns_per_transaction: Time that the host adds to each transaction [ns].
    """

    bus_hz: float
    host_ns_per_transaction: float

    def transaction_ns(self, n_write: int, n_read: int = 0) -> float:
        """Return the duration of a transaction that writes and reads so many bytes [ns]."""
        return (
            transaction_bits(n_write, n_read) * 1e9 / self.bus_hz + BUS_FREE_NS + self.host_ns_per_transaction
        )

    def total_ns(self, transactions: Iterable[Transaction]) -> float:
        """Return the total duration of several transactions [ns]."""
        return sum(self.transaction_ns(len(each.write), each.n_read) for each in transactions)


def measure_bus_costs(bus: I2cBus, clock: Clock, address: int) -> BusCosts:
    """Return a bus's clock rate and host cost, measured by short and long reads of one chip.

    Args:
        bus: The adapter.
        clock: The time that it lives in.
        address: Address of a TCA9548A or an ADG715.

    Raises:
        I2cError: The chip does not answer.
    """

    def transaction_ns(n_read: int) -> float:
        transaction = Transaction(address, b"", n_read)
        durations_ns = []
        lost = None
        for _ in range(_N_TIMED_READS):
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

    short_ns, long_ns = transaction_ns(_SHORT_READ_BYTES), transaction_ns(_LONG_READ_BYTES)
    bits = transaction_bits(0, _LONG_READ_BYTES) - transaction_bits(0, _SHORT_READ_BYTES)
    bit_ns = max(long_ns - short_ns, 1.0) / bits
    host_cost_ns = short_ns - BUS_FREE_NS - transaction_bits(0, _SHORT_READ_BYTES) * bit_ns
    return BusCosts(1e9 / bit_ns, max(host_cost_ns, 0.0))


class BusTiming(NamedTuple):
    """Transaction costs and scan period limits of one I2C bus.

    Attributes:
        costs: Cost of its transactions.
        lower_bounds: The shortest scans that they allow.
        conversions_ns: Time of all conversions without any transaction [ns].
    """

    costs: BusCosts
    lower_bounds: ScanLowerBounds
    conversions_ns: int

    @property
    def conversion_age_limit_ns(self) -> int:
        """Age of a running conversion above which the loop counts as delayed [ns]: two conversion steps."""
        return 2 * self.lower_bounds.scan_period_bound_ns // ELEMENTS

    def __str__(self) -> str:
        """Return the timing as one line of text for the log."""
        rate_hz, host_cost_ns = self.costs
        return (
            f"{rate_hz * 1e-3:.0f} kHz and {host_cost_ns * 1e-3:.0f} us of host per transaction; the best scan takes "
            f"{self.lower_bounds.scan_period_bound_ns * 1e-6:.1f} ms, "
            f"{self.lower_bounds.scan_period_bound_ns / self.conversions_ns:.2f} x its "
            f"conversions; the limit is the {self.lower_bounds.limiting_factor}"
        )


def bus_timing(costs: BusCosts, plan: ScanPlan, n_legs: int, *, kernel_mux: bool) -> BusTiming:
    """Return the transaction costs, scan limits and conversion time of a bus.

    Args:
        costs: Cost of its transactions.
        plan: The conversions of one scan.
        n_legs: Legs on it.
        kernel_mux: Whether the kernel drives its mux.
    """
    limits = scan_lower_bounds(
        n_legs=n_legs,
        conversion_ns=plan.conversion_ns,
        bus_hz=costs.bus_hz,
        host_cost_ns=costs.host_ns_per_transaction,
        n_result_reads=len(plan.steps[0].read),
        kernel_mux=kernel_mux,
        traffic=plan.board.traffic,
    )
    return BusTiming(costs, limits, len(plan.steps) * plan.conversion_ns)


def checks_that_fit(costs: BusCosts, plan: ScanPlan, n_legs: int) -> tuple[bool, bool]:
    """Return which read-back checks fit into a conversion beside the read-out of all legs.

    Returns:
        Whether there is time to ask for lines and settings, and then to read the mux back after every leg.
    """
    step, select_ns = plan.steps[0], costs.transaction_ns(1)
    checks = (*step.select_checks, plan.board.setting_check)
    ask_ns = costs.total_ns([step.done.read] if step.done else [])
    spare_ns = plan.conversion_wait_ns - ask_ns - select_ns - n_legs * (select_ns + costs.total_ns(step.read))
    spare_ns -= costs.total_ns(check.read for check in checks)
    return spare_ns >= 0, spare_ns >= (1 + n_legs) * costs.transaction_ns(0, 1)
