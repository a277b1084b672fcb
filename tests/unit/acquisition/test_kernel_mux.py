"""A mux that the kernel switches: the same readings, at the pace that one adapter for each leg allows."""

import math
from collections import Counter
from collections.abc import Mapping
from types import MappingProxyType

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_interface import schedule
from firmware_interface.schedule import scan_lower_bounds
from footsense.acquisition.bus_scanner import BusScanner
from footsense.acquisition.robot_scanner import RobotScanner
from footsense.acquisition.scan_plan import scan_plan
from footsense.acquisition.transports import KernelMux
from footsense.errors import I2cError, I2cTimeoutError, NackError
from footsense.frames import ELEMENTS, CapFrame, Reading
from footsense.ports import Transaction
from footsense.sim.bus.i2c_bus import SimulatedBus, SimulatedKernelMuxChannel
from footsense.sim.chips.chip import SimulatedMux
from footsense.sim.clock import VirtualClock
from tests.contract.boards import AD7746, DISTINCT_PF, FDC1004, Board, Capacitance, leg_chips

both = pytest.mark.parametrize("board", [FDC1004, AD7746], ids=lambda board: board.name)


class FailingLeg(SimulatedKernelMuxChannel):
    """A leg whose transactions fail as they are told to.

    Attributes:
        failing: Number of the transaction that fails, and how.
        counts: Number of each transaction.
    """

    failing: Mapping[int, I2cError] = MappingProxyType({})
    counts: Counter[Transaction]
    n = 0

    def transfer(self, transaction: Transaction) -> bytes:
        self.n += 1
        self.counts[transaction] += 1
        if error := self.failing.get(self.n):
            self._clock.advance_ns(20_000_000 if isinstance(error, I2cTimeoutError) else 27_500)
            raise error
        return super().transfer(transaction)


class Robot:
    """Six legs behind a kernel mux."""

    def __init__(
        self,
        capacitance_pf: Capacitance,
        host_cost_ns: int = 0,
        order: str = "lo_shu",
        board: Board = FDC1004,
    ) -> None:
        self.clock = VirtualClock()
        mux = SimulatedMux(0x71)
        legs = [leg_chips(board, capacitance_pf, channel) for channel in range(6)]
        chips = {channel: (converter, *switches) for channel, (converter, switches) in enumerate(legs)}
        upstream = SimulatedBus(self.clock, 400_000, 0, mux, chips)
        self.switches = [switches for _, switches in legs]
        self.legs = {f"{n}": FailingLeg(upstream, self.clock, mux, n, host_cost_ns) for n in range(6)}
        for leg in self.legs.values():
            leg.counts = Counter()
        channels = {name: channel for channel, name in enumerate(self.legs)}
        plan = scan_plan(order, board.rates_sps[0], board.name)
        self.bus = BusScanner(KernelMux(tuple(self.legs.values())), self.clock, channels, plan)
        self.scanner = RobotScanner([self.bus])
        self.scanner.start()

    def read(self, n: int = 1) -> CapFrame:
        """Return the frame that completes a scan, the last of `n` scans."""
        for _ in range(n):
            while (frame := self.scanner.read()).sequence % ELEMENTS:
                pass
        return frame


def distinct(element: int, t_ns: int) -> float:
    return float(DISTINCT_PF[element])


@both
@pytest.mark.parametrize("order", ["lo_shu", "raster"])
def test_every_element_lands_at_its_place(board: Board, order: str) -> None:
    """Distinct capacitances come out where they belong, on every leg."""
    frame = Robot(distinct, order=order, board=board).read(10)
    assert (frame.reading == Reading.OK).all()
    np.testing.assert_allclose(frame.capacitance_pf, np.tile(DISTINCT_PF, (6, 1)), atol=2**-11)


