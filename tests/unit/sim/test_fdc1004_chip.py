"""The simulated FDC1004 behaves as its data sheet says, register by register."""

import struct

import numpy as np
import pytest

from firmware_interface.chips.fdc1004 import CODES_PER_PF, RATES
from footsense.errors import NackError
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
        # Bit 15 of 0x0C restores the reset values, stops a conversion and clears results.
        [
            *((0, TRIGGER_1_AT_400, None), (T_CONV_NS, TRIGGER_1_AT_400, None)),
            *((T_CONV_NS + 1000, b"\x0c\x80\x00", None), (T_CONV_NS + 2000, b"\x09", 0x1C00)),
            *((10 * T_CONV_NS, READ_CONF, 0), (10 * T_CONV_NS, MEAS1_MSB, 0)),
        ],
        # CHA = CIN1, CHB = CIN2 is the difference of two pins; the other way round starts nothing.
        [
            *((0, b"\x08\x04\x00", None), (0, TRIGGER_1_AT_400, None), (T_CONV_NS, MEAS1_MSB, 0)),
            *((T_CONV_NS, b"\x08\x20\x00", None), (T_CONV_NS, TRIGGER_1_AT_400, None)),
            (10 * T_CONV_NS, READ_CONF, 0x0C80),
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


@pytest.mark.parametrize("needs_both", [False, True])
@pytest.mark.parametrize("keeps_old", [False, True])
def test_what_clears_done_and_whether_an_old_result_stays(*, needs_both: bool, keeps_old: bool) -> None:
    """The data sheet allows each; the lower register alone clears nothing, and a new result has to be read again."""
    chip = chip_on(5.375)
    chip.done_needs_both_reads, chip.keeps_old_result = needs_both, keeps_old
    chip.write(TRIGGER_1_AT_400, 0)
    for pointer, read, done in (
        (b"\x01", 0, 8),
        (MEAS1_MSB, 0x2B00, 8 if needs_both else 0),
        (b"\x01", 0, 0),
    ):
        assert word(chip, pointer, T_CONV_NS) == read
        assert word(chip, READ_CONF, T_CONV_NS) & 0xF == done
    chip.write(TRIGGER_1_AT_400, T_CONV_NS)
    assert word(chip, MEAS1_MSB, T_CONV_NS + 1000) == (0x2B00 if keeps_old else 0x7FFF)
    assert word(chip, b"\x01", 2 * T_CONV_NS) == 0
    assert word(chip, READ_CONF, 2 * T_CONV_NS) & 0xF == 8


def test_a_chip_that_hangs_converts_again_after_a_reset() -> None:
    """It answers and takes every setting, but is never done."""
    chip = chip_on(5.375)
    chip.hangs_ns.append(T_CONV_NS // 2)
    for start_ns, done in ((0, 0), (2 * T_CONV_NS, 0), (4 * T_CONV_NS, 8)):
        if done:
            chip.write(b"\x0c\x80\x00", start_ns)
        chip.write(TRIGGER_1_AT_400, start_ns)
        assert word(chip, READ_CONF, start_ns + T_CONV_NS) & 0xF == done


@pytest.mark.parametrize("address", [0x15, 0xFD])
def test_a_register_that_is_not_there_is_not_acknowledged(address: int) -> None:
    with pytest.raises(NackError):
        chip_on(5.0).write(bytes((address,)), 0)


@pytest.mark.parametrize(("share_rel", "correlation"), [(0.0, 0.0), (0.8, 0.8)])
def test_channels_have_a_share_of_their_noise_in_common(share_rel: float, correlation: float) -> None:
    """It is the same in two channels that are converted one after the other, and the variance stays."""
    chip = chip_on(5.0, np.random.default_rng(1))
    if share_rel:
        chip.share_noise(share_rel, np.random.default_rng(2))
    codes = []
    for n in range(4000):
        start_ns = (n // 2 * 20 + n % 2) * T_CONV_NS
        chip.write((TRIGGER_1_AT_400, TRIGGER_2_AT_400)[n % 2], start_ns)
        upper, lower = (word(chip, bytes((2 * (n % 2) + at,)), start_ns + T_CONV_NS) for at in (0, 1))
        codes.append(upper << 8 | lower >> 8)
    pairs = np.array(codes).reshape(-1, 2) / 2**19 * 1e3
    assert np.corrcoef(*pairs.T).min() == pytest.approx(correlation, abs=0.06)
    assert pairs.std() == pytest.approx(RATES[400].noise_ff, rel=0.06)


@pytest.mark.parametrize(("capacitance_pf", "msb"), [(16.5, 0x7FFF), (-17.0, 0x8000), (15.9, 0x7F33)])
def test_the_result_clips_at_the_ends_of_its_range(capacitance_pf: float, msb: int) -> None:
    """The 24-bit code ends at +-16 pF."""
    chip = chip_on(capacitance_pf)
    chip.write(TRIGGER_1_AT_400, 0)
    assert word(chip, MEAS1_MSB, T_CONV_NS) == msb


@pytest.mark.parametrize("rate_sps", [100, 200, 400])
def test_noise_grows_with_the_rate_as_specified(rate_sps: int) -> None:
    """16 effective bits of 30 pF at 100 S/s: 0.46, 0.65 and 0.92 fF rms, within what 2000 samples can tell."""
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
