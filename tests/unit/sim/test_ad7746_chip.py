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


def test_writes_run_through_the_registers_too() -> None:
    """One burst sets six of them; the status cannot be written."""
    chip = chip_on(1.0)
    chip.write(b"\x07\x80\x00\x0b\x00\xa1\x00", 0)
    chip.write(b"\x00\x00", 0)
    assert burst(chip, 0x07, 6, 0) == b"\x80\x00\x0b\x00\xa1\x00"
    assert burst(chip, 0x00, 1, 0) == b"\x07"


def test_a_single_conversion_ends_in_its_time_and_leaves_the_chip_idle() -> None:
    """RDY and RDYCAP fall, and rise once the data is read; what was read stays."""
    chip = chip_on(2.048)
    chip.write(SINGLE, 0)
    assert burst(chip, 0x00, 4, T_CONV_NS - 1) == b"\x07\x00\x00\x00"
    assert burst(chip, 0x0A, 1, T_CONV_NS - 1) == b"\x02"
    assert burst(chip, 0x0A, 1, T_CONV_NS) == b"\x00"
    assert burst(chip, 0x00, 4, T_CONV_NS) == b"\x02\xc0\x00\x00"
    assert burst(chip, 0x00, 4, 99 * T_CONV_NS) == b"\x07\xc0\x00\x00"


def test_a_result_stays_unread_while_the_next_conversion_runs() -> None:
    """This is what lets a result be read during the next conversion."""
    chip = chip_on(2.048)
    chip.write(SINGLE, 0)
    chip.write(SINGLE, T_CONV_NS)
    assert burst(chip, 0x00, 4, T_CONV_NS + 1000) == b"\x02\xc0\x00\x00"
    assert burst(chip, 0x00, 4, T_CONV_NS + 2000)[0] == 0x07
    assert burst(chip, 0x00, 4, 2 * T_CONV_NS)[0] == 0x02


def test_a_second_start_abandons_the_conversion_that_runs() -> None:
    """The first one never ends; the second does, in its own time."""
    chip = chip_on(2.048)
    chip.write(SINGLE, 0)
    chip.write(SINGLE, T_CONV_NS // 2)
    assert burst(chip, 0x00, 1, T_CONV_NS + 1) == b"\x07"
    assert burst(chip, 0x00, 1, T_CONV_NS // 2 + T_CONV_NS) == b"\x02"


@pytest.mark.parametrize("configuration", [b"\x0a\x00", b"\x0a\x03"])
def test_idle_and_power_down_convert_nothing(configuration: bytes) -> None:
    """Mode 0 is idle, whatever some libraries take it for."""
    assert code_of(chip_on(2.048), configuration) == 0


def test_without_enable_or_excitation_there_is_no_capacitance() -> None:
    """CAPEN off: no conversion at all; EXCA off: nothing arrives."""
    chip = chip_on(2.048)
    chip.write(b"\x07\x00", 0)
    assert code_of(chip) == 0
    chip = chip_on(2.048)
    chip.write(b"\x09\x03", 0)
    assert code_of(chip) == 0x800000


def test_temperature_adds_its_own_conversion() -> None:
    """11 ms and 20.1 ms, one after the other; RDY falls with the last; 25 deg C is 0x80C800."""
    chip = chip_on(0.0)
    chip.write(BOTH, 0)
    chip.write(SINGLE, 0)
    ends_ns = T_CONV_NS + 20_100_000
    assert burst(chip, 0x00, 1, T_CONV_NS) == b"\x06"
    assert burst(chip, 0x00, 1, ends_ns - 1) == b"\x06"
    assert burst(chip, 0x00, 7, ends_ns) == b"\x00\x80\x00\x00\x80\xc8\x00"
    assert burst(chip, 0x00, 1, ends_ns) == b"\x07"


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