@both
@pytest.mark.parametrize("host_cost_us", [0, 40, 100])
def test_the_period_is_near_the_best(board: Board, host_cost_us: int) -> None:
    """Row by row, within 3 % of what wires and host allow; the timing that is measured at start says so too."""
    robot = Robot(distinct, host_cost_us * 1000, "raster", board)
    robot.read(2)
    start_ns = robot.clock.now_ns()
    robot.read(18)
    limits = scan_lower_bounds(
        n_legs=6,
        conversion_ns=board.conversion_ns,
        bus_hz=400_000,
        host_cost_ns=host_cost_us * 1000,
        kernel_mux=True,
        traffic=schedule.FDC1004_TRAFFIC if board is FDC1004 else schedule.AD7746_TRAFFIC,
    )
    assert (robot.clock.now_ns() - start_ns) / 18 < 1.03 * limits.scan_period_bound_ns
    assert robot.bus.bus_timing is not None
    assert math.isclose(
        robot.bus.bus_timing.lower_bounds.scan_period_bound_ns, limits.scan_period_bound_ns, rel_tol=1e-3
    )


def test_each_leg_has_stamps_of_its_own() -> None:
    """A ramp reads as what it was at the stamp."""
    frame = Robot(lambda element, t_ns: 5.0 + t_ns * 1e-9).read(5)
    np.testing.assert_allclose(frame.capacitance_pf, 5.0 + frame.t_ns * 1e-9, atol=2**-11 + 1e-6)


def test_an_element_over_the_range_has_been_read() -> None:
    """It has a stamp, as behind any other mux: a leg with a shorted element goes on with the others."""
    frame = Robot(lambda element, t_ns: 20.0 if element == 4 else 5.0).read(3)
    assert (frame.reading[:, 4] == Reading.OVER_RANGE).all()
    assert (frame.t_ns > 0).all()


def test_an_absent_leg_costs_only_itself_and_comes_back() -> None:
    """The others read on; after its back-off the leg is there again."""
    robot = Robot(distinct)
    robot.legs["2"].failing = {
        n: NackError("gone") for n in range(robot.legs["2"].n + 1, robot.legs["2"].n + 200)
    }
    frame = robot.read(10)
    assert (frame.reading[2] == Reading.NO_ANSWER).all()
    assert (np.delete(frame.reading, 2, axis=0) == Reading.OK).all()
    robot.legs["2"].failing = {}
    frame = robot.read(400)
    assert (frame.reading == Reading.OK).all()


def test_a_leg_that_holds_a_line_is_left_out_at_once() -> None:
    """The first timeout names the leg, whose adapter alone was in use; the others then wait for its rare tries only."""
    robot = Robot(distinct)
    robot.read(2)
    leg = robot.legs["2"]
    leg.failing = dict.fromkeys(range(leg.n, leg.n + 999), I2cTimeoutError("stuck"))
    frame = robot.read()
    n_timeouts = leg.n
    assert (frame.reading[2] == Reading.BUS_STUCK).all()
    assert (np.delete(frame.reading, 2, axis=0) == Reading.OK).all()
    robot.read(5)
    assert leg.n == n_timeouts


def test_temperatures_are_told_leg_by_leg() -> None:
    """From the first scan on; one that cannot be asked has none, and costs the others nothing."""
    robot = Robot(distinct, board=AD7746)
    robot.legs["2"].failing = {n: NackError("gone") for n in range(robot.legs["2"].n + 1, 999)}
    frame = robot.read()
    assert (np.isnan(robot.scanner.temperature_c()) == [False, False, True, False, False, False]).all()
    assert (np.delete(frame.reading, 2, axis=0) == Reading.OK).all()


@pytest.mark.parametrize("order", ["lo_shu", "raster"])
def test_lines_are_checked_of_one_leg_a_scan_and_settings_after_all_lines(order: str) -> None:
    """In 54 scans each leg's lines are read back after each of the nine steps, and its settings once."""
    robot = Robot(distinct, order=order)
    robot.read(2)
    for leg in robot.legs.values():
        leg.counts.clear()
    robot.read(54)
    lines, settings = Transaction(0x49, b"", 1), Transaction(0x50, b"\x09", 2)
    assert [(leg.counts[lines], leg.counts[settings]) for leg in robot.legs.values()] == [(9, 1)] * 6


