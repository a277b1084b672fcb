"""Some legs read their columns, the others go on with their elements: every number is one or the other, never a mix."""

from typing import ClassVar

import numpy as np
import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule
from numpy.typing import NDArray

from footsense.acquisition.ganged_scanner import CAPDAC, GangedBusScanner
from footsense.acquisition.robot_scanner import RobotScanner
from footsense.acquisition.scan_plan import scan_plan
from footsense.frames import CapFrame, Reading
from footsense.sim.bus.i2c_bus import SimulatedBus, SimulatedMux
from footsense.sim.chips.fdc1004 import SimulatedFdc1004
from footsense.sim.chips.line_switch import SimulatedLineSwitch
from footsense.sim.clock import VirtualClock
from tests.contract.boards import DISTINCT_PF, column_through, distinct

N_LEGS = 3
#: Error of the CAPDAC's steps, and what it makes of a sum [pF].
STEPS_REL = 0.01
CAPDAC_ERROR_PF = CAPDAC * 3.125 * STEPS_REL
COLUMNS_PF = DISTINCT_PF.reshape(3, 3).sum(axis=0)[np.arange(9) % 3] - CAPDAC_ERROR_PF
#: One code of the upper result register [pF].
CODE_PF = 2**-11


class Robot:
    """Three legs with the same nine capacitances."""

    def __init__(self, host_cost_ns: int = 0) -> None:
        self.clock = VirtualClock()
        self.converters: list[SimulatedFdc1004] = []
        self.switches: list[SimulatedLineSwitch] = []
        legs = {}
        for channel in range(N_LEGS):
            switch = SimulatedLineSwitch()
            chip = SimulatedFdc1004(column_through(switch, distinct), None, capdac_error_rel=STEPS_REL)
            self.converters.append(chip)
            self.switches.append(switch)
            legs[channel] = (chip, switch)
        bus = SimulatedBus(self.clock, 400_000, host_cost_ns, SimulatedMux(0x71), legs)
        self.bus = GangedBusScanner(
            bus, self.clock, {f"leg{n}": n for n in range(N_LEGS)}, 0x71, scan_plan("lo_shu", 400)
        )
        self.scanner = RobotScanner([self.bus], element_wise=True)
        self.scanner.start()
        self.frame = self.read()

    def read(self, n: int = 1) -> CapFrame:
        for _ in range(n):
            self.frame = self.scanner.read()
        return self.frame

    def gang(self, *legs: int) -> None:
        self.scanner.gang(np.isin(np.arange(N_LEGS), legs))


def is_right(frame: CapFrame) -> NDArray[np.bool_]:
    """Tell which entries are what their reading says."""
    wanted_pf = np.where(frame.reading == Reading.GANGED, COLUMNS_PF, DISTINCT_PF)
    return np.abs(frame.capacitance_pf - wanted_pf) < CODE_PF


def test_a_ganged_leg_reads_its_columns_while_the_others_read_their_elements() -> None:
    """After a scan and the one conversion that the change costs, all nine entries are sums, CAPDAC error included."""
    robot = Robot()
    robot.gang(1)
    frame = robot.read(12)
    ganged = np.zeros((N_LEGS, 9), bool)
    ganged[1] = True
    np.testing.assert_array_equal(frame.reading == Reading.GANGED, ganged)
    assert (frame.reading[~ganged] == Reading.OK).all()
    assert is_right(frame).all()


def test_a_change_costs_the_leg_one_conversion_and_the_others_none() -> None:
    """The entry of the lost conversion stays what and when it was."""
    robot = Robot()
    robot.read()
    before = robot.frame
    robot.gang(1)
    read = [robot.read().t_ns.max(axis=1) for _ in range(4)]
    new = np.diff([before.t_ns.max(axis=1), *read], axis=0) > 0
    assert new[:, [0, 2]].all()
    assert new[:, 1].tolist() == [True, False, True, True]
    assert (robot.frame.reading[1] == Reading.GANGED).sum() == 2
    assert is_right(robot.frame).all()


