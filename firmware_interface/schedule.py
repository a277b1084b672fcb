"""How fast a scan can be: what chips, bus and host allow, whatever program drives them.

`README.md` in this folder derives it in words. The scanner plans with these figures, and `footsense bench` holds what
it reaches against them.
"""

from typing import NamedTuple

from firmware_interface.fdc1004 import CLOCK_TOLERANCE_REL
from firmware_interface.i2c_timing import transaction_bits, wire_time_ns

__all__ = ["ScanLimits", "scan_limits"]

_ELEMENTS = 9
#: A scan that goes through the rows one after the other switches them as seldom as can be.
_ROW_SWITCHES = 3


class ScanLimits(NamedTuple):
    """The shortest scans that two limits allow; the longer one holds.

    Attributes:
        conversion_ns: Nine conversions by a slow chip, and what cannot overlap with them [ns].
        readout_ns: Nine read-outs of all legs [ns].
    """

    conversion_ns: int
    readout_ns: int

    @property
    def scan_ns(self) -> int:
        """Return the shortest scan [ns]."""
        return max(self)

    @property
    def holds(self) -> str:
        """Return which limit holds: `conversion` or `read-out`."""
        return "conversion" if self.conversion_ns >= self.readout_ns else "read-out"


def scan_limits(
    *,
    n_legs: int,
    conversion_ns: int,
    rate_hz: float,
    host_cost_ns: float,
    n_result_reads: int = 1,
    kernel_mux: bool = False,
) -> ScanLimits:
    """Return the limits of a scan of nine elements of all legs on one bus.

    Args:
        n_legs: Legs on the bus.
        conversion_ns: Nominal conversion time [ns].
        rate_hz: Clock of the bus [Hz].
        host_cost_ns: What the host adds to every transaction [ns].
        n_result_reads: Registers of a result that are read: 1 or 2.
        kernel_mux: Whether the kernel switches the mux: each leg is then told and read by itself, and the switch is on
            the wire, but costs the host no transaction of its own.

    Example:
        >>> limits = scan_limits(n_legs=6, conversion_ns=2_500_000, rate_hz=400_000, host_cost_ns=40_000)
        >>> limits.holds, round(limits.scan_ns / 22.5e6, 3)
        ('conversion', 1.087)
        >>> limits = scan_limits(
        ...     n_legs=6, conversion_ns=2_500_000, rate_hz=400_000, host_cost_ns=40_000, kernel_mux=True
        ... )
        >>> limits.holds, round(limits.scan_ns / 22.5e6, 3)
        ('read-out', 1.298)
    """

    def lasts(n_write: int, n_read: int = 0) -> int:
        return round(wire_time_ns(transaction_bits(n_write, n_read), round(rate_hz)) + host_cost_ns)

    select, start, ask = lasts(1), lasts(3), lasts(1, 2)
    read = n_result_reads * ask
    wait = round(conversion_ns * (1 + CLOCK_TOLERANCE_REL))
    rows = _ROW_SWITCHES * select  # a row switch is a byte to one address, as the selection of a channel is
    if not kernel_mux:
        readout = select + start + ask + n_legs * (select + read)
        return ScanLimits(_ELEMENTS * (wait + start) + rows, _ELEMENTS * readout + rows)
    switch = round(select - host_cost_ns)
    leg = _ELEMENTS * (switch + start) + rows
    return ScanLimits(_ELEMENTS * wait + leg, n_legs * (leg + _ELEMENTS * (ask + read)))
