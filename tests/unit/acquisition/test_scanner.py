"""The scanner's pace over byte-level chips, and what it does about buses; what it promises of legs: tests/contract."""

import math

import pytest

from firmware_interface import schedule
from firmware_interface.schedule import scan_limits
from footsense.acquisition.bus_scanner import BusScanner
from footsense.acquisition.scan_plan import ORDERS, scan_plan
from footsense.acquisition.transports import UpstreamBus
from footsense.errors import BusTimeoutError, HardwareError
from footsense.frames import Reading
from footsense.sim.bus.i2c_bus import SimulatedBus, SimulatedMux
from footsense.sim.clock import VirtualClock
from tests.contract.boards import AD7746, FDC1004, Robot, distinct

T_CONV_NS = FDC1004.conversion_ns


@pytest.mark.parametrize(
    ("host_cost_us", "n_buses", "limit"),
    [
        (0, 1, 1.08),
        (0, 2, 1.08),
        (40, 1, 1.10),
        (80, 1, 1.13),
        (100, 1, 1.17),
        (100, 2, 1.15),
        (150, 1, 1.49),
    ],
)
@pytest.mark.parametrize("order", ORDERS)
def test_the_scan_period_is_near_the_best(order: str, host_cost_us: int, n_buses: int, limit: float) -> None:
    """Within 3 % of the best that bus and chips allow, and so near to nine conversions; the scanner knows it too."""
    robot = Robot(distinct, n_buses=n_buses, host_cost_ns=host_cost_us * 1000, order=order)
    best = scan_limits(
        n_legs=6 // n_buses, conversion_ns=T_CONV_NS, rate_hz=400_000, host_cost_ns=host_cost_us * 1000
    )
    period_ns = robot.period_ns(18)  # in which every check has had its turn
    assert 9 * T_CONV_NS < period_ns < min(limit * 9 * T_CONV_NS, 1.03 * best.scan_ns)
    for bus in robot.buses:
        assert bus.timing is not None
        assert math.isclose(bus.timing.limits.scan_ns, best.scan_ns, rel_tol=1e-4)
        assert math.isclose(bus.timing.costs.host_cost_ns, host_cost_us * 1000, abs_tol=10)


@pytest.mark.parametrize(("order", "least_ff", "most_ff"), [("lo_shu", 0.0, 1.0), ("raster", 50.0, 500.0)])
def test_a_ramp_makes_no_tilt_in_lo_shu_order(order: str, least_ff: float, most_ff: float) -> None:
    """1 pF in 200 ms on all elements: the raster reads it as a tilt, the magic square does not."""
    frame = Robot(lambda element, t_ns: 5.0 + t_ns * 5e-9, order=order).read(3)
    grid = frame.capacitance_pf[0].reshape(3, 3)
    tilt_ff = 1e3 * max(abs((grid[0] - grid[2]).mean()), abs((grid[:, 0] - grid[:, 2]).mean()))
    assert least_ff <= tilt_ff <= most_ff


def test_a_bus_without_its_mux_is_an_error_at_start() -> None:
    """Nothing can work behind a mux that does not answer; the message says what to check."""
    clock = VirtualClock()
    bus = SimulatedBus(clock, 400_000, 0, SimulatedMux(0x72), {})
    scanner = BusScanner(UpstreamBus(bus, 0x71), clock, {"lf": 0}, scan_plan("lo_shu", 400))
    with pytest.raises(HardwareError, match=r"no answer from the mux \(TCA9548A\) at 0x71: check its power"):
        scanner.start()


def test_a_stuck_bus_costs_the_other_bus_a_few_timeouts_and_comes_back() -> None:
    """SDA held low on one of two buses: its legs are silent, and it is tried ever more rarely."""
    robot = Robot(distinct, n_buses=2)
    period_ns = robot.period_ns()
    robot.saboteurs[1].arm(lambda transaction, n: BusTimeoutError("a line is held low"))
    robot.read()
    before_ns = robot.clock.now_ns()
    slow = 0
    for _ in range(400):
        start_ns = robot.clock.now_ns()
        frame = robot.read()
        slow += robot.clock.now_ns() - start_ns > 1.05 * period_ns
        assert (frame.reading[:3] == Reading.OK).all()
        assert (frame.reading[3:] == Reading.BUS_STUCK).all()
    assert slow < 30
    assert robot.clock.now_ns() - before_ns < 1.1 * 400 * period_ns
    robot.saboteurs[1].arm(lambda transaction, n: None)
    assert (robot.read(400).reading == Reading.OK).all()


@pytest.mark.parametrize(("host_cost_us", "limit_ms"), [(0, 102.5), (40, 103.4), (100, 104.9)])
@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("rate_sps", [91, 9])
def test_the_scan_period_of_the_second_board_is_near_the_best(
    order: str, host_cost_us: int, limit_ms: float, rate_sps: int
) -> None:
    """Within 1 % of the best, whose limit is always the conversion; the scanner knows it too."""
    robot = Robot(distinct, AD7746, host_cost_ns=host_cost_us * 1000, order=order, rate_sps=rate_sps)
    plan = scan_plan(order, rate_sps, "ad7746")
    best = scan_limits(
        n_legs=6,
        conversion_ns=plan.conversion_ns,
        rate_hz=400_000,
        host_cost_ns=host_cost_us * 1000,
        traffic=schedule.AD7746,
    )
    period_ns = robot.period_ns(9)
    assert 9 * plan.conversion_ns < period_ns < 1.01 * best.scan_ns
    assert rate_sps != 91 or period_ns < limit_ms * 1e6
    timing = robot.buses[0].timing
    assert timing is not None
    assert timing.limits.limiting_factor == "conversion"
    assert math.isclose(timing.limits.scan_ns, best.scan_ns, rel_tol=1e-4)
