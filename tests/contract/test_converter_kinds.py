"""The FDC1004 as its data sheet allows it to be: whatever clears DONE, no reading is OK and not of its conversion."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_interface.chips.fdc1004 import Fdc1004Register
from footsense.acquisition.boards.fdc1004 import read_register
from footsense.frames import CapFrame, Reading
from footsense.ports import I2cBus, Transaction
from footsense.sim.chips.fdc1004 import SimulatedFdc1004
from footsense.sim.scene import Effects
from footsense.validation.converter_kinds import KINDS as KINDS_OF_TABLE
from footsense.validation.converter_kinds import converter_kind_figures
from tests.contract.boards import CONVERSION_NS, Robot, distinct

KINDS = [
    Effects(trigger_clears_done=trigger, done_needs_both_reads=both, keeps_old_result=keeps)
    for trigger, both, keeps in itertools.product((False, True), repeat=3)
]
READ_CONF = read_register(Fdc1004Register.FDC_CONF)
LOWER_REGISTERS = [read_register(register) for register in (1, 3, 5)]


def name_of(kind: Effects) -> str:
    names = ("trigger_clears_done", "done_needs_both_reads", "keeps_old_result")
    return "+".join(name for name in names if getattr(kind, name)) or "upper_clears_done"


#: Change of every capacitance [pF/ns]: a reading of the scan before is off by 40 codes of the upper register.
SLOPE_PF_PER_NS = 2**-30
#: A code, and half of what the measured time of a conversion is off.
TOLERANCE_PF = 2**-11 + 0.011 * CONVERSION_NS * SLOPE_PF_PER_NS


def moving(element: int, t_ns: int) -> float:
    return 4.0 + 0.125 * element + t_ns * SLOPE_PF_PER_NS


def n_ok(frame: CapFrame) -> int:
    """Make sure that every reading that is OK is of its element at the time of its stamp; return how many are."""
    ok = frame.reading == Reading.OK
    true_pf = 4.0 + 0.125 * np.arange(9) + frame.t_ns * SLOPE_PF_PER_NS
    assert np.abs(frame.capacitance_pf - true_pf)[ok].max(initial=0.0) <= TOLERANCE_PF
    assert np.isnan(frame.capacitance_pf[~ok]).all()
    return int(ok.sum())


fault_times = st.tuples(st.integers(0, 5), st.floats(0.0, 0.2), st.floats(0.0, 0.15) | st.none())
cases = given(
    kind=st.sampled_from(KINDS),
    clock_error_rel=st.floats(0.0, 0.12),
    faults=st.lists(fault_times, max_size=4),
    host_cost_us=st.sampled_from((0, 40, 100, 250)),
    rate_sps=st.sampled_from((400, 400, 100)),
)


def check_a_disturbed_scan(
    kind: Effects,
    clock_error_rel: float,
    faults: list[tuple[int, float, float | None]],
    host_cost_us: int,
    rate_sps: int,
) -> None:
    """Scan while converters stop for a time, or until they are reset; in the end all readings are there again."""
    robot = Robot(
        moving,
        clock_error_rel=clock_error_rel,
        host_cost_ns=host_cost_us * 1000,
        rate_sps=rate_sps,
        effects=kind,
    )
    start_ns = robot.clock.now_ns()
    for leg, at_s, lasts_s in faults:
        at_ns = start_ns + round(at_s * 1e9)
        if lasts_s is None:
            robot.converters[leg].hangs_ns.append(at_ns)
        else:
            robot.converters[leg].stuck_ns.append((at_ns, at_ns + lasts_s * 1e9))
    # Three scans until a leg is left out, its pause, and a scan for each of four legs until they are back and timed.
    until_ns = start_ns + (1_100_000_000 if rate_sps > 100 else 2_200_000_000)
    while robot.clock.now_ns() < until_ns:
        n = n_ok(robot.convert())
    assert n == 54


@cases
@settings(max_examples=8)
def test_no_reading_is_ok_and_not_of_its_conversion(**case: object) -> None:
    """Of every kind of chip, at any clock, with chips that stop at any time; and all come back."""
    check_a_disturbed_scan(**case)  # type: ignore[arg-type]


@pytest.mark.slow
@cases
@settings(max_examples=150)
def test_no_reading_is_ok_and_not_of_its_conversion_in_many_cases(**case: object) -> None:
    """The same, searched for longer."""
    check_a_disturbed_scan(**case)  # type: ignore[arg-type]


@pytest.mark.parametrize("kind", KINDS, ids=name_of)
def test_a_hang_that_only_a_reset_cures_is_noticed_and_cured(kind: Effects) -> None:
    """A reading that is not OK within 25 ms, all OK again within 0.5 s, and the others never without."""
    robot = Robot(moving, effects=kind)
    robot.read(2)
    hung_ns = robot.clock.now_ns()
    robot.converters[4].hangs_ns.append(hung_ns)
    noticed_ns = math.inf
    while True:
        frame = robot.convert()
        n_ok(frame)
        others = np.delete(frame.reading, 4, axis=0)
        assert (others == Reading.OK).all()
        if (frame.reading[4] != Reading.OK).any():
            noticed_ns = min(noticed_ns, robot.clock.now_ns() - hung_ns)
        elif noticed_ns < math.inf:
            break
        assert robot.clock.now_ns() - hung_ns < 500_000_000
    assert noticed_ns <= 25_000_000


@pytest.mark.parametrize("kind", KINDS, ids=name_of)
def test_the_driver_finds_out_which_registers_it_has_to_read(kind: Effects) -> None:
    """The lower register is left out only where the upper one alone clears DONE; at 100 S/s it is always read."""
    for rate_sps in (400, 100):
        robot = Robot(distinct, clock_error_rel=0.07, rate_sps=rate_sps, effects=kind)
        assert {leg.timing.reads_whole_result for leg in robot.buses[0].legs} == {kind.done_needs_both_reads}
        n_lower = 0

        def count(transaction: Transaction, n: int) -> None:
            nonlocal n_lower
            n_lower += transaction in LOWER_REGISTERS

        robot.read(2)
        robot.saboteurs[0].arm(count)
        assert (robot.read().reading == Reading.OK).all()
        assert (n_lower == 54) == (kind.done_needs_both_reads or rate_sps == 100)
        assert n_lower in {0, 54}


def test_a_leg_that_was_away_is_read_whole() -> None:
    """Another chip may be in its place, and nothing shows which kind it is until it is timed."""
    robot = Robot(moving)
    robot.read(2)
    for chip in robot.chips(4):
        chip.absent_ns = [(robot.clock.now_ns(), robot.clock.now_ns() + 100_000_000)]
    robot.read(4)
    other = robot.converters[4]
    assert isinstance(other, SimulatedFdc1004)
    other.done_needs_both_reads = other.keeps_old_result = True
    assert (robot.read(30).reading == Reading.OK).all()
    other.stuck_ns.append((robot.clock.now_ns(), math.inf))
    for _ in range(9 * 20):
        n_ok(robot.convert())
    assert [leg.timing.reads_whole_result for leg in robot.buses[0].legs] == [False] * 4 + [True, False]


class NoisyAnswers:
    """A bus on which one answer of a converter about DONE has a flipped bit."""

    def __init__(self, bus: I2cBus, n_right: int, bit: int) -> None:
        self.transfer_right = bus.transfer
        self.n_right, self.bit = n_right, bit

    def transfer(self, sent: Transaction) -> bytes:
        answer = self.transfer_right(sent)
        if sent != READ_CONF:
            return answer
        self.n_right -= 1
        return (
            answer
            if self.n_right != -1
            else (int.from_bytes(answer, "big") ^ 1 << self.bit).to_bytes(2, "big")
        )


@pytest.mark.parametrize("bit", [0, 3, 5, 11, 15])
def test_a_flipped_bit_leaves_out_no_register(bit: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whichever answer about DONE has it while a chip is timed: of a chip that needs both reads both are read."""
    for n_right in range(7):
        robot = Robot(distinct, effects=Effects(done_needs_both_reads=True))
        noisy = NoisyAnswers(robot.saboteurs[0], n_right, bit)
        monkeypatch.setattr(robot.saboteurs[0], "transfer", noisy.transfer)
        robot.scanner.start()
        assert noisy.n_right < 0
        assert all(leg.timing.reads_whole_result for leg in robot.buses[0].legs)


