"""A scan as data: the order of the nine conversions, and the I2C transactions that they need.

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
from footsense.acquisition.boards.board import Board, Check, Step
from footsense.ports import Transaction

#: Elements in the order of their conversion, by flat index.
ORDERS: dict[str, tuple[int, ...]] = {
    "lo_shu": (5, 0, 7, 6, 4, 2, 1, 8, 3),
    "raster": (0, 1, 2, 3, 4, 5, 6, 7, 8),
}

BOARDS: Mapping[str, Board] = MappingProxyType({"fdc1004": fdc1004.BOARD, "ad7746": ad7746.BOARD})


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


def scan_plan(order: str, rate_sps: int, board: str = "fdc1004") -> ScanPlan:
    """Return the scan of a board.

    Args:
        order: A key of ORDERS.
        rate_sps: Conversions per second, one of the rates of the board's converter.
        board: A key of BOARDS.

    Example:
        >>> plan = scan_plan("lo_shu", 400)
        >>> [step.element for step in plan.steps], sum(len(step.changes) for step in plan.steps)
        ([5, 0, 7, 6, 4, 2, 1, 8, 3], 6)
    """
    electronics = BOARDS[board]
    steps = [electronics.step(element, rate_sps) for element in ORDERS[order]]
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
