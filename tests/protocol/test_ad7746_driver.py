"""The bytes that the AD7746 driver puts on the wire, pinned to the data sheet (AD7745/AD7746, rev. 0)."""

import numpy as np
import pytest

from footsense.acquisition.boards import ad7746
from footsense.acquisition.scan_plan import scan_plan
from footsense.errors import HardwareError, NackError, WrongChipError
from footsense.frames import Reading
from footsense.ports import Transaction
from footsense.sim.clock import VirtualClock
from tests.protocol.scripted_bus import ScriptedBus

NAN = float("nan")
RESET = Transaction(0x48, b"\xbf")
READ_SETTINGS = Transaction(0x48, b"\x07", 8)
READ_RESULT = Transaction(0x48, b"\x00", 4)
ROWS_OFF, COLUMNS_OFF = Transaction(0x49, b"\x00"), Transaction(0x4A, b"\x00")
START = Transaction(0x48, b"\x0a\x02")
AFTER_RESET = b"\x00\x00\x03\xa0\x00\x00\x80\x00"


def settings(capdac: int) -> Transaction:
    """CAPEN; no temperature; EXCA at half the supply; idle; the CAPDAC on CIN+ alone."""
    return Transaction(0x48, bytes((0x07, 0x80, 0x00, 0x0B, 0x00, 0x80 | capdac, 0x00)))


def test_the_chip_is_recognised_by_what_a_reset_leaves() -> None:
    """It has no id. The reset is one byte, and 200 us are waited for before the next one."""
    clock = VirtualClock()
    with ScriptedBus((RESET, b""), (READ_SETTINGS, AFTER_RESET)) as bus:
        ad7746.reset_and_check_identity(bus, clock)
    assert clock.now_ns() == 200_000


def test_another_chip_is_explained_in_words() -> None:
    """The chips that also have this address are part of the error."""
    hint = "LM75, a TMP102, an ADS1115 or an ADG715 strapped to 0x48"
    with (
        ScriptedBus((RESET, b""), (READ_SETTINGS, b"\x19\x00" * 4)) as bus,
        pytest.raises(WrongChipError, match=f" at 0x48, an AD7746 after a reset says .*{hint}"),
    ):
        ad7746.reset_and_check_identity(bus, VirtualClock())


def test_silence_is_explained_in_words() -> None:
    """No acknowledge means wire, power or channel."""
    with (
        ScriptedBus((RESET, NackError("no acknowledge"))) as bus,
        pytest.raises(HardwareError, match="no answer at 0x48: broken wire, no supply, or another mux chan"),
    ):
        ad7746.reset_and_check_identity(bus, VirtualClock())


