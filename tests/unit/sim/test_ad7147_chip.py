"""The simulated AD7147 behaves as its sources say, byte by byte and at the microsecond, in each of its kinds."""

from collections.abc import Callable, Sequence

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from footsense.daemon.foot_types import released_path
from footsense.errors import NackError
from footsense.foot.response_table import FootResponse
from footsense.foot.specimen import Specimen
from footsense.ports import Transaction
from footsense.sim.chips.ad7147 import SimulatedAd7147
from footsense.sim.chips.electronics import leg_electronics
from footsense.sim.clock import VirtualClock
from footsense.sim.faults import scene_faults
from footsense.sim.faults.chip_faults import inject_chip_faults
from footsense.sim.faults.damage import WiredFoot
from footsense.sim.faults.scene_faults import ChipFault
from footsense.sim.i2c_bus import SimulatedBus
from footsense.sim.scene import Ad7147Effects, Effects

STAGE_NS = 768_000
BIT_NS, BUS_FREE_NS = 2_500, 1_300
FF_PER_CODE = 16_000 / 65536

STATUS, RESULTS, IDENTITY = b"\x00\x0a", b"\x00\x0b", b"\x00\x17"
NINE_STAGES_AT_64 = b"\x00\x00\x02\x80"
RESTART = b"\x00\x02\x8f\xf0"
#: When the sequence of a chip of `nine_stages` starts.
ORIGIN_NS = 10_000_000

CLEAN = Ad7147Effects(junk_sequences=0, noise_ff=0.0)


def connect(stage: int, low: int, high: int, offset: int = 0) -> bytes:
    """Return the bytes that write the first three registers of a stage."""
    return b"".join(word.to_bytes(2, "big") for word in (0x80 + 8 * stage, low, high, offset))


def input_to_stage(cin: int, stage: int, idle: int = 0) -> bytes:
    """Return the bytes that tie one input to the positive input, single-ended, and the others to `idle`."""
    fields = sum((2 if each == cin else idle) << 2 * each for each in range(13))
    return connect(stage, fields & 0x3FFF, fields >> 14 | 0x1000)


def write(chip: SimulatedAd7147, data: bytes, latched_ns: int) -> None:
    """Write so that the last register takes its value at a time [ns]."""
    chip.write(data, latched_ns + BIT_NS + BUS_FREE_NS)


def read(chip: SimulatedAd7147, address: bytes, n: int, start_ns: int) -> list[int]:
    """Return `n` registers from an address on, of which the first is sent from `start_ns` on."""
    t_ns = start_ns + (18 * n + 1) * BIT_NS + BUS_FREE_NS
    chip.write(address, t_ns)
    answer = chip.read(2 * n, t_ns)
    return [int.from_bytes(answer[k : k + 2], "big") for k in range(0, 2 * n, 2)]


def pf_of(code: int) -> float:
    return (code - 0x8000) * FF_PER_CODE * 1e-3


