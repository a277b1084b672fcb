"""Plan of a scan: order of the conversions, and the I2C transactions that they need."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Annotated, NamedTuple

from msgspec import Meta, Struct

from firmware_interface.conversion_order import CONVERSION_ORDERS
from footsense.acquisition.boards import ad7746, fdc1004
from footsense.acquisition.boards.board import Board, ConversionStep, ReadBackCheck
from footsense.ports import Transaction

#: The boards, by their names in a configuration.
BOARDS: Mapping[str, Board] = MappingProxyType({"fdc1004": fdc1004.BOARD, "ad7746": ad7746.BOARD})


class Scan(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Section `scan` of a configuration: conversion rate.

    Attributes:
        rate_sps: Conversions per second of one converter; a lower rate has less noise: 100, 200 or 400 with board
            `fdc1004`; 9, 11, 13, 16, 26, 50, 84 or 91 with board `ad7746`. None: the board's fastest.
    """

    rate_sps: Annotated[int, Meta(ge=1)] | None = None


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


def scan_plan(rate_sps: int, board: str = "fdc1004") -> ScanPlan:
    """Return the plan of a scan with a board: its conversions, in the order of the magic square.

    Args:
        rate_sps: Conversions per second, one of the rates of the board's converter.
        board: A key of BOARDS.

    Example:
        >>> plan = scan_plan(400)
        >>> [step.results[0].element for step in plan.steps]
        [5, 0, 7, 6, 4, 2, 1, 8, 3]
        >>> sum(len(step.select_changes) for step in plan.steps)
        6
    """
    electronics = BOARDS[board]
    rate = electronics.rates[rate_sps]
    steps = [electronics.step(element, rate) for element in CONVERSION_ORDERS["lo_shu"]]
    steps = [
        step._replace(
            select_changes=tuple(write for write in step.select if write not in before.select),
            select_checks=tuple(
                ReadBackCheck(Transaction(write.address, b"", n_read=1), write.write) for write in step.select
            ),
        )
        for step, before in zip(steps, steps[-1:] + steps[:-1], strict=True)
    ]
    steps[-1] = steps[-1]._replace(setting_checks=(electronics.setting_check,))
    return ScanPlan(
        board=electronics,
        steps=tuple(steps),
        conversion_ns=rate.conversion_ns,
        conversion_wait_ns=electronics.conversion_wait_ns(rate),
    )
