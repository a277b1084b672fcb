"""Conversion times that a scanner measures and keeps, over byte-level chips."""

import itertools
import math
from typing import TYPE_CHECKING

import numpy as np
import pytest

from firmware_interface.chips.fdc1004 import Fdc1004Register
from footsense.acquisition.boards.fdc1004 import read_register
from footsense.frames import Reading
from footsense.sim.chips.fdc1004 import SimulatedFdc1004
from tests.contract.boards import CONVERSION_NS, Robot, distinct

if TYPE_CHECKING:
    from footsense.ports import Transaction


@pytest.mark.parametrize(
    ("host_cost_us", "clock_error_rel"),
    [(0, -0.02), (0, 0.0), (0, 0.03), (0, 0.15), (0, 0.322), (100, 0.02), (100, 0.24)],
)
def test_chips_get_the_time_that_they_need_and_stamps_are_the_middle_of_it(
    host_cost_us: int, clock_error_rel: float
) -> None:
    """Measured at start, to two hundredths; a capacitance that counts time is read as the time of its stamp."""
    robot = Robot(
        lambda element, t_ns: 4.0 + t_ns * 2**-30,
        clock_error_rel=clock_error_rel,
        host_cost_ns=host_cost_us * 1000,
    )
    frame = robot.read(3)
    assert (frame.reading == Reading.OK).all()
    # A code, and half of what a clock in its tolerance is off.
    atol = 2**-11 + 0.01 * CONVERSION_NS * 2**-30
    np.testing.assert_allclose(frame.capacitance_pf - 4.0, frame.t_ns * 2**-30, atol=atol)
    for leg in robot.buses[0].legs:
        assert 1.02 * leg.timing.wait_factor < 1 + max(clock_error_rel, 0.0) + 0.025
    if not host_cost_us and not clock_error_rel:
        steps_ns = np.diff(np.sort(frame.t_ns[0]))
        assert (steps_ns > CONVERSION_NS).all()
        assert (steps_ns < 1.2 * CONVERSION_NS).all()


def test_a_chip_slower_than_any_gives_no_number() -> None:
    """A conversion that is still running is NOT_READY, never the value of the scan before."""
    frame = Robot(distinct, clock_error_rel=0.4).read(2)
    assert (frame.reading == Reading.NOT_READY).all()
    assert np.isnan(frame.capacitance_pf).all()


def test_a_chip_whose_clock_drifts_is_timed_again_when_it_is_late() -> None:
    """Within three seconds; within its tolerance every reading stays right."""
    robot = Robot(distinct)
    robot.read(2)
    for error_rel in (0.01, 0.019, 0.028, 0.1):
        robot.converters[3].clock_factor = 1 + error_rel
        until_ns = robot.clock.now_ns() + 3_000_000_000
        while robot.clock.now_ns() < until_ns:
            frame = robot.read()
            is_ok = frame.reading == Reading.OK
            assert is_ok[[0, 1, 2, 4, 5]].all()
            assert error_rel > 0.02 or (is_ok.all() and robot.is_right(frame).all())
        assert is_ok.all()
        assert robot.is_right(frame).all()
    assert robot.buses[0].legs[3].timing.wait_factor > 1.0
    assert robot.buses[0].n_late_discards == 0, "the loop was never late"


@pytest.mark.parametrize(("host_cost_us", "walk_s"), [(0, 30), pytest.param(40, 180, marks=pytest.mark.slow)])
def test_frames_of_a_healthy_robot_have_no_gaps(host_cost_us: int, walk_s: int) -> None:
    """In minutes no frame is later than one and a half conversions after the one before."""
    robot = Robot(distinct, host_cost_ns=host_cost_us * 1000)
    robot.read(2)
    times_ns = [robot.clock.now_ns()]
    while times_ns[-1] - times_ns[0] < walk_s * 1_000_000_000:
        assert (robot.scanner.read().reading == Reading.OK).all()
        times_ns.append(robot.clock.now_ns())
    assert np.diff(times_ns).max() < 1.5 * CONVERSION_NS
    assert robot.buses[0].n_late_discards == 0


