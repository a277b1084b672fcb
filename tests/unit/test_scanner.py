"""The scanner over byte-level chips: right values, right times, and no leg pays for another."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_interface.schedule import scan_limits
from footsense.drivers.bus_scanner import BusScanner
from footsense.drivers.robot_scanner import RobotScanner
from footsense.drivers.scan_plan import ORDERS, scan_plan
from footsense.errors import BusError, BusTimeoutError, HardwareError, NackError
from footsense.frames import CapFrame, Reading
from footsense.ports import Transaction
from footsense.sim.bus import SimulatedBus, SimulatedMux
from footsense.sim.clock import JoinedClock, VirtualClock
from footsense.sim.fdc1004_chip import CinCapacitance, SimulatedFdc1004
from footsense.sim.line_switch import SimulatedLineSwitch

T_CONV_NS = 2_500_000
TIMEOUT_NS = 20_000_000
#: A different capacitance for every element, so that a swap shows [pF].
DISTINCT_PF = 5.0 + 0.125 * np.arange(9)

Capacitance = Callable[[int, int], float]  # element, t_ns -> pF


def column_through(switch: SimulatedLineSwitch, capacitance_pf: Capacitance) -> CinCapacitance:
    """Return what a pin sees of its column through the rows that the switch grounds."""

    def seen_pf(cin: int, t_start_ns: int, t_end_ns: int) -> float:
        return sum(
            share * capacitance_pf(3 * row + cin, (t_start_ns + t_end_ns) // 2)
            for share, rows in switch.between(t_start_ns, t_end_ns)
            for row in range(3)
            if rows.selected >> row & 1
        )

    return seen_pf


class Saboteur:
    """A bus on which chosen transactions fail.

    Attributes:
        fails: Tells from a transaction and its number since the last arming how it fails; None for not at all.
    """

    def __init__(self, bus: SimulatedBus, clock: VirtualClock) -> None:
        self._bus = bus
        self._clock = clock
        self._n = 0
        self.fails: Callable[[Transaction, int], BusError | None] = lambda transaction, n: None

    def arm(self, fails: Callable[[Transaction, int], BusError | None]) -> None:
        self.fails, self._n = fails, 0

    def transfer(self, transaction: Transaction) -> bytes:
        error = self.fails(transaction, self._n)
        self._n += 1
        if error is None:
            return self._bus.transfer(transaction)
        self._clock.advance_ns(TIMEOUT_NS if isinstance(error, BusTimeoutError) else 27_500)
        raise error

    def close(self) -> None:
        self._bus.close()


def only(n_failing: int, error: BusError) -> Callable[[Transaction, int], BusError | None]:
    """Return a sabotage of one transaction."""
    return lambda transaction, n: error if n == n_failing else None


class Robot:
    """Legs with given capacitances on one or more buses, and their scanner."""

    def __init__(
        self,
        capacitance_pf: Capacitance,
        *,
        n_buses: int = 1,
        host_cost_ns: int = 0,
        rate_sps: int = 400,
        order: str = "lo_shu",
        clock_error_rel: float = 0.0,
        element_wise: bool = False,
    ) -> None:
        self.converters: list[SimulatedFdc1004] = []
        self.switches: list[SimulatedLineSwitch] = []
        self.saboteurs: list[Saboteur] = []
        clocks = [VirtualClock() for _ in range(n_buses)]
        scanners: list[BusScanner] = []
        per_bus = 6 // n_buses
        for clock in clocks:
            legs = {}
            for channel in range(per_bus):
                switch = SimulatedLineSwitch()
                converter = SimulatedFdc1004(column_through(switch, capacitance_pf), None, clock_error_rel)
                self.converters.append(converter)
                self.switches.append(switch)
                legs[channel] = (converter, switch)
            bus = Saboteur(SimulatedBus(clock, 400_000, host_cost_ns, SimulatedMux(0x71), legs), clock)
            self.saboteurs.append(bus)
            channels = {f"{len(scanners)}{n}": n for n in range(per_bus)}
            scanners.append(BusScanner(bus, clock, channels, 0x71, scan_plan(order, rate_sps)))
        self.clock = JoinedClock(clocks)
        self.buses = scanners
        self.scanner = RobotScanner(scanners, element_wise=element_wise)
        self.scanner.start()

    def read(self, n: int = 1) -> CapFrame:
        for _ in range(n):
            frame = self.scanner.read()
            self.clock.now_ns()
        return frame

    def period_ns(self, n: int = 20) -> float:
        self.read(2)
        start_ns = self.clock.now_ns()
        self.read(n)
        return (self.clock.now_ns() - start_ns) / n


def distinct(element: int, t_ns: int) -> float:
    del t_ns
    return float(DISTINCT_PF[element])


@pytest.mark.parametrize("order", list(ORDERS))
@pytest.mark.parametrize("rate_sps", [100, 200, 400])
@pytest.mark.parametrize("n_buses", [1, 2])
def test_every_element_lands_at_its_place(order: str, rate_sps: int, n_buses: int) -> None:
    """Each of nine different capacitances is read exactly, on all legs, in whatever order and at every rate."""
    frame = Robot(distinct, order=order, rate_sps=rate_sps, n_buses=n_buses).read(2)
    np.testing.assert_array_equal(frame.capacitance_pf, np.tile(DISTINCT_PF, (6, 1)))
    assert (frame.reading == Reading.OK).all()


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


def test_stamps_are_the_middle_of_each_conversion() -> None:
    """A capacitance that counts time is read as the time of its stamp, for every element on its own."""
    robot = Robot(lambda element, t_ns: t_ns * 2**-30)
    frame = robot.read(2)
    np.testing.assert_allclose(frame.capacitance_pf * 2**30, frame.t_ns, atol=2**30 * 2**-11)
    steps = np.diff(np.sort(frame.t_ns[0]))
    assert (steps > T_CONV_NS).all()
    assert (steps < 1.2 * T_CONV_NS).all()


@pytest.mark.parametrize(("order", "least_ff", "most_ff"), [("lo_shu", 0.0, 1.0), ("raster", 50.0, 500.0)])
def test_a_ramp_makes_no_tilt_in_lo_shu_order(order: str, least_ff: float, most_ff: float) -> None:
    """1 pF in 200 ms on all elements: the raster reads it as a tilt, the magic square does not."""
    frame = Robot(lambda element, t_ns: 5.0 + t_ns * 5e-9, order=order).read(3)
    grid = frame.capacitance_pf[0].reshape(3, 3)
    tilt_ff = 1e3 * max(abs((grid[0] - grid[2]).mean()), abs((grid[:, 0] - grid[:, 2]).mean()))
    assert least_ff <= tilt_ff <= most_ff


@pytest.mark.parametrize("clock_error_rel", [-0.02, 0.02])
def test_chips_at_the_end_of_their_tolerance_still_finish_in_time(clock_error_rel: float) -> None:
    """The plan waits for the slowest chip that is allowed."""
    frame = Robot(distinct, clock_error_rel=clock_error_rel).read(3)
    assert (frame.reading == Reading.OK).all()


def test_a_chip_slower_than_its_tolerance_gives_no_number() -> None:
    """A conversion that is still running is NOT_READY, never the value of the scan before."""
    frame = Robot(distinct, clock_error_rel=0.08).read(2)
    assert (frame.reading == Reading.NOT_READY).all()
    assert np.isnan(frame.capacitance_pf).all()


def test_an_absent_leg_costs_only_itself_and_comes_back() -> None:
    """Its elements are NO_ANSWER, all others read on at the same pace; when it answers again it is taken up."""
    robot = Robot(distinct)
    period_ns = robot.period_ns()
    gone_ns = robot.clock.now_ns()
    robot.converters[2].absent_ns = robot.switches[2].absent_ns = [(gone_ns, math.inf)]
    for _ in range(12):
        before_ns = robot.clock.now_ns()
        frame = robot.read()
        assert (frame.reading[2] == Reading.NO_ANSWER).any()
        others = np.delete(np.arange(6), 2)
        np.testing.assert_array_equal(frame.capacitance_pf[others], np.tile(DISTINCT_PF, (5, 1)))
        assert robot.clock.now_ns() - before_ns < 1.05 * period_ns
    robot.converters[2].absent_ns = robot.switches[2].absent_ns = []
    frame = robot.read(200)
    assert (frame.reading == Reading.OK).all()


def test_a_stuck_converter_costs_only_itself() -> None:
    """Its elements are NOT_READY; the others keep every element and their pace, also while it is tried again."""
    robot = Robot(distinct)
    period_ns = robot.period_ns()
    robot.converters[4].stuck_ns = [(robot.clock.now_ns(), math.inf)]
    robot.read()
    for _ in range(60):
        before_ns = robot.clock.now_ns()
        frame = robot.read()
        assert (frame.reading[4] == Reading.NOT_READY).all()
        np.testing.assert_array_equal(frame.capacitance_pf[[0, 1, 2, 3, 5]], np.tile(DISTINCT_PF, (5, 1)))
        assert robot.clock.now_ns() - before_ns < 1.05 * period_ns


def test_a_leg_that_is_missing_at_start_is_looked_for_again() -> None:
    """The others start without it; once it is plugged in it takes part."""
    robot = Robot(distinct)
    robot.converters[0].absent_ns = [(0, math.inf)]
    robot.scanner.start()
    assert (robot.read(2).reading[0] == Reading.NO_ANSWER).any()
    robot.converters[0].absent_ns = []
    assert (robot.read(100).reading == Reading.OK).all()


def test_a_bus_without_its_mux_is_an_error_at_start() -> None:
    """Nothing can work behind a mux that does not answer; the message says what to check."""
    clock = VirtualClock()
    bus = SimulatedBus(clock, 400_000, 0, SimulatedMux(0x72), {})
    scanner = BusScanner(bus, clock, {"lf": 0}, 0x71, scan_plan("lo_shu", 400))
    with pytest.raises(HardwareError, match=r"no answer from the mux \(TCA9548A\) at 0x71: check its power"):
        scanner.start()


def test_readings_of_all_legs_belong_to_the_same_conversion() -> None:
    """A broadcast triggers all legs at once: their stamps are equal to the nanosecond."""
    frame = Robot(distinct).read(2)
    assert (frame.t_ns == frame.t_ns[0]).all()


@pytest.mark.parametrize("order", list(ORDERS))
@pytest.mark.parametrize("error", [NackError("no acknowledge"), BusError("garbled")])
def test_one_failed_transaction_never_makes_a_wrong_number(order: str, error: BusError) -> None:
    """Whichever transaction of a scan fails: every element that is OK then and later is its own capacitance."""
    for n_failing in range(160):
        robot = Robot(distinct, order=order)
        robot.read(2)
        robot.saboteurs[0].arm(only(n_failing, error))
        for _ in range(4):
            frame = robot.read()
            ok = frame.reading == Reading.OK
            assert np.array_equal(frame.capacitance_pf[ok], np.tile(DISTINCT_PF, (6, 1))[ok])
            assert np.isnan(frame.capacitance_pf[~ok]).all()
        assert (frame.reading == Reading.OK).all()


@pytest.mark.parametrize("after_ms", range(26))
def test_a_converter_that_was_reset_is_noticed_and_set_up_again(after_ms: int) -> None:
    """After a dip of its supply it would read column 0 in every slot, and acknowledge everything."""
    robot = Robot(distinct)
    robot.read(2)
    at_ns = robot.clock.now_ns() + after_ms * 1_000_000
    robot.converters[3].brown_outs_ns, robot.switches[3].brown_outs_ns = [at_ns], [at_ns]
    seen = set()
    for _ in range(60):
        frame = robot.read()
        seen |= set(frame.reading[3].tolist())
        ok = frame.reading == Reading.OK
        assert np.array_equal(frame.capacitance_pf[ok], np.tile(DISTINCT_PF, (6, 1))[ok])
        assert ok[[0, 1, 2, 4, 5]].all()
    assert Reading.MISCONFIGURED in seen
    assert ok.all()


def test_a_deaf_row_switch_is_noticed() -> None:
    """The others acknowledge for it and its converter converts: only its own read-back tells."""
    robot = Robot(distinct)
    robot.read(2)
    robot.switches[1].deaf_ns = [(robot.clock.now_ns(), math.inf)]
    robot.read()
    for _ in range(40):
        frame = robot.read()
        ok = frame.reading == Reading.OK
        assert np.array_equal(frame.capacitance_pf[ok], np.tile(DISTINCT_PF, (6, 1))[ok])
        assert not ok[1].all()
        assert ok[[0, 2, 3, 4, 5]].all()


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
        assert (frame.reading[3:] == Reading.LINE_HELD).all()
    assert slow < 30
    assert robot.clock.now_ns() - before_ns < 1.1 * 400 * period_ns
    robot.saboteurs[1].arm(lambda transaction, n: None)
    assert (robot.read(400).reading == Reading.OK).all()


def test_a_result_from_before_a_stall_is_not_used() -> None:
    """If the loop was held up, the conversion that had been running is done again."""
    robot = Robot(distinct)
    robot.read(2)
    robot.clock.sleep_until_ns(robot.clock.now_ns() + 200_000_000)
    frame = robot.read()
    assert (frame.reading == Reading.OK).all()
    assert np.ptp(frame.t_ns) < 9 * 1.1 * T_CONV_NS


def test_a_result_from_before_a_stall_does_not_speak_for_the_conversion_after_it() -> None:
    """Its DONE is read away first: a conversion that then hangs is NOT_READY, whatever the register still holds."""
    robot = Robot(distinct)
    robot.read(2)
    robot.clock.sleep_until_ns(robot.clock.now_ns() + 200_000_000)
    robot.converters[0].write(b"\x0c", robot.clock.now_ns())  # the conversion that had been running finishes
    robot.converters[0].stuck_ns = [(robot.clock.now_ns(), robot.clock.now_ns() + 4_000_000)]
    assert (robot.read().reading[0] == Reading.NOT_READY).all()


TROUBLES = st.lists(
    st.tuples(
        st.integers(0, 1500),  # transaction at which it begins
        st.integers(1, 200),  # transactions that it lasts
        st.sampled_from([NackError("no acknowledge"), BusError("garbled"), BusTimeoutError("held low")]),
    ),
    max_size=6,
)
CHIP_FAULTS = st.lists(
    st.tuples(st.sampled_from(["absent", "brown_out", "stuck"]), st.integers(0, 5), st.integers(50, 400)),
    max_size=4,
)


@given(TROUBLES, CHIP_FAULTS, st.sampled_from(list(ORDERS)))
@settings(max_examples=25)
def test_whatever_fails_a_reading_is_right_or_missing(
    troubles: list[tuple[int, int, BusError]], chip_faults: list[tuple[str, int, int]], order: str
) -> None:
    """Random failures of bus and chips: no exception, no wrong number, and all is well some time after the last."""
    robot = Robot(distinct, order=order)
    robot.read(2)

    def fails(transaction: Transaction, n: int) -> BusError | None:
        del transaction
        return next((error for begin, length, error in troubles if begin <= n < begin + length), None)

    robot.saboteurs[0].arm(fails)
    for kind, leg, at_ms in chip_faults:
        at_ns = robot.clock.now_ns() + at_ms * 1_000_000
        if kind == "absent":
            robot.converters[leg].absent_ns.append((at_ns, at_ns + 100_000_000))
            robot.switches[leg].absent_ns.append((at_ns, at_ns + 100_000_000))
        elif kind == "brown_out":
            robot.converters[leg].brown_outs_ns.append(at_ns)
            robot.switches[leg].brown_outs_ns.append(at_ns)
        else:
            robot.converters[leg].stuck_ns.append((at_ns, at_ns + 200_000_000))
    for _ in range(40):
        frame = robot.read()
        ok = frame.reading == Reading.OK
        assert np.array_equal(frame.capacitance_pf[ok], np.tile(DISTINCT_PF, (6, 1))[ok])
        assert np.isnan(frame.capacitance_pf[~ok]).all()
        assert (frame.t_ns[ok] > 0).all()
    robot.saboteurs[0].arm(lambda transaction, n: None)
    assert (robot.read(500).reading == Reading.OK).all()
