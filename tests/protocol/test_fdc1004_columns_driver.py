"""The bytes of board `fdc1004_columns`: three FDC1004 (TI SNOSCY5, section 8.6), two of them behind an LTC4317."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_interface.chips.ltc4317 import input_address
from footsense.acquisition.boards import fdc1004_columns
from footsense.acquisition.leg_bus import reading_of_polls
from footsense.acquisition.scan_plan import scan_plan
from footsense.errors import HardwareError, NackError
from footsense.frames import Reading
from footsense.ports import Transaction
from tests.protocol.scripted_bus import ScriptedBus

ADDRESSES = (0x50, 0x51, 0x52)
NACK = NackError("no acknowledge")


@given(st.integers(0, 0x7F), st.integers(0, 0x7F))
def test_a_translator_inverts_bits_and_twice_is_none(address: int, translation: int) -> None:
    """Source: LTC4317 data sheet, its example of 0x36 and 0x34 in eight bits, by 0x02."""
    assert input_address(0x36 >> 1, 0x02 >> 1) == 0x34 >> 1
    assert input_address(input_address(address, translation), translation) == address


def test_an_address_of_eight_bits_is_refused() -> None:
    with pytest.raises(ValueError, match="seven bits"):
        input_address(0xA0, 1)


def test_a_step_converts_a_row_on_three_chips() -> None:
    """Slot n is CIN n + 1, the element of row n: triggers 0x0C80, 0x0C40, 0x0C20, and no line is switched."""
    for row, (step, word) in enumerate(
        zip(scan_plan(400, "fdc1004_columns").steps, ("0c80", "0c40", "0c20"), strict=True)
    ):
        assert (step.select, step.select_checks) == ((), ())
        assert [result.element for result in step.results] == [3 * row, 3 * row + 1, 3 * row + 2]
        trigger = bytes.fromhex("0c" + word)
        assert [result.trigger for result in step.results] == [Transaction(at, trigger) for at in ADDRESSES]
        upper = [(Transaction(at, bytes((2 * row,)), 2),) for at in ADDRESSES]
        assert [result.read_value for result in step.results] == upper
        # After the trigger the pointer is at FDC_CONF, and the answer means the same.
        assert [done.read for done in step.done] == [Transaction(at, b"\x0c", 2) for at in ADDRESSES]
        assert [done.read for done in step.done_after_start] == [Transaction(at, b"", 2) for at in ADDRESSES]
        set_by_row = bytes((0x0C, 0x80 | 8 >> row))
        for done in (*step.done, *step.done_after_start):
            assert reading_of_polls([done], [set_by_row]) is Reading.OK
            assert reading_of_polls([done], [b"\x0c\x80"]) is Reading.NOT_READY


def test_settings_are_asked_of_one_chip_a_step() -> None:
    steps = scan_plan(400, "fdc1004_columns").steps
    asked = [(check.read, check.expected) for step in steps for check in step.setting_checks]
    assert asked == [(Transaction(at, b"\x09", 2), b"\x3c\x00") for at in ADDRESSES]


def test_each_chip_is_reset_and_set_up() -> None:
    """Reset is bit 15 of 0x0C; CHA = CINn, CHB = disabled. So is one whose state is not known."""
    writes = ("0c8000", "081c00", "093c00", "0a5c00")
    expected = tuple(Transaction(at, bytes.fromhex(write)) for at in ADDRESSES for write in writes)
    assert fdc1004_columns.BOARD.set_up == fdc1004_columns.BOARD.make_ready == expected


@pytest.mark.parametrize(
    ("silent", "says"),
    [
        ((), None),
        ((0x50, 0x51, 0x52), "no answer at 0x50: broken wire, no 3.3 V, or another mux channel"),
        ((0x50,), "no answer at 0x50: broken wire, no 3.3 V, or a converter of its own"),
        ((0x51, 0x52), "no answer at 0x51: .* a dead address translator .* that of column 0 answers"),
        ((0x51,), "no answer at 0x51: .* two converters at one address: resistors XORL1"),
        ((0x52,), "no answer at 0x52: .* two converters at one address: resistors XORL2"),
    ],
)
def test_which_chip_is_missing_is_told(silent: tuple[int, ...], says: str | None) -> None:
    """One line, that names the address, the likely part, and who answers."""
    script: list[tuple[Transaction, bytes | Exception]] = [
        (Transaction(at, b"\xff", 2), NACK if at in silent else b"\x10\x04") for at in ADDRESSES
    ]
    for at in ADDRESSES:
        script += [(Transaction(at, b"\xfe", 2), NACK if at in silent else b"\x54\x49")]
        if at in silent:
            break
        script += [(Transaction(at, b"\xff", 2), b"\x10\x04")]
    with ScriptedBus(*script) as bus:
        if says is None:
            fdc1004_columns.check_identity(bus)
        else:
            with pytest.raises(HardwareError, match=says):
                fdc1004_columns.check_identity(bus)
