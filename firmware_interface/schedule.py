"""Lower bounds of the scan period, set by chips, I2C bus and host and independent of the program.

`README.md` in this folder derives it in words. The scanner plans with these figures, and `footsense dev benchmark`
compares the measured scan with them.
"""

from typing import NamedTuple

from firmware_interface.chips import adg715, fdc1004
from firmware_interface.wire_timing import i2c_bus_time_ns, transaction_bits

_ELEMENTS = adg715.N_LINES**2


#: Bytes of the write that starts a conversion; bytes written and read for one register, of a result or DONE.
_START_BYTES, _READ_BYTES = 3, (1, 2)


class ScanLowerBounds(NamedTuple):
    """Lower bounds of the scan period by conversion time and by read-out time; the larger one applies.

    Attributes:
        conversion_bound_ns: All conversions by a slow chip, and what cannot overlap with them [ns]: switches of rows,
            and the start of the next conversion.
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
) -> ScanLowerBounds:
    """Return the lower bounds of the period of a scan of all elements of all legs on one I2C bus.

    Args:
        n_legs: Legs on the bus.
        conversion_ns: Nominal conversion time [ns].
        bus_hz: Clock of the bus [Hz].
        host_cost_ns: Time that the host adds to every transaction [ns].
        n_result_reads: Transactions that read a result: 1 or 2.

    Example:
        >>> limits = scan_lower_bounds(n_legs=6, conversion_ns=2_500_000, bus_hz=400_000, host_cost_ns=40_000)
        >>> limits.limiting_factor, round(limits.scan_period_bound_ns / 22.5e6, 3)
        ('conversion', 1.087)
    """

    def transaction_ns(n_write: int, n_read: int = 0) -> int:
        return round(i2c_bus_time_ns(transaction_bits(n_write, n_read), round(bus_hz)) + host_cost_ns)

    select, start, read = transaction_ns(1), transaction_ns(_START_BYTES), transaction_ns(*_READ_BYTES)
    wait = round(conversion_ns * (1 + fdc1004.CLOCK_TOLERANCE_REL))
    # A row switch takes a byte, as the selection of a channel does; a scan has one for each row at least.
    rows = adg715.N_LINES * select
    readout = select + start + read + n_legs * (select + n_result_reads * read)
    return ScanLowerBounds(_ELEMENTS * (wait + start) + rows, _ELEMENTS * readout + rows)