def configured(
    *answers: bytes, then: tuple[tuple[Transaction, bytes | Exception], ...] = ()
) -> tuple[Reading, float]:
    """Return the result of `configure_and_measure_capdac` for two conversions with 0 and 20 steps, each read twice."""
    script: list[tuple[Transaction, bytes | Exception]] = [(ROWS_OFF, b""), (COLUMNS_OFF, b"")]
    for number, answer in enumerate(answers):
        if number % 2 == 0:
            script += [(settings(20 * (number // 2)), b""), (START, b"")]
        script.append((READ_RESULT, answer))
    with ScriptedBus(*script, *then) as bus:
        return ad7746.configure_and_measure_capdac(bus, VirtualClock())


def test_what_the_capdac_takes_off_is_measured() -> None:
    """20 steps off nothing read as -3.072 pF: 40 steps are 6.144 pF. That is what the chip is left with."""
    zero, below = b"\x00\x80\x00\x00", b"\x00\x20\x00\x00"
    status_read = b"\x07"
    reading, offset_pf = configured(
        zero, status_read + zero[1:], below, status_read + below[1:], then=((settings(40), b""),)
    )
    assert reading is Reading.OK
    assert offset_pf == pytest.approx(6.144, abs=1e-12)


def test_a_bit_that_a_wire_flipped_is_not_kept() -> None:
    """Both readings of one result must agree; a step beyond what a chip can have is no step."""
    zero = b"\x00\x80\x00\x00"
    assert configured(zero, b"\x07\x80\x40\x00")[0] is Reading.CORRUPT
    far = b"\x00\x30\x00\x00"  # 20 steps of 128 fF
    assert configured(zero, zero, far, far, then=((settings(40), b""),))[0] is Reading.CORRUPT


def test_a_chip_of_no_use_says_why() -> None:
    """One that does not finish, and one whose excitation is shorted."""
    assert configured(b"\x07\x00\x00\x00", b"\x07\x00\x00\x00")[0] is Reading.NOT_READY
    assert configured(b"\x0a\x80\x00\x00")[0] is Reading.EXCITATION


@pytest.mark.parametrize(
    ("rate_sps", "configuration"),
    [(91, 0x02), (84, 0x0A), (50, 0x12), (26, 0x1A), (16, 0x22), (13, 0x2A), (11, 0x32), (9, 0x3A)],
)
def test_the_rate_stands_in_the_configuration_register(rate_sps: int, configuration: int) -> None:
    """CAPFS is bits 5 to 3 of 0x0A, not of the set-up at 0x07, and mode 2 is single; mode 0 would be idle."""
    plan = scan_plan(rate_sps, "ad7746")
    assert {step.results[0].trigger for step in plan.steps} == {
        Transaction(0x48, bytes((0x0A, configuration)))
    }


def test_an_element_is_a_row_at_the_excitation_and_a_column_at_the_input() -> None:
    """All other lines are at ground; only what changes is written."""
    plan = scan_plan(91, "ad7746")
    steps = {step.results[0].element: step for step in plan.steps}
    assert steps[5].select == (Transaction(0x49, b"\x2a"), Transaction(0x4A, b"\x1c"))
    assert steps[0].results[0].read == (READ_RESULT,)
    assert sum(len(step.select_changes) for step in plan.steps) == 6 + 9


@pytest.mark.parametrize(
    ("answer", "reading", "expected_pf"),
    [
        (b"\x02\x80\x00\x00", Reading.OK, 0.0),
        (b"\x00\x80\x00\x01", Reading.OK, 4.096 / 2**23),
        (b"\x00\x7f\xff\xff", Reading.OK, -4.096 / 2**23),
        (b"\x00\xff\xff\xfe", Reading.OK, 4.096 * (1 - 2**-22)),
        (b"\x00\xff\xff\xff", Reading.OVER_RANGE, NAN),
        (b"\x00\x00\x00\x00", Reading.UNDER_RANGE, NAN),
        (b"\x07\x80\x00\x01", Reading.NOT_READY, NAN),
        (b"\x08\x80\x00\x01", Reading.EXCITATION, NAN),
        (b"\x10\x80\x00\x01", Reading.CORRUPT, NAN),
        (b"\x05\x80\x00\x01", Reading.NOT_READY, NAN),
        (b"\x04\x80\x00\x01", Reading.CORRUPT, NAN),
        (b"\xff\xff\xff\xff", Reading.CORRUPT, NAN),
    ],
)
def test_results_are_offset_binary_behind_their_status(
    answer: bytes, reading: Reading, expected_pf: float
) -> None:
    """Zero is 0x800000; the ends of the range, old data and a bad excitation are no numbers."""
    [(got, value_pf)] = ad7746.decode_results([answer], 1)
    assert got is reading
    np.testing.assert_equal(value_pf, expected_pf)


@pytest.mark.parametrize(
    ("answer", "expected_c"),
    [
        (b"\x01\x00\x00\x00\x80\xc8\x00", 25.0),
        (b"\x01\x00\x00\x00\x80\xc8\x01", 25.0 + 1 / 2048),
        (b"\x01\x80\x00\x07\x7f\xd8\x00", -5.0),
        (b"\x07\x00\x00\x00\x80\xc8\x00", NAN),
        (b"\x01\x00\x00\x00\xff\xff\xff", NAN),
        (b"\xff\xff\xff\xff\xff\xff\xff", NAN),
    ],
)
def test_a_temperature_has_all_its_24_bits(answer: bytes, expected_c: float) -> None:
    """1/2048 deg C each, the lowest byte its own; without RDYVT, or another the second time, there is none."""
    again = b"\x07" + answer[1:]
    np.testing.assert_equal(ad7746.decode_temperature(answer, again), expected_c)
    flipped = again[:4] + bytes([again[4] ^ 1]) + again[5:]
    np.testing.assert_equal(ad7746.decode_temperature(answer, flipped), NAN)


def test_the_temperature_is_given_its_own_time() -> None:
    """20.1 ms and the clock's tolerance, not the 11 ms of a capacitance, which is not converted meanwhile."""
    thermometer = ad7746.BOARD.thermometer
    assert thermometer is not None
    assert thermometer.start == (Transaction(0x48, b"\x07\x00\x81"), START)
    assert thermometer.read == Transaction(0x48, b"\x00", 7)
    assert thermometer.wait_ns == 20_502_000


def test_a_lost_capdac_is_asked_for_once_a_scan() -> None:
    """40 steps, enabled, the second one off; and the offset that a reset leaves, which other chips do not have."""
    plan = scan_plan(91, "ad7746")
    checks = [step.setting_checks for step in plan.steps]
    assert checks[:-1] == [()] * 8
    assert checks[-1] == ((Transaction(0x48, b"\x0b", 4), b"\xa8\x00\x80\x00"),)


def test_nothing_but_the_lines_and_the_start_is_written_for_an_element() -> None:
    """The CAPDAC stays as it is between elements: its steps are no measure."""
    for step in scan_plan(91, "ad7746").steps:
        written = [
            write.write[0]
            for write in (*step.select_changes, step.results[0].trigger)
            if write.address == 0x48
        ]
        assert written == [0x0A]
