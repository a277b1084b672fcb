"""The conversion of one element as data: its transactions, and the checks beside them."""

from collections.abc import Callable
from typing import NamedTuple

from footsense.frames import Reading
from footsense.ports import Transaction


class Check(NamedTuple):
    """Read-back of a setting; from several legs at once, the answers combine as a wired AND.

    Attributes:
        read: Read transaction without side effects.
        expected: The answer of a leg that holds its setting.
    """

    read: Transaction
    expected: bytes


class Done(NamedTuple):
    """Poll for the end of a conversion, for several legs in one transaction.

    Attributes:
        read: Read transaction without side effects.
        decode: Meaning of the answer: OK, NOT_READY or CORRUPT.
    """

    read: Transaction
    decode: Callable[[bytes], Reading]


class Step(NamedTuple):
    """The conversion of one element.

    Attributes:
        element: Flat index of the element.
        select: Writes that select the element's lines, one for each line switch.
        trigger: Write that starts the conversion.
        done: The question whether it is done; None where the result itself shows it.
        read: Reads of one leg's result.
        changes: The writes of `select` that are needed after the step before.
        select_checks: Positions of the line switches: a broadcast write is acknowledged even if one leg misses it, and
            a wrong line reads as a plausible capacitance.
        setting_checks: Settings of the converter; in the last step of a scan only.
    """

    element: int
    select: tuple[Transaction, ...]
    trigger: Transaction
    done: Done | None
    read: tuple[Transaction, ...]
    changes: tuple[Transaction, ...] = ()
    select_checks: tuple[Check, ...] = ()
    setting_checks: tuple[Check, ...] = ()
