"""A scan as data: in which order the nine elements are converted, and the transactions that does it take.

The order matters more than noise. While the force changes during a scan, an order that runs along the rows reads a
ramp as a tilt. In the order of the Lo-Shu magic square

    2 7 6
    9 5 1
    4 3 8        (the number is the element's position in the scan)

elements opposite each other have the same mean time, and so has every row and column: a force that grows linearly
makes no tilt at all, and the centre element stands at the frame's time. Neighbours in this order never share a
column, so that a converter with a measurement slot for each column reads from one while another converts.
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

from footsense.acquisition.boards import ad7746, fdc1004
from footsense.acquisition.boards.board import Board, Check, Done, switch_check
from footsense.ports import Transaction

_SIDE = 3

ORDERS: dict[str, tuple[int, ...]] = {
    "lo_shu": (5, 0, 7, 6, 4, 2, 1, 8, 3),
    "raster": (0, 1, 2, 3, 4, 5, 6, 7, 8),
}

BOARDS: Mapping[str, Board] = MappingProxyType({"fdc1004": fdc1004.BOARD, "ad7746": ad7746.BOARD})


class Step(NamedTuple):
    """One conversion on all legs of a bus at once.

    Attributes:
        element: Flat index of the element that is converted.
        select: Selects the element's lines, whatever was selected before.
        changes: Those of the writes that are needed after the step before.
        trigger: Starts the conversion.
        select_checks: That the line switches stand as they were told: a broadcast write is acknowledged even if one leg
            missed it, and a wrong line reads as a plausible capacitance.
        setting_checks: That the converter holds its configuration; in the last step of a scan only, for all of it.
        done: Asks whether the conversion is done; None where the result itself tells.
        read: Reads the result of one leg.
    """

    element: int
    select: tuple[Transaction, ...]
    changes: tuple[Transaction, ...]
    trigger: Transaction
    select_checks: tuple[Check, ...]
    setting_checks: tuple[Check, ...]
    done: Done | None
    read: tuple[Transaction, ...]


class ScanPlan(NamedTuple):
    """All that one bus does in one scan, again and again.

    Attributes:
        board: The electronics that it is for.
        steps: The conversions in their order; the first one follows the last one of the scan before.
        rate_sps: Conversions per second.
        conversion_ns: Nominal time of a conversion [ns].
        wait_ns: Time after which also the slowest chip has finished [ns].
    """

    board: Board
    steps: tuple[Step, ...]
    rate_sps: int
    conversion_ns: int
    wait_ns: int


def scan_plan(order: str, rate_sps: int, board: str = "fdc1004") -> ScanPlan:
    """Return the plan for a board.

    Args:
        order: A key of ORDERS.
        rate_sps: Conversions per second, one of the rates of the board's converter.
        board: A key of BOARDS.

    Example:
        >>> plan = scan_plan("lo_shu", 400)
        >>> [step.element for step in plan.steps], sum(len(step.changes) for step in plan.steps)
        ([5, 0, 7, 6, 4, 2, 1, 8, 3], 6)
    """
    of, order_of = BOARDS[board], ORDERS[order]
    elements = [of.element(*divmod(element, _SIDE), rate_sps) for element in order_of]
    before = elements[-1:] + elements[:-1]
    steps = [
        Step(
            element=number,
            select=element.select,
            changes=tuple(write for write in element.select if write not in last.select),
            trigger=element.trigger,
            select_checks=tuple(switch_check(write) for write in element.select),
            setting_checks=(),
            done=element.done,
            read=element.read,
        )
        for number, element, last in zip(order_of, elements, before, strict=True)
    ]
    steps[-1] = steps[-1]._replace(setting_checks=(of.setting_check,))
    conversion_ns = of.conversion_ns[rate_sps]
    return ScanPlan(
        board=of,
        steps=tuple(steps),
        rate_sps=rate_sps,
        conversion_ns=conversion_ns,
        wait_ns=round(conversion_ns * (1 + of.traffic.clock_tolerance_rel)),
    )
