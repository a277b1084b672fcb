"""Plan of a scan: order of the conversions, and the I2C transactions that they need."""

from collections.abc import Iterable, Mapping
from types import MappingProxyType
from typing import Literal, NamedTuple

from msgspec import Struct

from firmware_interface.chips.ad7147 import CLOCK_TOLERANCE_REL
from firmware_interface.chips.fdc1004 import RATES
from firmware_interface.schedule import ScanLowerBounds, scan_lower_bounds
from firmware_interface.wire_timing import BUS_FREE_NS, transaction_bits
from footsense.acquisition.boards import ad7147, fdc1004, fdc1004_columns
from footsense.acquisition.boards.board import Board, ConversionStep, ReadBackCheck, conversion_wait_ns
from footsense.ports import Transaction

#: The boards whose conversions are triggered, by their names in a configuration.
BOARDS: Mapping[str, Board] = MappingProxyType(
    {"fdc1004": fdc1004.BOARD, "fdc1004_columns": fdc1004_columns.BOARD}
)
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
    """Plan of one scan of a bus, which is repeated: board, conversion steps, timing.

    Attributes:
        board: The electronics of its feet.
        steps: The conversions in their order; the first one follows the last one of the scan before.
        conversion_ns: Nominal time of a conversion [ns].
        conversion_wait_ns: Time after which the slowest chip within its tolerance has finished [ns].
    """

    board: Board
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
        result = self.steps[0].results[0]
        return scan_lower_bounds(
            n_legs=n_legs,
            conversion_ns=self.conversion_ns,
            bus_hz=bus_hz,
            host_cost_ns=host_cost_ns,
            n_result_reads=len(result.read if whole_results else result.read_value),
            traffic=self.board.traffic,
        )

    @property
    def n_conversions(self) -> int:
        """Conversions of a leg in a scan, one after the other."""
        return len(self.steps)

    @property
    def harmless_read(self) -> Transaction:
        """Read of a chip of a leg that changes nothing: of the row switch, or of a converter's setting without one."""
        return (*self.steps[0].select_checks, *self.board.setting_checks)[0].read

    def all_checks_fit(
        self, n_legs: int, bus_hz: float, host_cost_ns: float, *, whole_results: bool = False
    ) -> bool:
        """Return whether a conversion leaves time for all checks beside all read-outs; arguments of `lower_bounds`."""
        select, step = Transaction(0, b"\0"), self.steps[0]
        reads = [read for each in step.results for read in (each.read if whole_results else each.read_value)]
        others = [done.read for done in step.done_after_start]
        others += [result.trigger for result in step.results[1:]]
        checks = [check.read for check in (*step.select_checks, *self.steps[-1].setting_checks)]
        all_of_them = [*others, select, *[select, *reads] * n_legs, *checks]
        return transactions_ns(all_of_them, bus_hz, host_cost_ns) <= self.conversion_wait_ns


class FreeRunningPlan(NamedTuple):
    """Plan of a scan of converters that run freely: times; the transactions are in `boards/ad7147.py`.

    Attributes:
        conversion_ns: Nominal time of a conversion [ns].
        conversion_wait_ns: The longest within the chip's tolerance [ns].
        n_conversions: Conversions of a leg in a scan, one after the other.
    """

    conversion_ns: int
    conversion_wait_ns: int
    n_conversions: int

    @property
    def scan_ns(self) -> int:
        """Nominal time of a scan [ns]."""
        return self.n_conversions * self.conversion_ns

    def lower_bounds(
        self, n_legs: int, bus_hz: float, host_cost_ns: float, *, whole_results: bool = False
    ) -> ScanLowerBounds:
        """Return the limits of the scan on a bus; arguments as of `ScanPlan.lower_bounds`."""
        del whole_results
        burst = [ad7147.read_results(0, self.n_conversions), ad7147.read_status(0)]
        readout_ns = n_legs * transactions_ns(burst, bus_hz, host_cost_ns)
        return ScanLowerBounds(self.n_conversions * self.conversion_wait_ns, round(readout_ns))

    def all_checks_fit(
        self, n_legs: int, bus_hz: float, host_cost_ns: float, *, whole_results: bool = False
    ) -> bool:
        """Return whether the bus carries two bursts of each leg a scan, and a check."""
        bounds = self.lower_bounds(n_legs, bus_hz, host_cost_ns, whole_results=whole_results)
        check = ad7147.element_sequence(0).checks(0)[1].read
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


def scan_plan(rate_sps: int, board: str = "fdc1004") -> ScanPlan:
    """Return the plan of a scan with a board: its conversions, in the board's order.

    Args:
        rate_sps: Conversions per second of a converter, a key of RATES.
        board: A key of BOARDS.

    Example:
        >>> plan = scan_plan(400)
        >>> [step.results[0].element for step in plan.steps]
        [5, 0, 7, 6, 4, 2, 1, 8, 3]
        >>> sum(len(step.select_changes) for step in plan.steps)
        6
        >>> [[result.element for result in step.results] for step in scan_plan(400, "fdc1004_columns").steps]
        [[0, 1, 2], [3, 4, 5], [6, 7, 8]]
    """
    electronics = BOARDS[board]
    rate = RATES[rate_sps]
    steps = [electronics.step(element, rate) for element in electronics.order]
    asked = [tuple(result.done for result in step.results) for step in steps]
    steps = [
        step._replace(
            done=done,
            done_after_start=step.done_after_start or done,
            polls_after_start=tuple(poll.read for poll in step.done_after_start or done),
            select_changes=tuple(write for write in step.select if write not in before.select),
            select_checks=tuple(
                ReadBackCheck(Transaction(write.address, b"", n_read=1), write.write) for write in step.select
            ),
            elements=tuple(result.element for result in step.results),
            reads=tuple(read for result in step.results for read in result.read_value),
        )
        for step, before, done in zip(steps, steps[-1:] + steps[:-1], asked, strict=True)
    ]
    # One a step, so that none is much longer than the others.
    for n, check in enumerate(electronics.setting_checks, -len(electronics.setting_checks)):
        steps[n] = steps[n]._replace(setting_checks=(check,))
    return ScanPlan(
        board=electronics,
        steps=tuple(steps),
        conversion_ns=rate.conversion_ns,
        conversion_wait_ns=conversion_wait_ns(rate),
    )
