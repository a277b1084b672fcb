"""Duration of the transactions of an I2C bus, and the shortest scan that they allow.

A Linux adapter does not report its clock, and often does not keep the configured one: on a Raspberry Pi it follows the
processor's. So two reads of one chip, a short and a long one, are timed at start: their difference gives the clock, the
rest is the time that interpreter, system call and interrupts add to every transaction.
"""

import contextlib
from collections.abc import Sequence
from statistics import median
from typing import NamedTuple

from firmware_interface.schedule import ScanLowerBounds
from firmware_interface.wire_timing import BUS_FREE_NS, transaction_bits
from footsense.acquisition.leg_bus import LegBus
from footsense.acquisition.scan_plan import AnyPlan
from footsense.errors import HardwareError, I2cError, NackError
from footsense.ports import Clock, I2cBus, Transaction

_SHORT_READ_BYTES, _LONG_READ_BYTES = 1, 33
_N_TIMED_READS = 9


class BusTiming(NamedTuple):
    """Transaction costs and scan period limits of one I2C bus.

    Attributes:
        bus_hz: Clock of the bus [Hz].
        host_ns_per_transaction: Time that the host adds to each transaction [ns].
        lower_bounds: The shortest scans that they allow.
        conversions_ns: Time of all conversions of a scan without any transaction [ns].
        all_checks_fit: Whether the bus carries all checks that a scan may have beside the read-out of all legs.
    """

    bus_hz: float
    host_ns_per_transaction: float
    lower_bounds: ScanLowerBounds
    conversions_ns: int
    all_checks_fit: bool

    def with_whole_results(self, plan: AnyPlan, n_legs: int) -> "BusTiming":
        """Return the timing of the same bus if whole results have to be read of its legs' chips."""
        return _timing(self.bus_hz, self.host_ns_per_transaction, plan, n_legs, whole_results=True)

    def __str__(self) -> str:
        """Return the timing as one line of text for the log."""
        bound_ns = self.lower_bounds.scan_period_bound_ns
        return (
            f"{self.bus_hz * 1e-3:.0f} kHz and {self.host_ns_per_transaction * 1e-3:.0f} us of host per transaction; "
            f"the best scan takes {bound_ns * 1e-6:.1f} ms, {bound_ns / self.conversions_ns:.2f} x its conversions; "
            f"the limit is the {self.lower_bounds.limiting_factor}"
        )


def measure_bus_timing(
    bus: LegBus, clock: Clock, plan: AnyPlan, n_legs: int, addresses: Sequence[int]
) -> BusTiming | None:
    """Measure a bus by reads of its mux, or of a leg's chip without one; return its scan limits.

    Args:
        bus: The bus.
        clock: Its clock.
        plan: The scan to come.
        n_legs: Legs on the bus.
        addresses: Addresses of chips of legs, one of which is read without a mux.

    Returns:
        The timing; None if no leg without a mux answers.

    Raises:
        HardwareError: The mux does not answer, or a line is stuck: no leg can be reached.
    """
    plan = plan.on_bus(bus.mux_address)
    if bus.mux_address is None:
        for address in addresses:
            with contextlib.suppress(I2cError):
                return _measured(bus.adapter, clock, address, plan, n_legs)
        return None
    mux = f"the mux (TCA9548A) at {bus.mux_address:#04x}"
    try:
        if not bus.free_bus():
            bus.connect(0)
        return _measured(bus.adapter, clock, bus.mux_address, plan, n_legs)
    except NackError as error:
        raise HardwareError(
            f"no answer from {mux}: check its power, its wires and its address straps A0..A2"
        ) from error
    except I2cError as error:
        raise HardwareError(f"{mux} cannot be reached: {error}") from error


def _measured(bus: I2cBus, clock: Clock, address: int, plan: AnyPlan, n_legs: int) -> BusTiming:
    """Return a bus's timing, measured by short and long reads of a chip; raise its error if none passes."""
    short_ns, long_ns = (
        _median_ns(bus, clock, Transaction(address, b"", n_read))
        for n_read in (_SHORT_READ_BYTES, _LONG_READ_BYTES)
    )
    short_bits = transaction_bits(0, _SHORT_READ_BYTES)
    bit_ns = max(long_ns - short_ns, 1.0) / (transaction_bits(0, _LONG_READ_BYTES) - short_bits)
    host_ns = max(short_ns - BUS_FREE_NS - short_bits * bit_ns, 0.0)
    return _timing(1e9 / bit_ns, host_ns, plan, n_legs, whole_results=False)


def _timing(bus_hz: float, host_ns: float, plan: AnyPlan, n_legs: int, *, whole_results: bool) -> BusTiming:
    """Return the timing of a bus with given costs; read of each result is the value or the whole."""
    return BusTiming(
        bus_hz=bus_hz,
        host_ns_per_transaction=host_ns,
        lower_bounds=plan.lower_bounds(n_legs, bus_hz, host_ns, whole_results=whole_results),
        conversions_ns=plan.n_conversions * plan.conversion_ns,
        all_checks_fit=plan.all_checks_fit(n_legs, bus_hz, host_ns, whole_results=whole_results),
    )


def _median_ns(bus: I2cBus, clock: Clock, read: Transaction) -> float:
    """Return the median duration of a read [ns]; raise its error if none passes."""
    durations_ns, lost = [], None
    for _ in range(_N_TIMED_READS):
        start_ns = clock.now_ns()
        try:
            bus.transfer(read)
        except NackError as error:  # one acknowledge that is lost changes no median
            lost = error
        else:
            durations_ns.append(clock.now_ns() - start_ns)
    if lost is not None and not durations_ns:
        raise lost
    return median(durations_ns)
