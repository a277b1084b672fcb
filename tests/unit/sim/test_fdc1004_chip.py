"""The simulated FDC1004 behaves as its data sheet says, register by register."""

import struct

import numpy as np
import pytest

from firmware_interface.chips.fdc1004 import CODES_PER_PF, RATES
from footsense.sim.chips.fdc1004 import SimulatedFdc1004

TRIGGER_1_AT_400 = b"\x0c\x0c\x80"
READ_CONF = b"\x0c"
MEAS1_MSB = b"\x00"
T_CONV_NS = 2_500_000


def chip_on(capacitance_pf: float, noise: np.random.Generator | None = None) -> SimulatedFdc1004:
    chip = SimulatedFdc1004(lambda cin, t_start, t_end: capacitance_pf, noise)
    for slot, config in enumerate((b"\x1c\x00", b"\x3c\x00", b"\x5c\x00")):
        chip.write(bytes((8 + slot,)) + config, 0)
    return chip


def word(chip: SimulatedFdc1004, pointer: bytes, t_ns: int) -> int:
    chip.write(pointer, t_ns)
    return int.from_bytes(chip.read(2, t_ns), "big")


def test_a_conversion_is_not_ready_before_its_time_and_done_until_it_is_read() -> None:
    """0x7FFF and no DONE_1 while it runs; then the result and DONE_1, which reading the result clears."""
    chip = chip_on(5.375)
    chip.write(TRIGGER_1_AT_400, 0)
    assert word(chip, MEAS1_MSB, T_CONV_NS - 1) == 0x7FFF
    assert word(chip, READ_CONF, T_CONV_NS - 1) == 0x0C80
    assert word(chip, READ_CONF, T_CONV_NS) == 0x0C88
    assert word(chip, MEAS1_MSB, T_CONV_NS) == 0x2B00
    assert word(chip, READ_CONF, T_CONV_NS) == 0x0C80
    chip.write(TRIGGER_1_AT_400, T_CONV_NS)
    assert word(chip, MEAS1_MSB, 2 * T_CONV_NS - 1) == 0x7FFF
    assert word(chip, READ_CONF, 2 * T_CONV_NS - 1) == 0x0C80
    assert word(chip, MEAS1_MSB, 2 * T_CONV_NS) == 0x2B00


def test_only_one_measurement_at_a_time_without_repeat() -> None:
    """A trigger of two measurements starts neither, so DONE never comes."""
    chip = chip_on(5.0)
    chip.write(b"\x0c\x0c\xc0", 0)
    assert word(chip, READ_CONF, 10 * T_CONV_NS) & 0xF == 0


def test_a_second_trigger_abandons_the_running_conversion() -> None:
    """The first measurement never gets done; the second does, in its own time."""
    chip = chip_on(5.0)
    chip.write(TRIGGER_1_AT_400, 0)
    chip.write(b"\x0c\x0c\x40", T_CONV_NS // 2)
    assert word(chip, READ_CONF, 10 * T_CONV_NS) & 0xF == 0b0100


def test_a_result_stays_while_another_slot_converts() -> None:
    """This is what lets a result be read during the next conversion."""
    chip = chip_on(5.375)
    chip.write(TRIGGER_1_AT_400, 0)
    chip.write(b"\x0c\x0c\x40", T_CONV_NS)
    assert word(chip, MEAS1_MSB, T_CONV_NS + 1000) == 0x2B00


def test_reset_forgets_everything() -> None:
    """Bit 15 of 0x0C restores the reset values and stops a conversion."""
    chip = chip_on(5.0)
    chip.write(TRIGGER_1_AT_400, 0)
    chip.write(b"\x0c\x80\x00", 1000)
    assert word(chip, b"\x09", 2000) == 0x1C00
    assert word(chip, READ_CONF, 10 * T_CONV_NS) == 0


@pytest.mark.parametrize(("capacitance_pf", "msb"), [(16.5, 0x7FFF), (-17.0, 0x8000), (15.9, 0x7F33)])
def test_the_result_clips_at_the_ends_of_its_range(capacitance_pf: float, msb: int) -> None:
    """The 24-bit code ends at +-16 pF."""
    chip = chip_on(capacitance_pf)
    chip.write(TRIGGER_1_AT_400, 0)
    assert word(chip, MEAS1_MSB, T_CONV_NS) == msb


@pytest.mark.parametrize("rate_sps", [100, 200, 400])
def test_noise_grows_with_the_rate_as_specified(rate_sps: int) -> None:
    """33.2 aF/sqrt(Hz): 0.24, 0.33 and 0.47 fF rms, within what 2000 samples can tell."""
    rate = RATES[rate_sps]
    chip = chip_on(5.0, np.random.default_rng(1))
    codes = []
    for n in range(2000):
        chip.write(b"\x0c" + bytes(((rate.code << 2), 0x80)), n * rate.conversion_ns)
        t_ns = (n + 1) * rate.conversion_ns
        codes.append(word(chip, b"\x01", t_ns) >> 8 | word(chip, MEAS1_MSB, t_ns) << 8)
    noise_ff = np.std(np.array(codes) / 2**19) * 1e3
    assert noise_ff == pytest.approx(rate.noise_ff, rel=0.06)


@pytest.mark.parametrize(
    ("capdac", "seen_pf", "read_pf"),
    [
        (5, 16.25, 16.25 - 5 * 3.125),
        (8, 20.0, 20.0 - 8 * 3.125),
        (5, 40.0, 16.0),
    ],
)
def test_the_capdac_takes_off_its_nominal_steps(capdac: int, seen_pf: float, read_pf: float) -> None:
    """One step takes 3.125 pF off; the range ends 16 pF above."""
    chip = SimulatedFdc1004(lambda cin, t_start, t_end: seen_pf, None)
    chip.write(bytes((0x08, 0x10 | capdac >> 3, capdac << 5 & 0xFF)), 0)
    chip.write(TRIGGER_1_AT_400, 0)
    upper, lower = word(chip, MEAS1_MSB, T_CONV_NS), word(chip, b"\x01", T_CONV_NS)
    code = struct.unpack(">i", struct.pack(">HH", upper, lower))[0] >> 8
    assert code / CODES_PER_PF == pytest.approx(read_pf, abs=3e-6)
