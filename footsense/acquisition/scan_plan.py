"""Plan of a scan: order of the conversions, and the I2C transactions that they need."""

from collections.abc import Iterable
from typing import Literal, NamedTuple

from msgspec import Struct

from firmware_interface.chips.ad7147 import CLOCK_TOLERANCE_REL
from firmware_interface.chips.fdc1004 import RATES
from firmware_interface.schedule import ScanLowerBounds, scan_lower_bounds
from firmware_interface.wire_timing import BUS_FREE_NS, transaction_bits
from footsense.acquisition.boards import ad7147, fdc1004
from footsense.acquisition.boards.board import ConversionStep, conversion_wait_ns
from footsense.ports import Transaction

#: The most conversions per second of a converter.
FASTEST_SPS = max(RATES)


class Scan(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Section `scan` of a configuration: conversion rate.

    Attributes:
        rate_sps: Conversions per second of one converter; 100, 200 or 400; a lower rate has less noise. None for 400.
            Board `ad7147` has one rate.
    """

    rate_sps: Literal[100, 200, 400] | None = None


class ScanPlan(NamedTuple):
    """Plan of one scan of a bus with board `fdc1004`, which is repeated: conversion steps, timing.

    Attributes:
        steps: The conversions in their order; the first one follows the last one of the scan before.
        conversion_ns: Nominal time of a conversion [ns].
        conversion_wait_ns: Time after which the slowest chip within its tolerance has finished [ns].
    """

    steps: tuple[ConversionStep, ...]
    conversion_ns: int
    conversion_wait_ns: int

    def lower_bounds(
        self, n_legs: int, bus_hz: float, host_cost_ns: float, *, whole_results: bool = False
    ) -> ScanLowerBounds:
        """Return the limits of the scan on a bus.

        Args:
            n_legs: Legs on the bus.
            bus_hz: Its clock [Hz].
            host_cost_ns: Time that the host adds to each transaction [ns].
            whole_results: Whether a converter has both registers of a result read.
        """
        step = self.steps[0]
        return scan_lower_bounds(
            n_legs=n_legs,
            conversion_ns=self.conversion_ns,
            bus_hz=bus_hz,
            host_cost_ns=host_cost_ns,
            n_result_reads=len(step.read if whole_results else step.read_value),
        )

    def on_bus(self, mux_address: int | None) -> "ScanPlan":
        """Return the plan for a bus with a mux or without: itself, its limits have the selections."""
        del mux_address
        return self

    @property
    def n_conversions(self) -> int:
        """Conversions of a leg in a scan, one after the other."""
        return len(self.steps)

    @property
    def longest_frame_ns(self) -> int:
        """Longest time of a frame, while nothing fails [ns]: of a conversion."""
        return self.conversion_wait_ns

    @property
    def harmless_read(self) -> Transaction:
        """Read of a chip of a leg that changes nothing: of the row switch."""
        return self.steps[0].select_check.read

    def all_checks_fit(
        self, n_legs: int, bus_hz: float, host_cost_ns: float, *, whole_results: bool = False
    ) -> bool:
        """Return whether a conversion leaves time for all checks beside all read-outs; arguments of `lower_bounds`."""
        select, step = Transaction(0, b"\0"), self.steps[0]
        reads = step.read if whole_results else step.read_value
        checks = [step.select_check.read, fdc1004.SETTING_CHECK.read]
        all_of_them = [step.done.read, select, *[select, *reads] * n_legs, *checks]
        return transactions_ns(all_of_them, bus_hz, host_cost_ns) <= self.conversion_wait_ns


class FreeRunningPlan(NamedTuple):
    """Plan of a scan of converters that run freely: times; the transactions are in `boards/ad7147.py`.

    Attributes:
        conversion_ns: Nominal time of a conversion [ns].
        conversion_wait_ns: The longest within the chip's tolerance [ns].
        n_conversions: Conversions of a leg in a scan, one after the other.
        has_mux: Whether each leg is selected before it is read.
    """

    conversion_ns: int
    conversion_wait_ns: int
    n_conversions: int
    has_mux: bool = False

    def on_bus(self, mux_address: int | None) -> "FreeRunningPlan":
        """Return the plan for a bus with a mux at an address, or without one."""
        return self._replace(has_mux=mux_address is not None)

    @property
    def scan_ns(self) -> int:
        """Nominal time of a scan [ns]."""
        return self.n_conversions * self.conversion_ns

    @property
    def longest_frame_ns(self) -> int:
        """Longest time of a frame, while nothing fails [ns]: of a scan."""
        return self.scan_ns

    def lower_bounds(
        self, n_legs: int, bus_hz: float, host_cost_ns: float, *, whole_results: bool = False
    ) -> ScanLowerBounds:
        """Return the limits of the scan on a bus; arguments as of `ScanPlan.lower_bounds`."""
        del whole_results
        burst = [ad7147.read_results(0, self.n_conversions), ad7147.read_status(0)]
        burst += [Transaction(0, b"\0")] * self.has_mux
        readout_ns = n_legs * transactions_ns(burst, bus_hz, host_cost_ns)
        return ScanLowerBounds(self.n_conversions * self.conversion_wait_ns, round(readout_ns))

    def all_checks_fit(
        self, n_legs: int, bus_hz: float, host_cost_ns: float, *, whole_results: bool = False
    ) -> bool:
        """Return whether the bus carries two bursts of each leg a scan, and a check."""
        bounds = self.lower_bounds(n_legs, bus_hz, host_cost_ns, whole_results=whole_results)
        check = ad7147.element_sequence((0,) * len(ad7147.ORDER)).checks(0)[1].read
        return 2 * bounds.readout_bound_ns + transactions_ns([check], bus_hz, host_cost_ns) <= self.scan_ns


def transactions_ns(transactions: Iterable[Transaction], bus_hz: float, host_cost_ns: float) -> float:
    """Return the time of transactions on a bus one after the other [ns].

    Args:
        transactions: The transactions.
        bus_hz: Clock of the bus [Hz].
        host_cost_ns: Time that the host adds to each [ns].
    """
    return sum(
        transaction_bits(len(each.write), each.n_read) * 1e9 / bus_hz + BUS_FREE_NS + host_cost_ns
        for each in transactions
    )


AnyPlan = ScanPlan | FreeRunningPlan
#: The scan of board `ad7147`.
AD7147_PLAN = FreeRunningPlan(
    ad7147.RATE.conversion_ns, round(ad7147.RATE.conversion_ns * (1 + CLOCK_TOLERANCE_REL)), len(ad7147.ORDER)
)

#: Read-out of a scan over its conversions, above which a bus is too slow for the rate asked [1].
_TOLERATED_READOUT_REL = 1.06


def bus_overload(plan: AnyPlan, bounds: ScanLowerBounds) -> str | None:
    """Return that a bus does not carry the rate of a plan, and which it does, in words; None if it does.

    Args:
        plan: The plan.
        bounds: Limits of the scan on that bus.
    """
    if bounds.readout_bound_ns <= _TOLERATED_READOUT_REL * plan.n_conversions * plan.conversion_ns:
        return None
    carried_hz, asked_hz = 1e9 * plan.n_conversions / bounds.readout_bound_ns, 1e9 / plan.conversion_ns
    if isinstance(plan, FreeRunningPlan):
        share = "share its legs between more buses"
        return f"carries {carried_hz:.0f} of {asked_hz:.0f} conversions/s of each converter; {share}"
    return (
        f"carries at most {carried_hz:.0f} conversions/s of each converter, {asked_hz:.0f} are asked for; share its "
        "legs between more buses, or lower scan.rate_sps"
    )


def scan_plan(rate_sps: int) -> ScanPlan:
    """Return the plan of a scan with board `fdc1004`: its conversions, in the board's order.

    Args:
        rate_sps: Conversions per second of a converter, a key of RATES.

    Example:
        >>> plan = scan_plan(400)
        >>> [step.element for step in plan.steps]
        [5, 0, 7, 6, 4, 2, 1, 8, 3]
        >>> sum(len(step.select_changes) for step in plan.steps)
        6
    """
    rate = RATES[rate_sps]
    steps = [fdc1004.step(element, rate) for element in fdc1004.ORDER]
    steps = [
        step._replace(select_changes=() if step.select == before.select else (step.select,))
        for step, before in zip(steps, steps[-1:] + steps[:-1], strict=True)
    ]
    steps[-1] = steps[-1]._replace(setting_checks=(fdc1004.SETTING_CHECK,))
    return ScanPlan(
        steps=tuple(steps),
        conversion_ns=rate.conversion_ns,
        conversion_wait_ns=conversion_wait_ns(rate),
    )