def nine_stages(
    capacitance_pf: Callable[[int, int], float], effects: Ad7147Effects = CLEAN, clock_error_rel: float = 0.0
) -> SimulatedAd7147:
    """Return a chip that converts input k in stage k from `ORIGIN_NS` on; its capacitance is of the middle time."""
    chip = SimulatedAd7147(
        lambda cin, connections, t_start, t_end: capacitance_pf(cin, (t_start + t_end) // 2),
        None,
        clock_error_rel,
        effects=effects,
    )
    write(chip, NINE_STAGES_AT_64, 0)
    for k in range(9):
        write(chip, input_to_stage(k, k), 0)
    write(chip, RESTART, ORIGIN_NS)
    read(chip, STATUS, 1, ORIGIN_NS)
    return chip


def one_input(capacitance_pf: float, configure: Sequence[bytes], **chip_options: object) -> int:
    """Return the code of stage 0 of a chip that sees one capacitance at each input."""
    chip = SimulatedAd7147(lambda *_: capacitance_pf, None, effects=CLEAN, **chip_options)  # type: ignore[arg-type]
    for data in (*configure, RESTART):
        write(chip, data, 0)
    return read(chip, RESULTS, 1, 4_000_000)[0]


# ---------------------------------------------------------------- the sequencer


@pytest.mark.parametrize(
    ("decimation", "stage_ns"), [(2, 768_000), (3, 768_000), (1, 1_536_000), (0, 3_072_000)]
)
@pytest.mark.parametrize("clock_error_rel", [0.0, -0.04, 0.04])
def test_a_stage_ends_at_its_time(decimation: int, stage_ns: int, clock_error_rel: float) -> None:
    """Three stages: the bit of each is set as it ends, a read clears it, and after the last the first comes."""
    chip = SimulatedAd7147(lambda *_: 4.0, None, clock_error_rel, effects=CLEAN)
    write(chip, bytes((0, 0, decimation, 0x20)), 0)
    write(chip, RESTART, 0)
    read(chip, STATUS, 1, 0)
    for n in range(7):
        end_ns = (n + 1) * round(stage_ns * (1 + clock_error_rel))
        assert read(chip, STATUS, 1, end_ns - 1) == [0]
        assert read(chip, STATUS, 1, end_ns) == [1 << n % 3]
    assert read(chip, STATUS, 1, 100 * stage_ns) == [0b111]


def test_a_result_is_that_of_its_stage_and_of_its_last_conversion() -> None:
    """Input k has k pF and 1 fF more a millisecond; the middle of its conversion counts, however late it is read."""
    chip = nine_stages(lambda cin, t_ns: cin / 2 + t_ns * 1e-9)
    codes = read(chip, RESULTS, 9, ORIGIN_NS + 1_000_000_000)
    for k, code in enumerate(codes):
        n = (1_000_000_000 // STAGE_NS - 1 - k) // 9 * 9 + k
        middle_ns = ORIGIN_NS + n * STAGE_NS + STAGE_NS // 2
        assert pf_of(code) == pytest.approx(k / 2 + middle_ns * 1e-9, abs=2e-4)


def test_a_restart_in_the_middle_of_a_sequence_begins_with_stage_0() -> None:
    """The running stage is lost, results stay, and the bit reads as 0."""
    chip = nine_stages(lambda cin, t_ns: 1.0)
    restart_ns = ORIGIN_NS + 5 * STAGE_NS + 1000
    write(chip, RESTART, restart_ns)
    assert read(chip, STATUS, 1, restart_ns + STAGE_NS - 1) == [0b11111]
    assert read(chip, STATUS, 1, restart_ns + STAGE_NS) == [0b1]
    assert read(chip, b"\x00\x02", 1, restart_ns + STAGE_NS) == [0x0FF0]


def test_a_shutdown_converts_nothing_and_is_followed_by_stage_0() -> None:
    chip = nine_stages(lambda cin, t_ns: 1.0)
    down_ns, up_ns = ORIGIN_NS + 3 * STAGE_NS + 5, ORIGIN_NS + 50 * STAGE_NS
    write(chip, b"\x00\x00\x02\x81", down_ns)
    assert read(chip, STATUS, 1, up_ns - 1000) == [0b111]
    write(chip, NINE_STAGES_AT_64, up_ns)
    assert read(chip, STATUS, 1, up_ns + STAGE_NS) == [0b1]


# ---------------------------------------------------------------- bursts


@given(
    start_ns=st.integers(0, 30 * STAGE_NS),
    before_ns=st.sampled_from([0, STAGE_NS, 9 * STAGE_NS]),
    coherent=st.booleans(),
    torn=st.booleans(),
)
def test_each_word_of_a_burst_is_as_at_its_time(
    *, start_ns: int, before_ns: int, coherent: bool, torn: bool
) -> None:
    """Of a burst of status and nine results, with or without a read before, in each kind of chip."""
    effects = Ad7147Effects(junk_sequences=0, noise_ff=0.0, coherent_bursts=coherent, torn_words=torn)
    chip = nine_stages(lambda cin, t_ns: 2.0 + (t_ns - ORIGIN_NS) / STAGE_NS * 0.0125, effects)
    start_ns += ORIGIN_NS + 20 * STAGE_NS
    cleared_ns = start_ns - before_ns
    read(chip, STATUS, 1, cleared_ns)
    status, *codes = read(chip, STATUS, 10, start_ns)

    def ended(t_ns: int) -> int:
        return (t_ns - ORIGIN_NS) // STAGE_NS

    expected_status = {n % 9 for n in range(max(ended(cleared_ns), ended(start_ns) - 9), ended(start_ns))}
    assert status == sum(1 << stage for stage in expected_status)
    for k, code in enumerate(codes):
        code_at = []
        for byte in (2 + 2 * k, 3 + 2 * k) if torn else (2 + 2 * k,) * 2:
            n = ended(start_ns + (0 if coherent else 9 * byte * BIT_NS)) - 1
            n -= (n - k) % 9
            code_at.append(0x8000 + round((2.0 + (n + 0.5) * 0.0125) * 1e3 / FF_PER_CODE))
        assert code == code_at[0] & 0xFF00 | code_at[1] & 0x00FF


def test_a_stage_that_ends_during_a_burst_is_told_by_the_next_status() -> None:
    """In a coherent burst, too."""
    for coherent in (False, True):
        chip = nine_stages(lambda cin, t_ns: 1.0, Ad7147Effects(junk_sequences=0, coherent_bursts=coherent))
        end_ns = ORIGIN_NS + 3 * STAGE_NS
        assert read(chip, STATUS, 10, end_ns - 100_000)[0] == 0b011
        assert read(chip, STATUS, 1, end_ns + 500_000) == [0b100]


def test_the_address_goes_on_and_stays() -> None:
    """A read in a transaction of its own goes on where the last ended; what is no register reads 0."""
    chip = nine_stages(lambda cin, t_ns: 1.0)
    assert read(chip, b"\x00\x80", 2, 0) == [0x0002, 0x1000]
    assert chip.read(4, 0) == b"\x00\x00" + (0x83 * 0x9E37 & 0xFFFF).to_bytes(2, "big")
    assert read(chip, b"\x00\x16", 3, 0) == [0, 0x1471, 0]
    assert read(chip, b"\x02\x8f", 2, 0) == [0, 0]
    write(chip, IDENTITY + b"\x12\x34", 0)
    assert read(chip, IDENTITY, 1, 0) == [0x1471]


def test_a_burst_that_begins_one_register_late() -> None:
    effects = Ad7147Effects(junk_sequences=0, shifted_burst_rel=1.0)
    chip = SimulatedAd7147(lambda *_: 1.0, None, effects=effects, shifts=np.random.default_rng(1))
    assert read(chip, b"\x00\x16", 2, 0) == [0x1471, 0]
    assert read(chip, IDENTITY, 1, 0) == [0x1471]


# ---------------------------------------------------------------- conversions


@pytest.mark.parametrize(
    ("word", "pf"),
    [
        (0x0000, 4.0),
        (0x0A00, 4.0 - 3.2),  # ten steps of the positive DAC
        (0x8A00, 4.0 + 3.2),  # at the negative input
        (0x000A, 4.0 + 3.2),  # ten steps of the negative DAC
        (0x0A8A, 4.0 - 6.4),  # both at the positive input
        (0x3FBF, -8.0),  # all of both: the end of the range
    ],
)
def test_the_offset_acts_at_the_input_that_its_swap_bit_says(word: int, pf: float) -> None:
    code = one_input(4.0, [connect(0, 0x0002, 0x1000, word)])
    assert pf_of(code) == pytest.approx(pf, abs=2e-4)


@pytest.mark.parametrize(
    ("configure", "code"),
    [
        ([connect(0, 0x0002, 0x1000)], 0xC000),
        ([connect(0, 0x0001, 0x2000)], 0x4000),  # at the negative input
        ([connect(0, 0x000A, 0x1000)], 0xFFFF),  # two inputs of 4 pF: the end of the range
        ([connect(0, 0x0009, 0x3000)], 0x8000),  # one against another
        ([connect(0, 0x0002, 0x0000)], 0x0000),  # a setup that does not fit
        ([connect(0, 0x0002, 0x1000), b"\x00\x00\x10\x00"], 0x8000),  # no excitation
        ([connect(0, 0x0002, 0x9000, 0x0A00)], 0xC000),  # the positive DAC disabled
    ],
)
def test_a_stage_converts_what_it_connects(configure: list[bytes], code: int) -> None:
    assert one_input(4.0, configure) == code


def test_gain_step_of_the_offset_and_temperature_are_a_chips_own() -> None:
    configure = [connect(0, 0x0002, 0x1000, 0x0A00)]
    code = one_input(6.0, configure, gain_rel=-0.25, offset_rel=0.1, temperature_change_k=lambda t_ns: -50.0)
    assert pf_of(code) == pytest.approx((6.0 - 3.52) * 0.75 * 0.99, abs=2e-4)


def test_a_stage_says_what_it_ties_other_inputs_to() -> None:
    """An input of 3 pF reads 0.1 pF more of each other one that floats."""
    for idle, pf in ((0, 4.2), (3, 3.0)):
        chip = SimulatedAd7147(
            lambda cin, connections, *_: 3.0 + 0.1 * connections.count(0), None, effects=CLEAN
        )
        write(chip, input_to_stage(7, 0, idle), 0)
        assert pf_of(read(chip, RESULTS, 1, 4_000_000)[0]) == pytest.approx(pf, abs=2e-4)


@pytest.mark.parametrize(("decimation", "rms_ff"), [(2, 3.0), (1, 3.0 / 2**0.5), (0, 1.5)])
def test_noise_falls_with_the_decimation(decimation: int, rms_ff: float) -> None:
    effects = Ad7147Effects(junk_sequences=0, noise_ff=3.0)
    chip = SimulatedAd7147(lambda *_: 1.0, np.random.default_rng(1), effects=effects)
    write(chip, bytes((0, 0, decimation, 0)), 0)
    write(chip, connect(0, 0x0002, 0x1000), 0)
    codes = [read(chip, RESULTS, 1, n * 4_000_000)[0] for n in range(1, 2000)]
    assert np.std(codes) * FF_PER_CODE == pytest.approx(rms_ff, rel=0.1)


# ---------------------------------------------------------------- kinds of chip


@pytest.mark.parametrize("junk", [0, 1, 2])
def test_the_first_sequences_after_a_configuration_are_junk(junk: int) -> None:
    """After a restart, after another connection, and after power-up; each off by hundreds of femtofarad."""
    chip = nine_stages(lambda cin, t_ns: 4.0, Ad7147Effects(junk_sequences=junk, noise_ff=0.0))
    for t_ns in (ORIGIN_NS, ORIGIN_NS + 100_000_000):
        write(chip, RESTART, t_ns)
        after = [read(chip, RESULTS, 9, t_ns + n * 9 * STAGE_NS) for n in (1, 2, 3)]
        assert [codes == [0xC000] * 9 for codes in after] == [junk < 1, junk < 2, True]
        assert all(abs(code - 0xC000) > 1000 for codes in after[:junk] for code in codes)
    write(chip, input_to_stage(3, 3), ORIGIN_NS + 200_000_000)
    assert (read(chip, RESULTS, 9, ORIGIN_NS + 200_000_000 + 9 * STAGE_NS)[3] == 0xC000) == (junk < 1)


def test_a_status_bit_may_need_its_enable() -> None:
    chip = nine_stages(lambda cin, t_ns: 4.0, Ad7147Effects(junk_sequences=0, complete_needs_enable=True))
    assert read(chip, STATUS, 1, ORIGIN_NS + 20 * STAGE_NS) == [0]
    write(chip, b"\x00\x07\x01\x02", ORIGIN_NS + 20 * STAGE_NS)
    assert read(chip, STATUS, 1, ORIGIN_NS + 40 * STAGE_NS) == [0x102]


def test_a_calibration_engine_may_move_results_where_it_is_on() -> None:
    """Of stage 0 alone, it brings the result to the middle once in 64 sequences."""
    effects = Ad7147Effects(junk_sequences=0, noise_ff=0.0, calibration_moves_results=True)
    chip = nine_stages(lambda cin, t_ns: 4.0, effects)
    assert read(chip, RESULTS, 2, ORIGIN_NS + 1000 * STAGE_NS) == [0xC000, 0xC000]
    write(chip, b"\x00\x01\x00\x01", ORIGIN_NS + 1000 * STAGE_NS)
    codes = {tuple(read(chip, RESULTS, 2, ORIGIN_NS + n * 9 * STAGE_NS)) for n in range(120, 300)}
    assert codes == {(0xC000, 0xC000), (0x8000, 0xC000)}


# ---------------------------------------------------------------- faults


@pytest.mark.parametrize("how", ["dip", "bit"])
def test_a_reset_loses_configuration_and_results(how: str) -> None:
    """It converts one stage at decimation 256; what hangs no more."""
    chip = nine_stages(lambda cin, t_ns: 4.0)
    reset_ns = ORIGIN_NS + 100 * STAGE_NS
    chip.hangs_ns.append(reset_ns - 50 * STAGE_NS)
    assert read(chip, STATUS, 1, reset_ns - 20 * STAGE_NS) == [0x1FF]
    write(chip, RESTART, reset_ns - 10 * STAGE_NS)
    assert read(chip, STATUS, 1, reset_ns - 1000) == [0]
    if how == "dip":
        chip.brown_outs_ns.append(reset_ns)
        assert chip.acknowledges(reset_ns)
    else:
        write(chip, b"\x00\x00\x04\x00", reset_ns)
    assert read(chip, b"\x00\x00", 5, reset_ns) == [0, 0, 0x0FF0, 0x0164, 0xFFFF]
    assert read(chip, STATUS, 10, reset_ns + 1000) == [0] * 10
    assert read(chip, STATUS, 1, reset_ns + 3_072_000) == [1]


def test_a_stuck_chip_keeps_results_and_sets_no_bit() -> None:
    chip = nine_stages(lambda cin, t_ns: t_ns * 1e-9)
    stuck_ns, until_ns = ORIGIN_NS + 90 * STAGE_NS, ORIGIN_NS + 180 * STAGE_NS
    chip.stuck_ns.append((stuck_ns + 1, until_ns))
    before = read(chip, STATUS, 10, stuck_ns)
    assert before[0] == 0x1FF
    assert read(chip, STATUS, 10, until_ns - 500_000) == [0, *before[1:]]
    assert read(chip, STATUS, 2, until_ns) == [0x100, before[1]]
    assert read(chip, STATUS, 1, until_ns + 9 * STAGE_NS) == [0x1FF]


class Leg:
    """A leg with board `ad7147` at the address 0x2E on a bus without a mux; element k has 3 + k / 8 pF."""

    def __init__(self, *faults: ChipFault, effects: Ad7147Effects = CLEAN) -> None:
        designed = Specimen(FootResponse.load(released_path("response.npz")))
        foot = WiredFoot(lambda t_ns: [3.0 + k / 8 for k in range(9)], (), designed)
        own = leg_electronics("ad7147", foot, Effects(ad7147=effects), (1, 2), address=0x2E)
        chips = inject_chip_faults(*own, faults, np.random.default_rng(1))
        self.clock = VirtualClock()
        self.bus = SimulatedBus(self.clock, 400_000, 0, None, {0: chips})
        self.bus.transfer(Transaction(0x2E, b"\x00\x00\x02\x90"))
        for stage, cin in enumerate((*range(9), 12)):
            self.bus.transfer(Transaction(0x2E, input_to_stage(cin, stage)))

    def read(self, address: bytes, n: int, t_s: float) -> list[int]:
        """Return `n` registers from an address on, read at a time [s]."""
        self.clock.sleep_until_ns(round(t_s * 1e9))
        answer = self.bus.transfer(Transaction(0x2E, address, 2 * n))
        return [int.from_bytes(answer[k : k + 2], "big") for k in range(0, 2 * n, 2)]


def test_a_leg_has_its_elements_at_nine_inputs_and_a_reference_at_the_last() -> None:
    """The reference, of 4.7 pF within 1 %, tells the gain, which is common to all."""
    leg = Leg(effects=Ad7147Effects(junk_sequences=0, gain_rel=0.25))
    *elements_pf, reference_pf = map(pf_of, leg.read(RESULTS, 10, 0.1))
    gain = reference_pf / 4.7
    assert abs(gain - 1) > 0.02
    assert np.array(elements_pf) / gain == pytest.approx(3.0 + np.arange(9) / 8, rel=0.012)


@pytest.mark.parametrize(
    "fault",
    [
        scene_faults.Absent(at_s=0.2, until_s=0.3, leg="lf"),
        scene_faults.NackAtRandom(at_s=0.2, until_s=0.3, leg="lf", rate_rel=1.0),
    ],
)
def test_a_leg_that_does_not_acknowledge_keeps_its_configuration(fault: ChipFault) -> None:
    leg = Leg(fault)
    with pytest.raises(NackError):
        leg.read(IDENTITY, 1, 0.25)
    assert leg.read(b"\x00\x00", 1, 0.3) == [0x0290]


def test_a_dip_another_chip_and_flipped_bits_show_in_what_is_read() -> None:
    dip = Leg(scene_faults.BrownOut(at_s=0.2, leg="lf"))
    assert [dip.read(b"\x00\x00", 1, t_s) for t_s in (0.1, 0.25)] == [[0x0290], [0]]
    other = Leg(scene_faults.WrongChip(at_s=0.2, until_s=0.3, leg="lf"))
    assert [other.read(IDENTITY, 1, t_s) for t_s in (0.1, 0.25, 0.3)] == [[0x1471], [0x0102], [0x1471]]
    noisy = Leg(scene_faults.CorruptReads(at_s=0.2, leg="lf", rate_rel=1.0))
    assert (noisy.read(IDENTITY, 1, 0.25)[0] ^ 0x1471).bit_count() == 1


@pytest.mark.parametrize(
    ("fault", "status_after"),
    [
        (scene_faults.StuckConverter(at_s=0.2, until_s=0.3, leg="lf"), 0x3FF),
        (scene_faults.HungConverter(at_s=0.2, leg="lf"), 0),
    ],
)
def test_a_leg_whose_sequencer_stops(fault: ChipFault, status_after: int) -> None:
    leg = Leg(fault)
    assert leg.read(STATUS, 1, 0.2) == [0x3FF]
    assert leg.read(STATUS, 1, 0.25) == [0]
    assert leg.read(STATUS, 1, 0.35) == [status_after]
