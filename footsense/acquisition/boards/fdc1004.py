"""Board `fdc1004`: its I2C transactions, and the decoding of their answers.

Ids are checked before anything else, because a missing chip often "answers": pull-ups read as ones, a stuck line as
zeros. Register layout: `firmware_interface/chips/fdc1004.py`, with the sections of data sheet SNOSCY5.
"""

from firmware_interface.chips import adg715
from firmware_interface.chips import fdc1004 as chip
from firmware_interface.conversion_order import CONVERSION_ORDERS
from footsense.acquisition.boards.board import (
    ConversionStep,
    DonePoll,
    ReadBackCheck,
    require_identity,
)
from footsense.errors import HardwareError, NackError
from footsense.frames import ROWS, Reading
from footsense.ports import I2cBus, Transaction

#: Bits of FDC_CONF that read as zero without REPEAT, which is never used here (section 8.6.1.3).
_CONF_BITS_ALWAYS_ZERO = 0x7300
#: Upper words of a result at the ends of the range.
_RANGE_END_CODES = {b"\x7f\xff", b"\x80\x00"}
_NAN = float("nan")
#: Elements in the order of a scan.
ORDER = CONVERSION_ORDERS["lo_shu"]
_IDENTITY = {
    chip.Fdc1004Register.MANUFACTURER_ID: chip.MANUFACTURER_ID,
    chip.Fdc1004Register.DEVICE_ID: chip.DEVICE_ID,
}


def write_register(register: int, word: int) -> Transaction:
    """Return the transaction that writes one 16-bit register."""
    return Transaction(chip.ADDRESS, bytes((register, word >> 8, word & 0xFF)))


def read_register(register: int) -> Transaction:
    """Return the transaction that reads one 16-bit register."""
    return Transaction(chip.ADDRESS, bytes((register,)), n_read=2)


#: Writes that reset and configure the converter: measurement n converts CIN n without CAPDAC (section 8.6.1.2).
SET_UP = (
    write_register(chip.Fdc1004Register.FDC_CONF, chip.CONF_RESET.encode(1)),
    *(
        write_register(chip.Fdc1004Register.CONF_MEAS1 + slot, chip.measurement_config(slot))
        for slot in range(ROWS)
    ),
)
#: Brings converters in an unknown state to where they can convert: no conversion that would still end, and no result
#: left to be read. Another measurement, which nobody reads, ends the one that runs: that would set its DONE bit after
#: these reads.
MAKE_READY = (
    write_register(chip.Fdc1004Register.FDC_CONF, chip.trigger_config(chip.RATES[100], chip.N_SLOTS - 1)),
    *(read_register(register) for register in range(2 * ROWS)),
)
#: The settings of the converter, which a dip of its supply resets; asked once a scan. The second measurement's
#: configuration reads as the first one's after a reset.
SETTING_CHECK = ReadBackCheck(
    read_register(chip.Fdc1004Register.CONF_MEAS1 + 1), chip.measurement_config(1).to_bytes(2, "big")
)


def step(element: int, rate: chip.Fdc1004Rate) -> ConversionStep:
    """Return the transactions of one element's conversion; measurement slot n converts CIN n, the pin of column n.

    At 400 S/s the value does not need the lower register: the noise of one conversion (0.92 fF) hides its bits (the
    step of the upper one is 0.49 fF, 0.14 fF rms), and to read it would cost six legs a third of the bus.

    Args:
        element: Flat index.
        rate: The rate.
    """
    row, column = divmod(element, ROWS)
    upper, line = chip.result_register(column), bytes((adg715.line_switch_byte(1 << row),))
    read = (read_register(upper), read_register(upper + 1))
    return ConversionStep(
        element,
        select=Transaction(adg715.ADDRESS, line),
        select_check=ReadBackCheck(Transaction(adg715.ADDRESS, b"", n_read=1), line),
        trigger=write_register(chip.Fdc1004Register.FDC_CONF, chip.trigger_config(rate, column)),
        done=DonePoll(
            read_register(chip.Fdc1004Register.FDC_CONF),
            done=chip.CONF_DONE.encode(chip.slot_bit(column)),
            never_set=_CONF_BITS_ALWAYS_ZERO,
        ),
        read=read,
        read_value=read[:1] if rate is chip.RATES[400] else read,
    )


def check_identity(bus: I2cBus) -> None:
    """Raise an error unless the connected chip is an FDC1004, by its id registers (section 8.6).

    Args:
        bus: Its bus.

    Raises:
        HardwareError: No chip answers.
        WrongChipError: Another chip answers; the text names the usual cause.
        I2cError: The transaction failed otherwise.
    """
    try:
        answers = [bus.transfer(read_register(register)) for register in _IDENTITY]
    except NackError as error:
        raise HardwareError(
            f"no answer at {chip.ADDRESS:#04x}: broken wire, no 3.3 V, or another mux channel"
        ) from error
    identity = b"".join(word.to_bytes(2, "big") for word in _IDENTITY.values())
    require_identity(b"".join(answers), "an FDC1004", identity, chip.ADDRESS, "a 24Cxx EEPROM")


def decode_results(answers: list[bytes], n: int) -> list[tuple[Reading, float]]:
    """Return reading and capacitance [pF] of n results, decoded from the answers to their reads, both or the upper one.

    Args:
        answers: The answers, one or two of each result.
        n: Number of results.

    Returns:
        Of each the reading, and the capacitance [pF], NaN unless the reading is OK.

    Source: FDC1004 data sheet SNOSCY5, section 8.6.1.1: a 24-bit code in two's complement, the lower eight bits of the
    lower register reserved.
    """
    results = []
    uppers, lowers = (answers, [b"\0\0"] * n) if len(answers) == n else (answers[::2], answers[1::2])
    for upper, lower in zip(uppers, lowers, strict=True):
        if lower[1]:
            results.append((Reading.CORRUPT, _NAN))
        # The upper word alone shows the ends of the range; an unfinished measurement reads 0x7FFF too.
        elif upper in _RANGE_END_CODES:
            results.append((Reading.OVER_RANGE, _NAN))
        # No line has so little capacitance, but a chip that was reset after it was asked whether it is done reads so.
        elif upper == b"\0\0" == lower:
            results.append((Reading.UNDER_RANGE, _NAN))
        else:
            code = int.from_bytes(upper + lower[:1], "big", signed=True)
            results.append((Reading.OK, code / chip.CODES_PER_PF))
    return results