@pytest.mark.parametrize(("host_cost_us", "limit_rel"), [(0, 1.07), (40, 1.07), (100, 1.07)])
@pytest.mark.parametrize("clock_error_rel", [0.0, 0.1])
def test_a_chip_that_forgets_is_asked_before_the_next_conversion_starts(
    host_cost_us: int, limit_rel: float, clock_error_rel: float
) -> None:
    """Every reading is right, and the scan takes a few percent longer: the question does not overlap a conversion."""
    periods_ns = []
    for forgets in (False, True):
        robot = Robot(distinct, host_cost_ns=host_cost_us * 1000, clock_error_rel=clock_error_rel)
        for chip in robot.converters:
            assert isinstance(chip, SimulatedFdc1004)
            chip.trigger_clears_done = forgets
        robot.scanner.start()
        periods_ns.append(robot.period_ns(18))
        frame = robot.read()
        assert (frame.reading == Reading.OK).all()
        assert robot.is_right(frame).all()
        assert {leg.timing.keeps_done_bit for leg in robot.buses[0].legs} == {not forgets}
    assert 1.0 < periods_ns[1] / periods_ns[0] < limit_rel


def test_of_chips_that_forget_one_that_hangs_costs_only_itself() -> None:
    """It is found out before the others are triggered again; they keep every element."""
    robot = Robot(distinct)
    for chip in robot.converters:
        assert isinstance(chip, SimulatedFdc1004)
        chip.trigger_clears_done = True
    robot.scanner.start()
    robot.read(2)
    robot.converters[4].stuck_ns = [(robot.clock.now_ns(), math.inf)]
    for _ in range(20):
        frame = robot.read()
        assert (frame.reading[4] == Reading.NOT_READY).all()
        assert robot.is_right(frame)[[0, 1, 2, 3, 5]].all()


def test_once_a_second_all_are_asked_before_the_next_lines_are_switched() -> None:
    """A chip that keeps its DONE bit and is late would convert the next element, which nothing else shows."""
    robot = Robot(distinct)
    robot.read(2)
    sent: list[Transaction] = []
    robot.saboteurs[0].arm(lambda transaction, n: sent.append(transaction))
    robot.clock.now_ns()
    until_ns = robot.clock.now_ns() + 3_500_000_000
    while robot.clock.now_ns() < until_ns:
        robot.read()
    switch = robot.switches[0]
    asks = read_register(Fdc1004Register.FDC_CONF)
    assert sum(a == asks and b.address == switch.address for a, b in itertools.pairwise(sent)) in {3, 4}


@pytest.mark.parametrize("after_us", [0, 1100, 5000, 12000])
@pytest.mark.parametrize("n_buses", [1, 2])
def test_a_mux_that_keeps_its_channels_gives_no_leg_the_readings_of_another(
    n_buses: int, after_us: int, caplog: pytest.LogCaptureFixture
) -> None:
    """Within two scans, or eight where the check takes time; the legs of the other bus have every reading."""
    robot = Robot(distinct, n_buses=n_buses)
    robot.make_legs_distinct()
    robot.read(2)
    now_ns = robot.clock.now_ns() + 1000 * after_us
    robot.muxes[-1].keeps_channels_ns = [(now_ns, now_ns + 1_000_000_000)]
    while robot.clock.now_ns() < now_ns + 60_000_000:
        robot.convert()
    other_bus = slice(0, 6 - 6 // n_buses)
    while robot.clock.now_ns() < now_ns + 900_000_000:
        frame = robot.convert()
        robot.assert_honest(frame)
        assert (frame.reading[other_bus] == Reading.OK).all()
    assert "its multiplexer acknowledges other channels than it connects" in caplog.text
    until_ns = robot.clock.now_ns() + 6_000_000_000
    while robot.clock.now_ns() < until_ns:
        frame = robot.read()
        robot.assert_honest(frame)
    assert (frame.reading == Reading.OK).all()
