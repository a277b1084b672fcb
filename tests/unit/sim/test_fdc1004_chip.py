"""The simulated FDC1004 behaves as its data sheet says, register by register."""

import struct

import numpy as np
import pytest

from firmware_interface.chips.fdc1004 import CODES_PER_PF, RATES
from footsense.sim.chips.fdc1004 import SimulatedFdc1004

TRIGGER_1_AT_400 = b"\x0c\x0c\x80"
TRIGGER_2_AT_400 = b"\x0c\x0c\x40"
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


@pytest.mark.parametrize(
    "steps",
    [
        # 0x7FFF and no DONE_1 while it runs; then the result and DONE_1, which reading the result clears; and again.
        [
            *(
                (0, TRIGGER_1_AT_400, None),
                (T_CONV_NS - 1, MEAS1_MSB, 0x7FFF),
                (T_CONV_NS - 1, READ_CONF, 0x0C80),
            ),
            *((T_CONV_NS, READ_CONF, 0x0C88), (T_CONV_NS, MEAS1_MSB, 0x2B00), (T_CONV_NS, READ_CONF, 0x0C80)),
            *((T_CONV_NS, TRIGGER_1_AT_400, None), (2 * T_CONV_NS - 1, MEAS1_MSB, 0x7FFF)),
            *((2 * T_CONV_NS - 1, READ_CONF, 0x0C80), (2 * T_CONV_NS, MEAS1_MSB, 0x2B00)),
        ],
        # A trigger of two measurements without repeat starts neither, so DONE never comes.
        [(0, b"\x0c\x0c\xc0", None), (10 * T_CONV_NS, READ_CONF, 0x0CC0)],
        # A second trigger abandons the running conversion: DONE_2 alone comes, in its own time.
        [
            *((0, TRIGGER_1_AT_400, None), (T_CONV_NS // 2, TRIGGER_2_AT_400, None)),
            (10 * T_CONV_NS, READ_CONF, 0x0C44),
        ],
        # A result stays while another slot converts, so that it can be read then.
        [
            *((0, TRIGGER_1_AT_400, None), (T_CONV_NS, TRIGGER_2_AT_400, None)),
            (T_CONV_NS + 1000, MEAS1_MSB, 0x2B00),
        ],
        # Bit 15 of 0x0C restores the reset values and stops a conversion.
        [
            *((0, TRIGGER_1_AT_400, None), (1000, b"\x0c\x80\x00", None)),
            *((2000, b"\x09", 0x1C00), (10 * T_CONV_NS, READ_CONF, 0)),
        ],
    ],
)
def test_registers_and_times(steps: list[tuple[int, bytes, int | None]]) -> None:
    """At times [ns] writes, and the words read behind them, of a chip that measures 5.375 pF."""
    chip = chip_on(5.375)
    for t_ns, written, read in steps:
        if read is None:
            chip.write(written, t_ns)
        else:
            assert word(chip, written, t_ns) == read, (t_ns, written)


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
