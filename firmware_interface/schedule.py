"""Lower bounds of the scan period, set by chips, I2C bus and host and independent of the program.

`README.md` in this folder derives it in words. The scanner plans with these figures, and `footsense dev benchmark`
compares the measured scan with them.
"""

from typing import NamedTuple

from firmware_interface.chips import adg715, fdc1004
from firmware_interface.wire_timing import i2c_bus_time_ns, transaction_bits

_ELEMENTS = adg715.N_LINES**2


class ConversionTraffic(NamedTuple):
    """I2C traffic of one conversion on a board, as far as boards differ in it.

    Attributes:
        n_switches: Fewest switches of rows in a scan: one for each row, or none without a row switch.
        n_converters: Converters of a leg, each of which converts an element at the same time.
        done_poll_bytes: Bytes written and read to ask one of them, on all legs, whether it is done.
    """

    n_switches: int
    n_converters: int
    done_poll_bytes: tuple[int, int]


FDC1004_TRAFFIC = ConversionTraffic(n_switches=adg715.N_LINES, n_converters=1, done_poll_bytes=(1, 2))
FDC1004_COLUMNS_TRAFFIC = ConversionTraffic(n_switches=0, n_converters=adg715.N_LINES, done_poll_bytes=(0, 2))
#: Bytes of the write that starts a conversion; bytes written and read for one register of a result.
_START_BYTES, _RESULT_READ_BYTES = 3, (1, 2)


class ScanLowerBounds(NamedTuple):
    """Lower bounds of the scan period by conversion time and by read-out time; the larger one applies.

    Attributes:
        conversion_bound_ns: All conversions by a slow chip, and what cannot overlap with them [ns]: switches of rows,
            and the start of the next conversion, which without such a switch may end with the one before.
        readout_bound_ns: All read-outs of all legs [ns].
    """

    conversion_bound_ns: int
    readout_bound_ns: int

    @property
    def scan_period_bound_ns(self) -> int:
        """Lower bound of the scan period [ns]: the larger of the two."""
        return max(self)

    @property
    def limiting_factor(self) -> str:
        """The bound that applies: `conversion` or `read-out`."""
        return "conversion" if self.conversion_bound_ns >= self.readout_bound_ns else "read-out"


def scan_lower_bounds(
    *,
    n_legs: int,
    conversion_ns: int,
    bus_hz: float,
    host_cost_ns: float,
    n_result_reads: int = 1,
    traffic: ConversionTraffic = FDC1004_TRAFFIC,
) -> ScanLowerBounds:
    """Return the lower bounds of the period of a scan of all elements of all legs on one I2C bus.

    Args:
        n_legs: Legs on the bus.
        conversion_ns: Nominal conversion time [ns].
        bus_hz: Clock of the bus [Hz].
        host_cost_ns: Time that the host adds to every transaction [ns].
        n_result_reads: Transactions that read a result: 1 or 2.
        traffic: The board's transactions.

    Example:
        >>> limits = scan_lower_bounds(n_legs=6, conversion_ns=2_500_000, bus_hz=400_000, host_cost_ns=40_000)
        >>> limits.limiting_factor, round(limits.scan_period_bound_ns / 22.5e6, 3)
        ('conversion', 1.087)
        >>> limits = scan_lower_bounds(
        ...     n_legs=3, conversion_ns=2_500_000, bus_hz=400_000, host_cost_ns=40_000, traffic=FDC1004_COLUMNS_TRAFFIC
        ... )
        >>> limits.limiting_factor, round(limits.scan_period_bound_ns / 7.5e6, 3)
        ('read-out', 1.027)
    """

    def transaction_ns(n_write: int, n_read: int = 0) -> int:
        return round(i2c_bus_time_ns(transaction_bits(n_write, n_read), round(bus_hz)) + host_cost_ns)

    select, start, ask = (
        transaction_ns(1),
        transaction_ns(_START_BYTES),
        transaction_ns(*traffic.done_poll_bytes),
    )
    read = n_result_reads * transaction_ns(*_RESULT_READ_BYTES)
    wait = round(conversion_ns * (1 + fdc1004.CLOCK_TOLERANCE_REL))
    # A row switch takes a byte, as the selection of a channel does.
    rows, n_steps = traffic.n_switches * select, _ELEMENTS // traffic.n_converters
    readout = select + n_legs * select + traffic.n_converters * (start + ask + n_legs * read)
    conversions = n_steps * (wait + start) if traffic.n_switches else n_steps * wait
    return ScanLowerBounds(conversions + rows, n_steps * readout + rows)
