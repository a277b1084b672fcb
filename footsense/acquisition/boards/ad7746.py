"""Board `ad7746`: its I2C transactions, and the decoding of their answers.

Every conversion is a single one into one data register. It is read in one burst, status first, which the chip does not
change meanwhile; a status without new data marks a result that was read before.

An unloaded element has more than the +-4.1 pF of the range, so the CAPDAC always subtracts 40 steps. The size of a step
differs by a fifth between chips; `configure_and_measure_capdac` measures it with no line selected, as the difference
that 20 steps make.
Register layout: `firmware_interface/chips/ad7746.py`, with the tables of data sheet rev. 0.
"""

from firmware_interface import schedule
from firmware_interface.chips import ad7746 as chip
from firmware_interface.chips import adg715
from firmware_interface.chips.ad7746 import Ad7746Register
from firmware_interface.conversion_order import CONVERSION_ORDERS
from footsense.acquisition.boards.board import (
    MAX_WAIT_FACTOR,
    Board,
    ConversionStep,
    ElementResult,
    ReadBackCheck,
    Thermometer,
    require_identity,
)
from footsense.errors import HardwareError, NackError
from footsense.frames import ROWS, Reading
from footsense.ports import Clock, I2cBus, Transaction

#: Steps of the CAPDAC: 6.6 pF nominal, so that 2.5 to 10.7 pF are in range. With the largest steps of a chip the range
#: begins at 4.0 pF, the least of an unloaded element; with the smallest it ends at 9.3 pF.
SCAN_CAPDAC = 40
#: Steps that any chip has in range with no line selected: at most 4 pF.
_CAPDAC_WITHOUT_LINES = 20
#: Largest deviation of a chip's step from the nominal one [1]: 17 pF of full scale are guaranteed instead of 21 pF; as
#: much more is assumed to be possible.
_CAPDAC_STEP_TOLERANCE_REL = 0.22

_NAN = float("nan")


def write_registers(register: int, *values: int) -> Transaction:
    """Return the transaction that writes consecutive registers."""
    return Transaction(chip.ADDRESS, bytes((register, *values)))


def read_registers(register: int, n: int) -> Transaction:
    """Return the transaction that reads `n` consecutive registers."""
    return Transaction(chip.ADDRESS, bytes((register,)), n_read=n)


#: Status and capacitance, in one burst.
READ_RESULT = read_registers(Ad7746Register.STATUS, 4)
_READ_SETTINGS = read_registers(Ad7746Register.CAP_SETUP, len(chip.RESET_VALUES))
_RESET = Transaction(chip.ADDRESS, bytes((chip.RESET_COMMAND,)))
#: Neither row nor column.
_SELECT_NO_LINES = tuple(Transaction(address, b"\x00") for address in (adg715.ADDRESS, adg715.COLUMN_ADDRESS))


def _write_settings(capdac: int) -> Transaction:
    """Return the transaction that writes all settings registers and leaves the chip idle."""
    return write_registers(
        Ad7746Register.CAP_SETUP,
        chip.CAP_ENABLE,
        0,
        chip.EXCITE_A,
        chip.configuration(chip.MODE_IDLE),
        chip.capdac(capdac),
        0,
    )


def _trigger_transaction(rate: chip.Ad7746Rate) -> Transaction:
    """Return the transaction that starts one conversion."""
    mode = chip.configuration(chip.MODE_SINGLE, rate.code)
    return write_registers(Ad7746Register.CONFIGURATION, mode)


def _wait_ns(conversion_ns: int) -> int:
    """Return the longest duration of a conversion within the chip's clock tolerance [ns]."""
    return round(conversion_ns * (1 + chip.CLOCK_TOLERANCE_REL))


def step(element: int, rate: chip.Ad7746Rate) -> ConversionStep:
    """Return the transactions of one element's conversion: line selection, trigger, read-out.

    Args:
        element: Flat index.
        rate: The rate.
    """
    row, column = divmod(element, ROWS)
    return ConversionStep(
        results=(ElementResult(element, _trigger_transaction(rate), None, (READ_RESULT,), (READ_RESULT,)),),
        select=(
            Transaction(adg715.ADDRESS, bytes((adg715.line_switch_byte(1 << row),))),
            Transaction(adg715.COLUMN_ADDRESS, bytes((adg715.line_switch_byte(1 << column),))),
        ),
    )


def reset_and_check_identity(bus: I2cBus, clock: Clock) -> None:
    """Reset the connected chip, and raise an error unless it has an AD7746's reset values (it has no id register).

    Args:
        bus: Its bus.
        clock: The time that the bus lives in: after a reset the chip does not answer for 0.2 ms.

    Raises:
        HardwareError: No chip answers.
        WrongChipError: Another chip answers; the text names the usual cause.
        I2cError: The transaction failed otherwise.
    """
    try:
        bus.transfer(_RESET)
        clock.sleep_until_ns(clock.now_ns() + chip.RESET_NS)
        settings = bus.transfer(_READ_SETTINGS)
    except NackError as error:
        raise HardwareError(
            f"no answer at {chip.ADDRESS:#04x}: broken wire, no supply, or another mux channel"
        ) from error
    others = "an LM75, a TMP102, an ADS1115 or an ADG715 strapped to 0x48"
    require_identity(settings, "an AD7746 after a reset", chip.RESET_VALUES, chip.ADDRESS, others)


