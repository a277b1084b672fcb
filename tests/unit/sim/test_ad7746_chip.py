"""The simulated AD7746 behaves as its data sheet says, register by register."""

import numpy as np
import pytest

from firmware_interface.chips.ad7746 import RATES
from footsense.sim.chips.ad7746 import SimulatedAd7746

MS_NS = 1_000_000
T_CONV_NS = 11 * MS_NS
RESET = b"\xbf"
#: CAPEN; EXCA at half the supply.
CAPACITANCE = b"\x07\x80\x00\x0b"
BOTH = b"\x07\x80\x81\x0b"
SINGLE = b"\x0a\x02"


def chip_on(
    capacitance_pf: float,
    noise: np.random.Generator | None = None,
    *,
    shorted: bool = False,
    capdac_gain_rel: float = 1.0,
    temperature_c: float = 25.0,
) -> SimulatedAd7746:
    chip = SimulatedAd7746(
        lambda t_start, t_end: (capacitance_pf, shorted),
        noise,
        capdac_gain_rel=capdac_gain_rel,
        temperature_c=lambda t_ns: temperature_c,
    )
    chip.write(CAPACITANCE, 0)
    return chip


def burst(chip: SimulatedAd7746, pointer: int, n: int, t_ns: int) -> bytes:
    chip.write(bytes((pointer,)), t_ns)
    return chip.read(n, t_ns)


def code_of(chip: SimulatedAd7746, configuration: bytes = SINGLE) -> int:
    chip.write(configuration, 0)
    return int.from_bytes(burst(chip, 0x01, 3, 200 * MS_NS), "big")


def test_a_reset_restores_the_registers_and_silences_the_chip_for_200_us() -> None:
    """Not 199 us; the pointer then runs through all registers by itself."""
    chip = chip_on(1.0)
    chip.write(RESET, 1000)
    assert [chip.acknowledges(1000 + t) for t in (0, 199_999, 200_000)] == [False, False, True]
    registers = burst(chip, 0x00, 0x13, 300_000)
    assert registers[:0x0F].hex() == "07" + 6 * "00" + "000003a000008000"


@pytest.mark.parametrize(
    "steps",
    [
        # One burst sets six registers; the status cannot be written.
        [(0, b"\x07\x80\x00\x0b\x00\xa1\x00"), (0, b"\x00\x00"), (0, 0x07, "80000b00a100"), (0, 0x00, "07")],
        # A single conversion ends in its time and leaves the chip idle: RDY and RDYCAP fall, and rise once the data is
        # read; what was read stays.
        [
            (0, SINGLE),
            *((T_CONV_NS - 1, 0x00, "07000000"), (T_CONV_NS - 1, 0x0A, "02")),
            *((T_CONV_NS, 0x0A, "00"), (T_CONV_NS, 0x00, "02c00000"), (99 * T_CONV_NS, 0x00, "07c00000")),
        ],
        # A result stays unread while the next conversion runs: it can be read during that.
        [
            *((0, SINGLE), (T_CONV_NS, SINGLE), (T_CONV_NS + 1000, 0x00, "02c00000")),
            *((T_CONV_NS + 2000, 0x00, "07"), (2 * T_CONV_NS, 0x00, "02")),
        ],
        # A second start abandons the conversion that runs, and ends in its own time.
        [(0, SINGLE), (5 * MS_NS, SINGLE), (T_CONV_NS + 1, 0x00, "07"), (T_CONV_NS + 5 * MS_NS, 0x00, "02")],
        # Idle, which is mode 0 whatever some libraries take it for, and power-down convert nothing.
        [(0, b"\x0a\x00"), (200 * MS_NS, 0x01, "000000")],
        [(0, b"\x0a\x03"), (200 * MS_NS, 0x01, "000000")],
        # Without CAPEN there is no conversion, without EXCA nothing arrives.
        [(0, b"\x07\x00"), (0, SINGLE), (200 * MS_NS, 0x01, "000000")],
        [(0, b"\x09\x03"), (0, SINGLE), (200 * MS_NS, 0x01, "800000")],
        # A temperature adds its own 20.1 ms; RDY falls with the last; 25 deg C is 0x80C800.
        [
            *((0, BOTH), (0, SINGLE), (T_CONV_NS, 0x00, "06"), (T_CONV_NS + 20_099_999, 0x00, "06")),
            *((T_CONV_NS + 20_100_000, 0x00, "00c0000080c800"), (T_CONV_NS + 20_100_000, 0x00, "07")),
        ],
    ],
)
def test_registers_and_times(steps: list[tuple[int, bytes] | tuple[int, int, str]]) -> None:
    """At times [ns] writes, and reads from a register on, of a chip that measures half of its range."""
    chip = chip_on(2.048)
    for t_ns, what, *read in steps:
        if isinstance(what, bytes):
            chip.write(what, t_ns)
        else:
            assert burst(chip, what, len(read[0]) // 2, t_ns).hex() == read[0], (t_ns, what)


@pytest.mark.parametrize(("capacitance_pf", "code"), [(4.2, 0xFFFFFF), (-4.2, 0), (4.0, 0xFD0000)])
def test_codes_end_at_both_ends_of_the_range(capacitance_pf: float, code: int) -> None:
    """+-4.096 pF, offset binary."""
    assert code_of(chip_on(capacitance_pf)) == code


@pytest.mark.parametrize("gain_rel", [0.85, 1.2])
def test_the_capdac_takes_off_steps_of_the_chip_s_own_size(gain_rel: float) -> None:
    """Only with its enable bit."""
    chip = chip_on(5.0, capdac_gain_rel=gain_rel)
    chip.write(b"\x0b\x21", 0)
    assert code_of(chip) == 0xFFFFFF
    chip.write(b"\x0b\xa1", 0)
    assert (code_of(chip) - 0x800000) * 4.096 / 0x800000 == pytest.approx(
        5.0 - 33 * 21 / 127 * gain_rel, abs=1e-6
    )


def test_a_shorted_excitation_sets_its_bit() -> None:
    """EXCERR is bit 3; the conversion ends all the same."""
    chip = chip_on(1.0, shorted=True)
    chip.write(SINGLE, 0)
    assert burst(chip, 0x00, 1, T_CONV_NS) == b"\x0a"


@pytest.mark.parametrize("rate_sps", list(RATES))
def test_conversion_time_and_noise_are_those_of_its_rate(rate_sps: int) -> None:
    """CAPFS is bits 5 to 3 of CONFIGURATION; noise within what 500 samples can tell."""
    rate = RATES[rate_sps]
    chip = chip_on(0.0, np.random.default_rng(1))
    codes = []
    for n in range(500):
        t_ns = n * 2 * rate.conversion_ns
        chip.write(bytes((0x0A, rate.code << 3 | 2)), t_ns)
        assert burst(chip, 0x00, 1, t_ns + rate.conversion_ns - 1) == b"\x07"
        codes.append(int.from_bytes(burst(chip, 0x00, 4, t_ns + rate.conversion_ns)[1:], "big"))
    noise_ff = np.std(np.array(codes)) * 4096 / 0x800000
    assert noise_ff == pytest.approx(rate.noise_ff, rel=0.12)
