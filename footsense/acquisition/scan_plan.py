"""A scan as data: the order of the conversions, and the I2C transactions that they need.

The order matters more than noise. While the force changes during a scan, an order that runs along the rows reads a
ramp as a tilt. In the order of the Lo-Shu magic square

    2 7 6
    9 5 1
    4 3 8        (the number is the element's position in the scan)

elements opposite each other have the same mean time, and so has every row and column: a force that grows linearly
makes no tilt at all, and the centre element stands at the frame's time. Neighbours in this order never share a
column, so that a converter with a measurement slot for each column reads from one while another converts.

Four by four elements have such squares too; the one here needs as few changes of the row as any. Two by two have none:
their rows have the same mean time, and their columns differ by a conversion.
"""

import math
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import NamedTuple

from footsense.acquisition.boards import ad7746, fdc1004
from footsense.acquisition.boards.board import Board, Check, Step
from footsense.ports import Transaction

#: Elements in the order of a magic square, by flat index, of each number of rows.
_MAGIC_SQUARE_ORDERS: Mapping[int, tuple[int, ...]] = MappingProxyType(
    {
        2: (0, 3, 2, 1),
        3: (5, 0, 7, 6, 4, 2, 1, 8, 3),
        4: (0, 7, 13, 10, 11, 12, 6, 1, 14, 9, 3, 4, 5, 2, 8, 15),
    }
)


def conversion_order(order: str, rows: int) -> tuple[int, ...]:
    """Return the elements of a foot in the order of their conversion, by flat index.

    Args:
        order: A key of ORDERS.
        rows: Rows of elements, and as many columns: 2 to 4.

    Example:
        >>> conversion_order("lo_shu", 2), conversion_order("raster", 2)
        ((0, 3, 2, 1), (0, 1, 2, 3))
    """
    return _MAGIC_SQUARE_ORDERS[rows] if order == "lo_shu" else tuple(range(rows**2))


#: The orders of the paper's foot.
CONVERSION_ORDERS: dict[str, tuple[int, ...]] = {
    name: conversion_order(name, 3) for name in ("lo_shu", "raster")
}

#: The boards, each for a number of rows.
BOARDS: Mapping[str, Callable[[int], Board]] = MappingProxyType(
    {"fdc1004": fdc1004.board, "ad7746": ad7746.board}
)


class ScanPlan(NamedTuple):
    """The conversions of one scan of a bus, which is repeated.

    Attributes:
        board: The electronics of its feet.
        steps: The conversions in their order; the first one follows the last one of the scan before.
        conversion_ns: Nominal time of a conversion [ns].
        wait_ns: Time after which the slowest chip within its tolerance has finished [ns].
    """

    board: Board
    steps: tuple[Step, ...]
    conversion_ns: int
    wait_ns: int

    @property
    def rows(self) -> int:
        """Rows of elements of each foot, and as many columns."""
        return math.isqrt(len(self.steps))


def scan_plan(order: str, rate_sps: int, board: str = "fdc1004", rows: int = 3) -> ScanPlan:
    """Return the scan of a board.

    Args:
        order: A key of ORDERS.
        rate_sps: Conversions per second, one of the rates of the board's converter.
        board: A key of BOARDS.
        rows: Rows of elements of each foot, and as many columns: 2 to 4.

    Example:
        >>> plan = scan_plan("lo_shu", 400)
        >>> [step.element for step in plan.steps], sum(len(step.changes) for step in plan.steps)
        ([5, 0, 7, 6, 4, 2, 1, 8, 3], 6)
    """
    electronics = BOARDS[board](rows)
    steps = [electronics.step(element, rate_sps) for element in conversion_order(order, rows)]
    steps = [
        step._replace(
            changes=tuple(write for write in step.select if write not in before.select),
            select_checks=tuple(
                Check(Transaction(write.address, b"", n_read=1), write.write) for write in step.select
            ),
        )
        for step, before in zip(steps, steps[-1:] + steps[:-1], strict=True)
    ]
    steps[-1] = steps[-1]._replace(setting_checks=(electronics.setting_check,))
    return ScanPlan(
        board=electronics,
        steps=tuple(steps),
        conversion_ns=electronics.conversion_ns[rate_sps],
        wait_ns=electronics.wait_ns(rate_sps),
    )
