"""The scanner's pace over byte-level chips, and what it does about buses; what it promises of legs: tests/contract."""

import math
import threading
from typing import cast

import numpy as np
import pytest

from firmware_interface.chips.fdc1004 import Fdc1004Register
from firmware_interface.schedule import scan_lower_bounds
from footsense.acquisition.boards.fdc1004 import read_register
from footsense.acquisition.leg_bus import LegBus
from footsense.acquisition.robot_scanner import RobotScanner
from footsense.acquisition.scan_plan import AD7147_PLAN, scan_plan
from footsense.acquisition.scanner import BusScanner
from footsense.clock import MonotonicClock
from footsense.errors import HardwareError, I2cError, I2cTimeoutError, NackError
from footsense.frames import CapFrame, Reading
from footsense.ports import Transaction
from footsense.sim.chips.chip import SimulatedMux
from footsense.sim.clock import VirtualClock
from footsense.sim.i2c_bus import SimulatedBus
from tests.contract.boards import CONVERSION_NS, LateError, Robot, Saboteur, distinct, only


@pytest.mark.parametrize(
    ("n_buses", "host_cost_us", "limit"), [(1, 0, 1.08), (2, 0, 1.08), (1, 100, 1.18), (1, 150, 1.49)]
)
def test_the_scan_period_is_near_the_best(n_buses: int, host_cost_us: int, limit: float) -> None:
    """Within 3 % of the best that bus and chips allow, and so near to nine conversions; the scanner knows it too."""
    robot = Robot(distinct, n_buses=n_buses, host_cost_ns=host_cost_us * 1000)
    best = scan_lower_bounds(
        n_legs=6 // n_buses,
        conversion_ns=CONVERSION_NS,
        bus_hz=400_000,
        host_cost_ns=host_cost_us * 1000,
    )
    period_ns = robot.period_ns(18)  # in which every check has had its turn
    assert 9 * CONVERSION_NS < period_ns < min(limit * 9 * CONVERSION_NS, 1.03 * best.scan_period_bound_ns)
    for bus in robot.buses:
        assert bus.bus_timing is not None
        assert math.isclose(
            bus.bus_timing.lower_bounds.scan_period_bound_ns, best.scan_period_bound_ns, rel_tol=1e-4
        )
        assert math.isclose(bus.bus_timing.host_ns_per_transaction, host_cost_us * 1000, abs_tol=10)
    if (n_buses, host_cost_us) == (1, 100):
        assert str(bus.bus_timing) == (
            "400 kHz and 100 us of host per transaction; the best scan takes "
            "25.7 ms, 1.14 x its conversions; the limit is the read-out"
        )


def test_a_ramp_makes_no_tilt() -> None:
    """1 pF in 200 ms on all elements: an order along the rows would read it as one."""
    frame = Robot(lambda element, t_ns: 5.0 + t_ns * 5e-9).read(3)
    grid = frame.capacitance_pf[0].reshape(3, 3)
    tilt_ff = 1e3 * max(abs((grid[0] - grid[2]).mean()), abs((grid[:, 0] - grid[:, 2]).mean()))
    assert tilt_ff <= 1.0


def test_a_bus_without_its_mux_is_an_error_at_start() -> None:
    """Nothing can work behind a mux that does not answer; the message says what to check."""
    clock = VirtualClock()
    bus = SimulatedBus(clock, 400_000, 0, SimulatedMux(0x72), {})
    scanner = BusScanner(LegBus(bus, 0x71), clock, {"lf": 0}, scan_plan(400))
    with pytest.raises(HardwareError, match=r"no answer from the mux \(TCA9548A\) at 0x71: check its power"):
        scanner.start()


@pytest.mark.slow
def test_a_stuck_bus_costs_the_other_bus_nothing_and_comes_back(caplog: pytest.LogCaptureFixture) -> None:
    """SDA held low on one of two buses: its legs are silent, and the others keep their pace through each timeout.

    The journal has a line of the bus, and none that blames a leg.
    """
    robot = Robot(distinct, n_buses=2)
    period_ns = robot.period_ns()
    robot.saboteurs[1].arm(lambda transaction, n: I2cTimeoutError("a line is held low"))
    robot.read()
    before_ns = robot.clock.now_ns()
    slow = 0
    for n in range(400):
        start_ns = robot.clock.now_ns()
        frame = robot.read()
        slow += robot.clock.now_ns() - start_ns > 1.05 * period_ns
        assert (frame.reading[:3] == Reading.OK).all()
        assert n < 10 or (frame.reading[3:] == Reading.BUS_STUCK).all()
    assert slow == 0
    assert robot.clock.now_ns() - before_ns < 1.001 * 400 * period_ns
    robot.saboteurs[1].arm(lambda transaction, n: None)
    assert (robot.read(400).reading == Reading.OK).all()
    (line,) = [record.getMessage() for record in caplog.records if "held low" in record.getMessage()]
    assert line.startswith("the bus of 10, 11, 12 is held low")
    assert line.endswith("tried again at least every 1 s")


