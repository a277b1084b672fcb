"""The electronics of a foot as a scanner sees them: what is sent for an element, and what the answers mean.

There are two, each in the module of its converter: `fdc1004.BOARD` and `ad7746.BOARD`. The scanners know neither.
"""

from collections.abc import Callable, Mapping
from typing import NamedTuple

from firmware_interface.schedule import Traffic
from footsense.frames import Reading
from footsense.ports import Clock, I2cBus, Transaction

#: Readings behind which stands a conversion of the element, whatever came of it.
CONVERTED = frozenset({Reading.OK, Reading.OVER_RANGE, Reading.UNDER_RANGE})


class Check(NamedTuple):
    """What every leg must answer while a conversion runs; asked of all at once, the answers are a wired AND.

    Attributes:
        ask: A read that changes nothing.
        expected: The answer of a leg that holds its setting.
    """

    ask: Transaction
    expected: bytes


def switch_check(select: Transaction) -> Check:
    """Return the question whether a line switch stands as it was told by `select`."""
    return Check(Transaction(select.address, b"", n_read=1), select.write)


class Done(NamedTuple):
    """How converters are asked whether they are done, where that can be asked of all at once.

    Attributes:
        ask: A read that changes nothing.
        says: What the answer means: OK, NOT_READY or CORRUPT.
    """

    ask: Transaction
    says: Callable[[bytes], Reading]


class Element(NamedTuple):
    """What converting one element takes.

    Attributes:
        select: Writes of the line switches, one for each.
        trigger: Starts the conversion.
        done: Asks whether it is done; None where the result itself tells.
        read: Reads the result of one leg.
    """

    select: tuple[Transaction, ...]
    trigger: Transaction
    done: Done | None
    read: tuple[Transaction, ...]


class Thermometer(NamedTuple):
    """How a converter with a temperature sensor is read; its conversions of elements are then at an end.

    Attributes:
        start: Starts the conversion of the temperature.
        wait_ns: Time after which also the slowest chip has finished [ns].
        read: Reads it from one leg.
        decode: What two answers in a row say [deg C], the second of which is not new any more; NaN if that is none.
    """

    start: tuple[Transaction, ...]
    wait_ns: int
    read: Transaction
    decode: Callable[[bytes, bytes], float]


class Board(NamedTuple):
    """One kind of electronics.

    Attributes:
        conversion_ns: Nominal time of one conversion by conversions per second [ns].
        element: What an element takes: row, column, conversions per second.
        identify: Makes sure that the connected chip is the right one. Raises HardwareError if nothing answers,
            WrongChipError if something else does, and BusError.
        configure: Sets up the chip of the leg that is connected alone. Returns OK and what its CAPDAC takes off each
            result [pF]; or why it is of no use. Raises BusError.
        decode_result: What the answers to `Element.read` say, and the capacitance [pF], CAPDAC not included; NaN
            unless the reading is OK.
        afresh: Lets a converter of which nothing is known begin: its settings, and no result left to be read.
        setting_check: That it holds its settings, which a dip of its supply resets; asked once a scan.
        range_end_pf: What an element over its range has at least [pF].
        thermometer: How it tells its temperature; None if it has no sensor.
        traffic: What its transactions are at least.
    """

    conversion_ns: Mapping[int, int]
    element: Callable[[int, int, int], Element]
    identify: Callable[[I2cBus, Clock], None]
    configure: Callable[[I2cBus, Clock], tuple[Reading, float]]
    decode_result: Callable[[list[bytes]], tuple[Reading, float]]
    afresh: tuple[Transaction, ...]
    setting_check: Check
    range_end_pf: float
    thermometer: Thermometer | None
    traffic: Traffic