def configure_and_measure_capdac(bus: I2cBus, clock: Clock) -> tuple[Reading, float]:
    """Set the chip up with no line selected; return the outcome and the capacitance that its CAPDAC subtracts [pF].

    Args:
        bus: Its bus; no other leg is connected.
        clock: The time that the bus lives in: two conversions take 22 ms.

    Returns:
        OK and the capacitance that is subtracted from every result [pF]; or the reading of a chip that cannot be used.

    Raises:
        I2cError: A transaction failed.
    """
    for write in _SELECT_NO_LINES:
        bus.transfer(write)
    levels_pf = []
    for capdac in (0, _CAPDAC_WITHOUT_LINES):
        bus.transfer(_write_settings(capdac))
        bus.transfer(_trigger_transaction(chip.RATES[_FASTEST_SPS]))
        start_ns, conversion_ns = clock.now_ns(), chip.RATES[_FASTEST_SPS].conversion_ns
        for wait_ns in (_wait_ns(conversion_ns), round(MAX_WAIT_FACTOR * _wait_ns(conversion_ns))):
            clock.sleep_until_ns(start_ns + wait_ns)
            answer = bus.transfer(READ_RESULT)
            [(reading, level_pf)] = decode_results([answer], 1)
            if reading is not Reading.NOT_READY:
                break
        if reading in {Reading.NOT_READY, Reading.EXCITATION}:
            return reading, _NAN
        # The result is used for long: it is read twice, so that a flipped bit is noticed.
        if reading is not Reading.OK or answer[1:] != bus.transfer(READ_RESULT)[1:]:
            return Reading.CORRUPT, _NAN
        levels_pf.append(level_pf)
    bus.transfer(_write_settings(SCAN_CAPDAC))
    step_pf = (levels_pf[0] - levels_pf[1]) / _CAPDAC_WITHOUT_LINES
    if abs(step_pf / chip.CAPDAC_STEP_PF - 1) > _CAPDAC_STEP_TOLERANCE_REL:
        return Reading.CORRUPT, _NAN
    return Reading.OK, SCAN_CAPDAC * step_pf


_FASTEST_SPS = max(chip.RATES)


def decode_results(answers: list[bytes], n: int) -> list[tuple[Reading, float]]:
    """Return reading and capacitance [pF] of n results, decoded from the answers to READ_RESULT.

    Returns:
        The reading, and the capacitance [pF], CAPDAC not included; NaN unless the reading is OK.

    Source: AD7746 data sheet rev. 0, table 8 (status) and "Capacitive data register" (offset binary).
    """
    del n
    return list(map(_decode_result, answers))


def _decode_result(answer: bytes) -> tuple[Reading, float]:
    status, code = answer[0], int.from_bytes(answer[1:4], "big")
    # Only capacitance is converted, so RDY has to equal RDYCAP.
    if status & chip.STATUS_NEVER_SET or bool(status & chip.NOT_RDY) != bool(status & chip.NOT_RDYCAP):
        return Reading.CORRUPT, _NAN
    if status & chip.EXCERR:
        return Reading.EXCITATION, _NAN
    if status & chip.NOT_RDYCAP:
        return Reading.NOT_READY, _NAN
    if code == chip.CODE_MAX:
        return Reading.OVER_RANGE, _NAN
    if code == 0:
        return Reading.UNDER_RANGE, _NAN
    return Reading.OK, chip.capacitance_pf(code)


def decode_temperature(answer: bytes, again: bytes) -> float:
    """Return the chip temperature [degC] decoded from a burst read of STATUS to VT_DATA.

    It is used for ten seconds and scales all forces, so two reads have to agree: a flipped bit is noticed.

    Returns:
        The temperature [degC]; NaN if there is no new one.
    """
    status, code = answer[0], int.from_bytes(answer[4:7], "big")
    if (
        status & (chip.STATUS_NEVER_SET | chip.NOT_RDYVT)
        or code in {0, chip.CODE_MAX}
        or answer[4:] != again[4:]
    ):
        return _NAN
    return chip.temperature_c(code)


#: The board `ad7746`.
BOARD = Board(
    rates=chip.RATES,
    order=CONVERSION_ORDERS["lo_shu"],
    step=step,
    check_identity=reset_and_check_identity,
    configure_and_get_capdac_pf=configure_and_measure_capdac,
    decode_results=decode_results,
    make_ready=(_write_settings(SCAN_CAPDAC), READ_RESULT),
    # Without its CAPDAC setting a chip reads another capacitance; without the others it does not convert.
    setting_checks=(
        ReadBackCheck(
            read_registers(Ad7746Register.CAPDAC_A, 4),
            bytes((chip.capdac(SCAN_CAPDAC), 0)) + chip.RESET_VALUES[-2:],
        ),
    ),
    range_end_pf=SCAN_CAPDAC * chip.CAPDAC_STEP_PF * (1 - _CAPDAC_STEP_TOLERANCE_REL) + chip.FULL_SCALE_PF,
    thermometer=Thermometer(
        start=(
            write_registers(Ad7746Register.CAP_SETUP, 0, chip.TEMPERATURE_ENABLE),
            write_registers(Ad7746Register.CONFIGURATION, chip.configuration(chip.MODE_SINGLE)),
        ),
        wait_ns=_wait_ns(chip.VT_CONVERSION_NS[0]),
        read=read_registers(Ad7746Register.STATUS, 7),
        decode=decode_temperature,
    ),
    traffic=schedule.AD7746_TRAFFIC,
)