@pytest.mark.parametrize(
    ("n_buses", "host_cost_us", "cost_rel"),
    [(1, 0, 0.0), (1, 40, 0.073), (1, 100, 0.453), (2, 0, 0.0), (2, 40, 0.0), (2, 100, 0.002)],
)
def test_reading_both_registers_costs_what_the_bus_takes(
    n_buses: int, host_cost_us: int, cost_rel: float
) -> None:
    """Nothing where conversions are the limit, and all of it where the read-out is; the scanner plans with it."""
    robots = [
        Robot(
            distinct,
            n_buses=n_buses,
            host_cost_ns=host_cost_us * 1000,
            effects=Effects(done_needs_both_reads=needs_both),
        )
        for needs_both in (False, True)
    ]
    upper_ns, both_ns = (robot.period_ns(18) for robot in robots)
    assert both_ns / upper_ns - 1 == pytest.approx(cost_rel, abs=0.003)
    timing = robots[1].buses[0].bus_timing
    assert timing is not None
    assert (
        timing.lower_bounds.scan_period_bound_ns < both_ns < 1.03 * timing.lower_bounds.scan_period_bound_ns
    )


@pytest.mark.parametrize("kind", ["upper register | 0x7FFFFF", "both registers, next trigger | old result"])
def test_the_table_of_kinds_has_no_wrong_reading(kind: str) -> None:
    """On feet under a growing load, with a clock 7 % slow; one leg hangs for a third of a second."""
    figures = converter_kind_figures(KINDS_OF_TABLE[kind], 0.07)
    assert figures.n_wrong == 0
    assert 0.95 < figures.ok_rel < 0.97
    assert 26.0 < figures.scan_ms < 28.0