def test_legs_change_to_and_fro_in_the_same_gap() -> None:
    """One leg is ganged while another one is freed; a scan later all is as told."""
    robot = Robot(host_cost_ns=40_000)
    robot.gang(0, 1)
    robot.read(12)
    robot.gang(1, 2)
    frame = robot.read(12)
    assert (frame.reading == Reading.GANGED).all(axis=1).tolist() == [False, True, True]
    assert (frame.reading[0] == Reading.OK).all()
    assert is_right(frame).all()


@pytest.mark.parametrize("position", range(9))
def test_all_legs_at_once(position: int) -> None:
    """Nobody is left to convert during the change, wherever in the scan it comes; it costs few conversions."""
    robot = Robot()
    robot.read(position)
    robot.gang(0, 1, 2)
    assert (robot.read(13).reading == Reading.GANGED).all()
    robot.gang()
    frame = robot.read(12)
    assert (frame.reading == Reading.OK).all()
    assert is_right(frame).all()


@pytest.mark.parametrize("chip", ["converter", "switch"])
def test_a_ganged_leg_that_loses_its_settings_is_found_and_set_up_anew(chip: str) -> None:
    """A dip of the supply resets a chip: no number is taken from it, and the leg is full and right again."""
    robot = Robot()
    robot.gang(1)
    robot.read(12)
    part = robot.converters[1] if chip == "converter" else robot.switches[1]
    part.brown_outs_ns.append(robot.clock.now_ns() + 1)
    seen = [robot.read() for _ in range(20)]
    assert any(not np.isin(frame.reading[1], (Reading.OK, Reading.GANGED)).all() for frame in seen)
    robot.gang()
    frame = robot.read(24)
    assert (frame.reading == Reading.OK).all()
    assert is_right(frame).all()


class AnyChange(RuleBasedStateMachine):
    """Legs are told to change at any time, vanish and come back: no entry is ever what its reading does not say."""

    ends_ns: ClassVar[int] = 2**62

    def __init__(self) -> None:
        super().__init__()
        self.robot = Robot(host_cost_ns=20_000)

    @rule(legs=st.sets(st.integers(0, N_LEGS - 1)), n=st.integers(0, 12))
    def gang(self, legs: set[int], n: int) -> None:
        self.robot.gang(*legs)
        self.robot.read(n)

    @rule(leg=st.integers(0, N_LEGS - 1), n=st.integers(0, 40))
    @precondition(lambda self: not any(chip.absent_ns for chip in self.robot.converters))
    def vanish(self, leg: int, n: int) -> None:
        since_ns = self.robot.clock.now_ns()
        self.robot.converters[leg].absent_ns.append((since_ns, self.ends_ns))
        self.robot.switches[leg].absent_ns.append((since_ns, self.ends_ns))
        self.robot.read(n)

    @rule()
    def come_back(self) -> None:
        for leg in range(N_LEGS):
            self.robot.converters[leg].absent_ns.clear()
            self.robot.switches[leg].absent_ns.clear()

    @rule(n=st.integers(1, 200))
    def hold_up(self, n: int) -> None:
        self.robot.clock.sleep_until_ns(self.robot.clock.now_ns() + n * 1_000_000)
        self.robot.read()

    @invariant()
    def every_number_is_what_its_reading_says(self) -> None:
        frame = self.robot.frame
        known = np.isin(frame.reading, (Reading.OK, Reading.GANGED))
        assert is_right(frame)[known].all()
        assert np.isnan(frame.capacitance_pf[~known]).all()

    def teardown(self) -> None:
        self.come_back()
        self.robot.gang()
        self.robot.read(2000)
        assert (self.robot.frame.reading == Reading.OK).all()


AnyChange.TestCase.settings = settings(max_examples=8, stateful_step_count=12, deadline=None)
TestAnyChange = AnyChange.TestCase
