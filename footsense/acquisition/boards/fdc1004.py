"""Board `fdc1004`: its I2C transactions, and the decoding of their answers.

Ids are checked before anything else, because a missing chip often "answers": pull-ups read as ones, a stuck line as
zeros. Register layout: `firmware_interface/chips/fdc1004.py`, with the sections of data sheet SNOSCY5.
"""

from functools import partial

from firmware_interface import schedule
from firmware_interface.chips import adg715
from firmware_interface.chips import fdc1004 as chip
from footsense.acquisition.boards.board import (
    Board,
    ConversionStep,
    DonePoll,
    ElementResult,
    ReadBackCheck,
    require_identity,
)
from footsense.errors import HardwareError, NackError
from footsense.frames import ROWS, Reading
from footsense.ports import Clock, I2cBus, Transaction

#: Bits of FDC_CONF that read as zero without REPEAT, which is never used here (section 8.6.1.3).
_CONF_BITS_ALWAYS_ZERO = 0x7300
#: Upper words of a result at the ends of the range.
_RANGE_END_CODES = {b"\x7f\xff", b"\x80\x00"}
_NAN = float("nan")
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


READ_CONF = read_register(chip.Fdc1004Register.FDC_CONF)
_RESET = write_register(chip.Fdc1004Register.FDC_CONF, chip.CONF_RESET.encode(1))


def step(element: int, rate: chip.Fdc1004Rate) -> ConversionStep:
    """Return the transactions of one element's conversion; measurement slot n converts CIN n, the pin of column n.

    Args:
        element: Flat index.
        rate: The rate.
    """
    row, column = divmod(element, ROWS)
    return ConversionStep(
        results=(_result(element, column, rate),),
        select=(Transaction(adg715.ADDRESS, bytes((adg715.line_switch_byte(1 << row),))),),
        trigger=write_register(chip.Fdc1004Register.FDC_CONF, chip.trigger_config(rate, column)),
        done=DonePoll(
            READ_CONF, partial(_decode_done, done_bit=chip.CONF_DONE.encode(chip.slot_bit(column)))
        ),
    )


def check_identity(bus: I2cBus, clock: Clock) -> None:
    """Raise an error unless the connected chip is an FDC1004, by its id registers (section 8.6).

    Args:
        bus: Its bus.
        clock: Not used: the chip needs no wait.

    Raises:
        HardwareError: No chip answers.
        WrongChipError: Another chip answers; the text names the usual cause.
        I2cError: The transaction failed otherwise.
    """
    del clock
    try:
        answers = [bus.transfer(read_register(register)) for register in _IDENTITY]
    except NackError as error:
        raise HardwareError(
            f"no answer at {chip.ADDRESS:#04x}: broken wire, no 3.3 V, or another mux channel"
        ) from error
    identity = b"".join(word.to_bytes(2, "big") for word in _IDENTITY.values())
    require_identity(b"".join(answers), "an FDC1004", identity, chip.ADDRESS, "a 24Cxx EEPROM")


def configure_and_get_capdac_pf(bus: I2cBus, clock: Clock) -> tuple[Reading, float]:
    """Reset the chip, and configure measurement n as CIN n to ground without CAPDAC; return the outcome.

    Args:
        bus: Its bus.
        clock: Not used: the chip needs no wait.

    Returns:
        OK, and 0 pF for the CAPDAC.

    Raises:
        I2cError: A write was not acknowledged.
    """
    del clock
    bus.transfer(_RESET)
    for slot in range(ROWS):  # section 8.6.1.2
        bus.transfer(write_register(chip.Fdc1004Register.CONF_MEAS1 + slot, chip.measurement_config(slot)))
    return Reading.OK, 0.0


def _decode_done(conf_answer: bytes, done_bit: int) -> Reading:
    """Return the reading (OK or NOT_READY, ...) decoded from an answer to READ_CONF.

    Bits that no FDC1004 sends, reserved ones and REPEAT, which is never asked for, make it CORRUPT.
    """
    word = conf_answer[0] << 8 | conf_answer[1]
    if word & _CONF_BITS_ALWAYS_ZERO:
        return Reading.CORRUPT
    return Reading.OK if word & done_bit else Reading.NOT_READY


def _result(element: int, slot: int, rate: chip.Fdc1004Rate) -> ElementResult:
    """Return an element with the transactions that read the result of its measurement.

    At 400 S/s the value does not need the lower register: the noise of one conversion (0.92 fF) hides its bits (the
    step of the upper one is 0.49 fF, 0.14 fF rms), and to read it would cost six legs a third of the bus.
    """
    upper = chip.result_register(slot)
    read = (read_register(upper), read_register(upper + 1))
    return ElementResult(element, read, read[:1] if rate is chip.RATES[400] else read)


def decode_result(answers: list[bytes]) -> tuple[Reading, float]:
    """Return reading and capacitance [pF] decoded from the answers to the reads of a result, both or the upper one.

    Returns:
        The reading, and the capacitance [pF], NaN unless the reading is OK.

    Source: FDC1004 data sheet SNOSCY5, section 8.6.1.1: a 24-bit code in two's complement, the lower eight bits of the
    lower register reserved.
    """
    upper, lower = answers[0], b"\0\0"
    if len(answers) > 1:
        lower = answers[1]
        if lower[1]:
            return Reading.CORRUPT, _NAN
    # The upper word alone shows the ends of the range; an unfinished measurement reads 0x7FFF too.
    if upper in _RANGE_END_CODES:
        return Reading.OVER_RANGE, _NAN
    # No line has so little capacitance, but a chip that was reset after it was asked whether it is done reads so.
    if upper == b"\0\0" == lower:
        return Reading.UNDER_RANGE, _NAN
    return Reading.OK, int.from_bytes(upper + lower[:1], "big", signed=True) / chip.CODES_PER_PF


#: The board `fdc1004`.
BOARD = Board(
    rates=chip.RATES,
    step=step,
    check_identity=check_identity,
    configure_and_get_capdac_pf=configure_and_get_capdac_pf,
    decode_result=decode_result,
    # Another measurement, which nobody reads, ends the one that runs: that would set its DONE bit after these reads.
    make_ready=(
        write_register(chip.Fdc1004Register.FDC_CONF, chip.trigger_config(chip.RATES[100], chip.N_SLOTS - 1)),
        *(read_register(register) for register in range(2 * ROWS)),
    ),
    # The second column's configuration: after a reset it reads as the first column's.
    setting_check=ReadBackCheck(
        read_register(chip.Fdc1004Register.CONF_MEAS1 + 1), chip.measurement_config(1).to_bytes(2, "big")
    ),
    range_end_pf=chip.capacitance_pf(chip.CODE_MAX),
    thermometer=None,
    traffic=schedule.FDC1004_TRAFFIC,
)