def test_readings_since_the_last_check_are_taken_back() -> None:
    """A line switch that ignores its writes is noticed in the middle of a scan: all nine elements are discarded."""
    robot = Robot(distinct)
    robot.read(20)
    robot.switches[3][0].ignores_writes_ns = [(robot.clock.now_ns(), math.inf)]
    lost = [
        frame.reading[3] == Reading.MISCONFIGURED for frame in (robot.scanner.read() for _ in range(9 * 12))
    ]
    assert next(elements for elements in lost if elements.any()).all()


def test_conversions_are_discarded_after_a_delay_of_the_loop_and_not_before() -> None:
    """A delay of one and a half steps is none yet: legs are served one after the other, and wait for up to a step."""
    robot = Robot(distinct, host_cost_ns=40_000)
    robot.read(2)
    for delay_ns, missed in ((5_000_000, 0), (200_000_000, 1)):
        robot.clock.advance_ns(delay_ns)
        frame = robot.read()
        assert robot.scanner.n_late_discards == missed
        assert (frame.reading == Reading.OK).all()


@pytest.mark.parametrize("error", [NackError("gone"), I2cTimeoutError("stuck")])
def test_without_a_leg_in_the_scan_frames_keep_their_pace(error: I2cError) -> None:
    """No leg answers: a scan still takes its conversions' time, and time passes while a line is stuck."""
    robot = Robot(distinct)
    for leg in robot.legs.values():
        leg.failing = dict.fromkeys(range(leg.n, leg.n + 10_000), error)
    robot.read(20)
    start_ns = robot.clock.now_ns()
    frame = robot.read(20)
    assert (frame.reading != Reading.OK).all()
    assert robot.clock.now_ns() - start_ns >= 20 * 9 * FDC1004.conversion_ns


def test_the_bus_is_measured_at_the_next_leg_if_the_first_one_is_missing() -> None:
    """No read of the first leg is acknowledged; the scan starts with the limits all the same."""
    robot = Robot(distinct)
    leg = robot.legs["0"]
    before = robot.bus.bus_timing
    leg.failing = dict.fromkeys(range(leg.n, leg.n + 1000), NackError("gone"))
    robot.bus.start()
    assert robot.bus.bus_timing is not before
    assert (robot.read(2).reading[1:] == Reading.OK).all()


@pytest.mark.parametrize("n_lost", [1, 3])
def test_acknowledges_that_are_lost_while_the_bus_is_measured_do_not_end_the_start(n_lost: int) -> None:
    """The bus is measured from the answers that came, and every leg is in the scan."""
    robot = Robot(distinct)
    leg = robot.legs["0"]
    for first in range(1, 40):
        leg.n, leg.failing = 0, {first + n: NackError("lost") for n in range(n_lost)}
        robot.bus.start()
        assert robot.bus.bus_timing is not None
        assert any((robot.read().reading == Reading.OK).all() for _ in range(100))


@both
@settings(max_examples=40, deadline=None)
@given(st.dictionaries(st.integers(40, 400), st.sampled_from(["nack", "timeout", "error"]), max_size=6))
def test_whatever_fails_a_reading_is_right_or_missing(board: Board, failing: dict[int, str]) -> None:
    """No failure of a transaction makes a wrong number, on its own leg or on another."""
    robot = Robot(distinct, board=board)
    errors = {"nack": NackError("no"), "timeout": I2cTimeoutError("stuck"), "error": I2cError("arbitration")}
    robot.legs["3"].failing = {n: errors[kind] for n, kind in failing.items()}
    for _ in range(60):
        frame = robot.scanner.read()
        expected = np.tile(DISTINCT_PF, (6, 1))
        right = np.abs(frame.capacitance_pf - expected) < 2**-11
        assert (right | np.isnan(frame.capacitance_pf)).all()
        assert ((frame.reading == Reading.OK) == np.isfinite(frame.capacitance_pf)).all()
