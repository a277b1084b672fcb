"""Data types of an electronics board as the scanner uses it: transactions of an element, and read-back checks."""

from typing import NamedTuple

from firmware_interface.chips.fdc1004 import CLOCK_TOLERANCE_REL, Fdc1004Rate
from footsense.errors import WrongChipError
from footsense.frames import Reading
from footsense.ports import Transaction


class ReadBackCheck(NamedTuple):
    """Read-back check of a setting; answers of several legs at once combine as a wired AND.

    Attributes:
        read: Read transaction without side effects.
        expected: The answer of a leg that holds its setting.
    """

    read: Transaction
    expected: bytes


class DonePoll(NamedTuple):
    """Polling transaction for the end of a conversion, on several legs at once.

    Attributes:
        read: Read transaction without side effects.
        done: Bit of the answer that is set once the conversion is done.
        never_set: Bits that no such chip sends.
    """

    read: Transaction
    done: int
    never_set: int


class ConversionStep(NamedTuple):
    """Transactions of one element's conversion: line selection, trigger, polling, read-out, checks.

    Attributes:
        element: Flat index of the element.
        select: Write that selects its row.
        select_check: Position of the row switch: a broadcast write is acknowledged even if one leg misses it, and a
            wrong row reads as a plausible capacitance.
        trigger: Write that starts the conversion.
        done: The question whether it is done.
        read: Reads of the whole result from the leg's converter; by these any chip forgets that a conversion is done.
        read_value: Those of them that the value needs, for a chip that forgets by these alone.
        select_changes: `select`, if it is needed after the step before.
        setting_checks: Settings of the converter; asked for in the last step of a scan.
    """

    element: int
    select: Transaction
    select_check: ReadBackCheck
    trigger: Transaction
    done: DonePoll
    read: tuple[Transaction, ...]
    read_value: tuple[Transaction, ...]
    select_changes: tuple[Transaction, ...] = ()
    setting_checks: tuple[ReadBackCheck, ...] = ()


#: Longest conversion that is waited for, over the wait for a chip within its tolerance [1]; published drivers wait 20 %
#: longer.
MAX_WAIT_FACTOR = 1.3

#: Readings of a conversion that has taken place.
CONVERTED = frozenset({Reading.OK, Reading.OVER_RANGE, Reading.UNDER_RANGE})


def require_identity(answer: bytes, name: str, identity: bytes, address: int, others: str) -> None:
    """Raise an error unless an identity register has the expected value.

    Args:
        answer: The answer.
        name: Name of the right chip.
        identity: Its answer.
        address: Its address.
        others: Other chips that have this address.

    Raises:
        WrongChipError: The answer is another one; the text names the usual cause.
    """
    if answer == identity:
        return
    why = {
        frozenset({0xFF}): "no chip drives the lines: check the chip's power and the wires",
        frozenset({0x00}): "SDA is held low: check for a short or a chip without power",
    }.get(frozenset(answer), f"another chip has this address, such as {others}")
    raise WrongChipError(
        f"identity {answer.hex(' ')} at {address:#04x}, {name} says {identity.hex(' ')}; {why}"
    )


def conversion_wait_ns(rate: Fdc1004Rate) -> int:
    """Return the conversion time of the slowest chip within its clock tolerance [ns]."""
    return round(rate.conversion_ns * (1 + CLOCK_TOLERANCE_REL))