class HeldBus:
    """A bus whose reads wait in the kernel, as for a timeout."""

    plan = AD7147_PLAN

    def __init__(self) -> None:
        self.clock = MonotonicClock()
        self.lines_free = threading.Event()
        self.lines_free.set()
        self.n_read = self.complete_ns = 0

    @property
    def latest(self) -> CapFrame:
        return CapFrame(0, np.full((1, 9), self.n_read), np.ones((1, 9)), np.zeros((1, 9), np.uint8))

    def read(self) -> CapFrame:
        self.lines_free.wait(10)
        self.n_read, self.complete_ns = self.n_read + 1, self.clock.now_ns()
        return self.latest

    def close(self) -> None: ...


def test_in_threads_a_bus_that_waits_is_not_waited_for() -> None:
    """Its last readings stay in the frames; once it is there again, it takes part again."""
    buses = [HeldBus(), HeldBus()]
    scanner = RobotScanner(cast("list[BusScanner]", buses), threads=True)
    assert scanner.read().t_ns[:, 0].tolist() == [1, 1]
    buses[1].lines_free.clear()
    for n in range(2, 7):
        assert scanner.read().t_ns[:, 0].tolist() == [n, 1]
    buses[1].lines_free.set()
    while (frame := scanner.read()).t_ns[1, 0] == 1:
        assert frame.t_ns[0, 0] < 10_000
    n = int(scanner.read().t_ns[1, 0])
    assert scanner.read().t_ns[1, 0] == n + 1
    scanner.close()


def test_legs_that_are_missing_are_tried_one_a_scan() -> None:
    """Both are due at once; the second one waits for the next scan, so that the others keep their pace."""
    robot = Robot(distinct)
    for leg in (1, 4):
        for chip in robot.chips(leg):
            chip.absent_ns = [(0, math.inf)]
    robot.read(4)
    tries: list[int] = []

    def count(transaction: Transaction, n: int) -> None:
        tries[-1] += transaction == read_register(Fdc1004Register.MANUFACTURER_ID)

    robot.saboteurs[0].arm(count)
    for _ in range(100):
        tries.append(0)
        robot.read()
    assert max(tries) == 1
    assert sum(tries) >= 6


def test_a_leg_that_cannot_be_connected_is_tried_again() -> None:
    """The mux does not acknowledge when it is told to connect the missing leg; the others read on."""
    robot = Robot(distinct)
    for chip in robot.chips(1):
        chip.absent_ns = [(0, math.inf)]
    robot.read(4)
    for chip in robot.chips(1):
        chip.absent_ns = []
    alone = Transaction(0x71, b"\x02")
    robot.saboteurs[0].arm(lambda transaction, n: NackError("no mux") if transaction == alone else None)
    for _ in range(100):
        frame = robot.read()
        assert (frame.reading[1] == Reading.NO_ANSWER).all()
        assert (frame.reading[[0, 2, 3, 4, 5]] == Reading.OK).all()
    robot.saboteurs[0].arm(lambda transaction, n: None)
    assert (robot.read(200).reading == Reading.OK).all()


def test_a_leg_that_failed_is_connected_no_more_in_that_scan() -> None:
    """A converter that does not finish is asked alone once; the other five go on without it until the scan ends."""
    robot = Robot(distinct)
    robot.read(2)
    robot.converters[3].stuck_ns = [(robot.clock.now_ns(), math.inf)]
    selections: list[int] = []

    def note(transaction: Transaction, n: int) -> None:
        if transaction.address == 0x71 and transaction.write:
            selections.append(transaction.write[0])

    robot.saboteurs[0].arm(note)
    robot.read()
    alone = [n for n, selection in enumerate(selections) if selection == 0b001000]
    between = selections[alone[0] + 1 : alone[1]]
    assert between.count(0b110111) >= 7
    assert not any(selection & 0b001000 for selection in between)


def test_a_bus_that_times_out_twice_costs_what_was_being_read() -> None:
    """Triggers time out, and no leg holds a line when it is asked: all legs stay, and lose that element."""
    robot = Robot(distinct)
    for _ in range(1 + 4):
        robot.convert()
    steps = scan_plan(400).steps
    triggers = {step.trigger for step in steps}
    robot.saboteurs[0].arm(lambda sent, n: I2cTimeoutError("held low") if sent in triggers else None)
    delayed = robot.convert().reading == Reading.DELAYED
    assert (delayed == (np.arange(9) == steps[4].element)).all()
    robot.saboteurs[0].arm(lambda transaction, n: None)
    assert (robot.read().reading == Reading.OK).all()


def test_a_selection_that_may_have_been_taken_is_written_again() -> None:
    """After a failure neither the old legs nor the new ones count as connected."""
    clock, mux = VirtualClock(), SimulatedMux(0x71)
    bus = Saboteur(SimulatedBus(clock, 400_000, 0, mux, {}), clock)
    legs = LegBus(bus, 0x71)
    legs.connect(0b11)
    bus.arm(only(0, LateError("not heard")))
    with pytest.raises(I2cError):
        legs.connect(0b100)
    legs.connect(0b11)
    assert bus.transfer(Transaction(0x71, b"", 1)) == b"\x03"
