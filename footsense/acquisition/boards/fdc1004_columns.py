"""Board `fdc1004_columns`: three FDC1004 in a foot, one for each column, that convert a row at the same time.

Each element has a pin: measurement n of the converter of column j is CIN n + 1, the element of row n, against one
electrode at ground that all elements share. So no line is switched. The two converters beside the first are behind an
address translator (`firmware_interface/chips/ltc4317.py`; ADR 0028). Each is triggered alone, and asked alone whether
it is done; the bytes are those of board `fdc1004`.
"""

from functools import partial

from firmware_interface import schedule
from firmware_interface.chips import fdc1004 as chip
from firmware_interface.chips.ltc4317 import COLUMN_ADDRESSES
from footsense.acquisition.boards import fdc1004
from footsense.acquisition.boards.board import ConversionStep
from footsense.errors import NackError
from footsense.frames import ROWS, Reading
from footsense.ports import I2cBus

_SET_UP = tuple(write for address in COLUMN_ADDRESSES for write in fdc1004.set_up_at(address))
#: What may be wrong besides wires and supply, by the columns whose converters do not answer.
_CAUSES_OF_SILENCE = {
    (0,): "a converter of its own; those of columns 1 and 2 answer",
    (1,): "two converters at one address: resistors XORL1, XORH1; those of columns 0 and 2 answer",
    (2,): "two converters at one address: resistors XORL2, XORH2; those of columns 0 and 1 answer",
    (1, 2): "a dead address translator (LTC4317); that of column 0 answers",
}


def step(element: int, rate: chip.Fdc1004Rate) -> ConversionStep:
    """Return the transactions of the conversion of a row by all converters of a leg.

    Args:
        element: Flat index of the first element of the row.
        rate: The rate.
    """
    row = element // ROWS
    results = tuple(
        fdc1004.element_result(element + column, row, rate, address)
        for column, address in enumerate(COLUMN_ADDRESSES)
    )
    # The trigger has left the pointer at FDC_CONF: it need not be written again (section 8.5.2).
    asked = [result.done._replace(read=result.done.read._replace(write=b"")) for result in results]
    return ConversionStep(results, select=(), done_after_start=tuple(asked))


def check_identity(bus: I2cBus) -> None:
    """Raise an error unless an FDC1004 answers at the address of each column.

    Args:
        bus: Its bus.

    Raises:
        HardwareError: One does not answer; the text says of which column, and how many others do.
        WrongChipError: Another chip answers; the text names the usual cause.
        I2cError: The transaction failed otherwise.
    """
    silent = [column for column, address in enumerate(COLUMN_ADDRESSES) if not _acknowledges(bus, address)]
    cause = _CAUSES_OF_SILENCE.get(tuple(silent), "another mux channel")
    for address in COLUMN_ADDRESSES:
        fdc1004.check_identity_at(bus, address, cause)


def _acknowledges(bus: I2cBus, address: int) -> bool:
    """Return whether a chip answers at an address.

    Raises:
        I2cError: The transaction failed otherwise.
    """
    try:
        bus.transfer(fdc1004.read_register(chip.Fdc1004Register.DEVICE_ID, address))
    except NackError:
        return False
    return True


#: The board `fdc1004_columns`.
BOARD = fdc1004.BOARD._replace(
    order=tuple(range(0, ROWS * ROWS, ROWS)),
    step=step,
    check_identity=check_identity,
    set_up=_SET_UP,
    # No pin has so little, as nothing drives an element's other side: the converter was reset after it was asked
    # whether it was done, and what it converts now is its first pin.
    decode_results=partial(fdc1004.decode_results, of_zero=Reading.MISCONFIGURED),
    # A reset, which leaves neither a conversion nor a result, takes a third of the time of the reads of all results.
    make_ready=_SET_UP,
    setting_checks=tuple(map(fdc1004.setting_check_at, COLUMN_ADDRESSES)),
    traffic=schedule.FDC1004_COLUMNS_TRAFFIC,
)
