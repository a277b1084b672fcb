"""A scan as data: in which order the nine elements are converted, and the transactions that does it take.

The order matters more than noise. While the force changes during a scan, an order that runs along the rows reads a
ramp as a tilt. In the order of the Lo-Shu magic square

    2 7 6
    9 5 1
    4 3 8        (the number is the element's position in the scan)

elements opposite each other have the same mean time, and so has every row and column: a force that grows linearly
makes no tilt at all, and the centre element stands at the frame's time. Neighbours in this order never share a
column, so a result is read from one measurement slot while another slot converts.
"""

from typing import NamedTuple

from firmware_interface import adg715, fdc1004
from footsense.drivers.fdc1004 import read_register, result_reads, write_register
from footsense.ports import Transaction

_SIDE = 3

ORDERS: dict[str, tuple[int, ...]] = {
    "lo_shu": (5, 0, 7, 6, 4, 2, 1, 8, 3),
    "raster": (0, 1, 2, 3, 4, 5, 6, 7, 8),
}


class Check(NamedTuple):
    """What every leg must answer while a conversion runs; asked of all at once, the answers are a wired AND.

    Attributes:
        ask: A read that changes nothing.
        expected: The answer of a leg that holds its setting.
    """

    ask: Transaction
    expected: bytes


def row_check(switches: int) -> Check:
    """Return the question whether the row switch stands as it was told."""
    return Check(Transaction(adg715.ADDRESS, b"", n_read=1), bytes((switches,)))


def setting_check(capdac: int = 0) -> Check:
    """Return the question for the second column's configuration: after a reset it reads as the first column's."""
    return Check(
        read_register(fdc1004.Register.CONF_MEAS1 + 1),
        fdc1004.measurement_config(1, capdac).to_bytes(2, "big"),
    )


class Step(NamedTuple):
    """One conversion on all legs of a bus at once.

    Attributes:
        element: Flat index of the element that is converted.
        slot: Measurement slot of the converter, which is the element's column.
        select_row: Puts the element's row to ground and the others to the shield.
        row_changes: Whether the step before left another row selected.
        trigger: Starts the conversion.
        row_check: That the row switch stands as it was told: a broadcast write is acknowledged even if one leg missed
            it, and a wrong row reads as a plausible capacitance.
        setting_check: That the converter holds its configuration, which a dip of its supply resets: every slot then
            reads column 0. In the last step of a scan only, for all of it; else None.
        read: Reads the result of one leg.
    """

    element: int
    slot: int
    select_row: Transaction
    row_changes: bool
    trigger: Transaction
    row_check: Check
    setting_check: Check | None
    read: tuple[Transaction, ...]


class ScanPlan(NamedTuple):
    """All that one bus does in one scan, again and again.

    Attributes:
        steps: The conversions in their order; the first one follows the last one of the scan before.
        rate_sps: Conversions per second.
        conversion_ns: Nominal time of a conversion [ns].
        wait_ns: Time after which also the slowest chip has finished [ns].
    """

    steps: tuple[Step, ...]
    rate_sps: int
    conversion_ns: int
    wait_ns: int


def scan_plan(order: str, rate_sps: int) -> ScanPlan:
    """Return the plan for the board `fdc1004`.

    Args:
        order: A key of ORDERS.
        rate_sps: Conversions per second: 100, 200 or 400.

    Example:
        >>> plan = scan_plan("lo_shu", 400)
        >>> [step.element for step in plan.steps], sum(step.row_changes for step in plan.steps)
        ([5, 0, 7, 6, 4, 2, 1, 8, 3], 6)
    """
    elements = ORDERS[order]
    rows = [element // _SIDE for element in elements]
    row_changes = [row != before for row, before in zip(rows, rows[-1:] + rows[:-1], strict=True)]
    last = len(elements) - 1
    steps = []
    for position, element in enumerate(elements):
        row, column = divmod(element, _SIDE)
        switches = adg715.select_rows(1 << row)
        steps.append(
            Step(
                element=element,
                slot=column,
                select_row=Transaction(adg715.ADDRESS, bytes((switches,))),
                row_changes=row_changes[position],
                trigger=write_register(fdc1004.Register.FDC_CONF, fdc1004.trigger(rate_sps, column)),
                row_check=row_check(switches),
                setting_check=setting_check() if position == last else None,
                read=result_reads(column, rate_sps),
            )
        )
    conversion_ns = fdc1004.RATES[rate_sps].conversion_ns
    return ScanPlan(
        steps=tuple(steps),
        rate_sps=rate_sps,
        conversion_ns=conversion_ns,
        wait_ns=round(conversion_ns * (1 + fdc1004.CLOCK_TOLERANCE_REL)),
    )
