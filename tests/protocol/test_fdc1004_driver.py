"""The bytes that the FDC1004 driver puts on the wire, pinned to the data sheet (TI SNOSCY5, section 8.6)."""

import numpy as np
import pytest

from firmware_interface.chips.fdc1004 import RATES
from footsense.acquisition.boards import fdc1004
from footsense.acquisition.leg_bus import reading_of_poll
from footsense.acquisition.scan_plan import scan_plan
from footsense.errors import HardwareError, NackError
from footsense.frames import Reading
from footsense.ports import Transaction
from tests.protocol.scripted_bus import ScriptedBus

NAN = float("nan")
READ_MANUFACTURER = Transaction(0x50, b"\xfe", 2)
READ_DEVICE = Transaction(0x50, b"\xff", 2)


def test_the_right_chip_is_recognised_by_both_ids() -> None:
    """0x5449 ("TI") and 0x1004 are what an FDC1004 says of itself."""
    with ScriptedBus((READ_MANUFACTURER, b"\x54\x49"), (READ_DEVICE, b"\x10\x04")) as bus:
        fdc1004.check_identity(bus)


@pytest.mark.parametrize(
    ("manufacturer", "device", "hint"),
    [
        (b"\xff\xff", b"\xff\xff", "no chip drives the lines"),
        (b"\x00\x00", b"\x00\x00", "SDA is held low"),
        (b"\x12\x34", b"\x56\x78", "EEPROM"),
    ],
)
def test_a_wrong_id_is_explained_in_words(manufacturer: bytes, device: bytes, hint: str) -> None:
    """What a wrong answer usually means is part of the error."""
    with (
        ScriptedBus((READ_MANUFACTURER, manufacturer), (READ_DEVICE, device)) as bus,
        pytest.raises(HardwareError, match=hint),
    ):
        fdc1004.check_identity(bus)


def test_silence_is_explained_in_words() -> None:
    """No acknowledge means wire, power or channel."""
    with (
        ScriptedBus((READ_MANUFACTURER, NackError("no acknowledge"))) as bus,
        pytest.raises(
            HardwareError, match=r"no answer at 0x50: broken wire, no 3\.3 V, or another mux channel"
        ),
    ):
        fdc1004.check_identity(bus)


def test_configuration_is_reset_then_one_cin_per_slot() -> None:
    """Reset is bit 15 of 0x0C; CHA = CINn, CHB = disabled gives 0x1C00, 0x3C00, 0x5C00 in 0x08 to 0x0A."""
    writes = (b"\x0c\x80\x00", b"\x08\x1c\x00", b"\x09\x3c\x00", b"\x0a\x5c\x00")
    assert tuple(Transaction(0x50, write) for write in writes) == fdc1004.SET_UP


def test_the_plan_triggers_one_measurement_at_a_time() -> None:
    """At 400 S/s the triggers are 0x0C80, 0x0C40, 0x0C20; the rows are grounded one by one, the others shielded."""
    steps = {step.element: step for step in scan_plan(400).steps}
    assert [steps[e].trigger.write.hex() for e in (0, 1, 2)] == ["0c0c80", "0c0c40", "0c0c20"]
    assert [steps[e].select for e in (0, 3, 6)] == [
        Transaction(0x49, bytes((switches,))) for switches in (0b110001, 0b101010, 0b011100)
    ]
    assert steps[4].read_value == (Transaction(0x50, b"\x02", 2),)


def test_slower_rates_read_the_lower_half_of_the_result_too() -> None:
    """Below 400 S/s the bus has time for the register that holds the last 8 bits."""
    step = scan_plan(100).steps[0]
    assert step.element == 5
    assert step.read == (Transaction(0x50, b"\x04", 2), Transaction(0x50, b"\x05", 2))


def test_no_step_reads_a_slot_that_the_next_one_converts() -> None:
    """A result is read while the following conversion runs, so neighbours must use different slots."""
    slots = [step.read[0].write for step in scan_plan(400).steps]
    assert all(slot != following for slot, following in zip(slots, slots[1:] + slots[:1], strict=True))


@pytest.mark.parametrize(
    ("answers", "reading", "expected_pf"),
    [
        ([b"\x2b\x00"], Reading.OK, 5.375),
        ([b"\x2b\x00", b"\x01\x00"], Reading.OK, 5.375 + 2**-19),
        ([b"\xff\xff", b"\xff\x00"], Reading.OK, -(2**-19)),
        ([b"\x00\x00"], Reading.UNDER_RANGE, NAN),  # as after a reset
        ([b"\x00\x00", b"\x01\x00"], Reading.OK, 2**-19),
        ([b"\x7f\xff"], Reading.OVER_RANGE, NAN),
        ([b"\x80\x00"], Reading.OVER_RANGE, NAN),
        ([b"\x2b\x00", b"\x01\x04"], Reading.CORRUPT, NAN),
    ],
)
def test_results_are_two_s_complement_with_19_fractional_bits(
    answers: list[bytes], reading: Reading, expected_pf: float
) -> None:
    """Also just below zero, where a known driver jumps by 32 pF; an end of the range and reserved bits are none."""
    [(got, value_pf)] = fdc1004.decode_results(answers, 1)
    assert got is reading
    np.testing.assert_equal(value_pf, expected_pf)


@pytest.mark.parametrize(
    ("answer", "reading"),
    [
        (b"\x0c\x80", Reading.NOT_READY),
        (b"\x0c\x87", Reading.NOT_READY),
        (b"\x0c\x8f", Reading.OK),
        (b"\x0c\x88", Reading.OK),
        (b"\x00\x00", Reading.NOT_READY),
        (b"\x0d\x88", Reading.CORRUPT),
        (b"\xff\xff", Reading.CORRUPT),
    ],
)
def test_the_done_bit_is_believed_only_without_bits_that_no_converter_sends(
    answer: bytes, reading: Reading
) -> None:
    """In FDC_CONF the reserved bits 14 to 12 and 9, and REPEAT, which is never asked for."""
    assert reading_of_poll(fdc1004.step(0, RATES[400]).done, answer) is reading
