"""What a scanner promises of its legs, asked of both boards over byte-level chips."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from footsense.acquisition.scan_plan import CONVERSION_ORDERS, scan_plan
from footsense.errors import I2cError, I2cTimeoutError, NackError
from footsense.frames import Reading
from footsense.ports import Transaction
from footsense.sim.chips.fdc1004 import SimulatedFdc1004
from tests.contract.boards import (
    AD7746,
    DISTINCT_PF,
    FDC1004,
    Board,
    LateError,
    Robot,
    Saboteur,
    distinct,
    only,
)

BOTH = (FDC1004, AD7746)
both = pytest.mark.parametrize("board", BOTH, ids=lambda board: board.name)


@pytest.mark.parametrize(
    ("board", "rate_sps"), [(board, rate_sps) for board in BOTH for rate_sps in board.rates_sps]
)
@pytest.mark.parametrize("order", list(CONVERSION_ORDERS))
@pytest.mark.parametrize("n_buses", [1, 2])
def test_every_element_lands_at_its_place(board: Board, rate_sps: int, order: str, n_buses: int) -> None:
    """Each of nine different capacitances is read exactly, on all legs, in whatever order and at every rate."""
    robot = Robot(distinct, board, order=order, rate_sps=rate_sps, n_buses=n_buses)
    frame = robot.read(2)
    assert (frame.reading == Reading.OK).all()
    assert robot.is_right(frame).all()


@both
def test_stamps_are_the_middle_of_each_conversion(board: Board) -> None:
    """A capacitance that counts time is read as the time of its stamp, for every element on its own."""
    robot = Robot(lambda element, t_ns: 4.0 + t_ns * 2**-30, board)
    frame = robot.read(2)
    np.testing.assert_allclose(frame.capacitance_pf - 4.0, frame.t_ns * 2**-30, atol=2**-11)
    steps = np.diff(np.sort(frame.t_ns[0]))
    assert (steps > board.conversion_ns).all()
    assert (steps < 1.2 * board.conversion_ns).all()


@both
@pytest.mark.parametrize("clock_error_rel", [-0.02, 0.02])
def test_chips_at_the_end_of_their_tolerance_still_finish_in_time(
    board: Board, clock_error_rel: float
) -> None:
    """The plan waits for the slowest chip that is allowed."""
    frame = Robot(distinct, board, clock_error_rel=clock_error_rel).read(3)
    assert (frame.reading == Reading.OK).all()


@both
@pytest.mark.parametrize("host_cost_us", [0, 100])
@pytest.mark.parametrize("clock_error_rel", [0.03, 0.08, 0.15, 0.24, 0.322])
def test_chips_slower_than_their_tolerance_get_the_time_that_they_need(
    board: Board, host_cost_us: int, clock_error_rel: float
) -> None:
    """Measured at start, to two hundredths; stamps are the middle of the longer conversions."""
    robot = Robot(
        lambda element, t_ns: 4.0 + t_ns * 2**-30,
        board,
        clock_error_rel=clock_error_rel,
        host_cost_ns=host_cost_us * 1000,
    )
    frame = robot.read(3)
    assert (frame.reading == Reading.OK).all()
    np.testing.assert_allclose(frame.capacitance_pf - 4.0, frame.t_ns * 2**-30, atol=2**-11)
    for leg in robot.buses[0].legs:
        assert 1.02 * leg.timing.wait_factor < 1 + clock_error_rel + 0.025


@both
def test_a_chip_slower_than_any_gives_no_number(board: Board) -> None:
    """A conversion that is still running is NOT_READY, never the value of the scan before."""
    frame = Robot(distinct, board, clock_error_rel=0.4).read(2)
    assert (frame.reading == Reading.NOT_READY).all()
    assert np.isnan(frame.capacitance_pf).all()


@both
def test_a_chip_whose_clock_drifts_is_timed_again_each_minute(board: Board) -> None:
    """Before the rows of the next element get into its conversions: every reading stays right, at both ends."""
    robot = Robot(distinct, board)
    robot.read(2)
    for error_rel in (0.01, 0.019, 0.028, 0.036, 0.028, 0.0):
        robot.converters[3].clock_factor = 1 + min(error_rel, 0.019)
        for _ in range(6):
            robot.clock.sleep_until_ns(robot.clock.now_ns() + 10_000_000_000)
            frame = robot.read()
            assert (frame.reading == Reading.OK).all()
            assert robot.is_right(frame).all()
        robot.converters[3].clock_factor = 1 + error_rel
        for _ in range(6):
            robot.clock.sleep_until_ns(robot.clock.now_ns() + 10_000_000_000)
            robot.read()
        frame = robot.read(20)
        assert (frame.reading == Reading.OK).all()
        assert robot.is_right(frame).all()
    assert robot.buses[0].legs[3].timing.wait_factor == 1.0


@both
def test_the_timing_of_a_converter_costs_two_conversions_and_no_reading(board: Board) -> None:
    """Every ten seconds; no reading is lost and nothing counts as late."""
    robot = Robot(distinct, board)
    period_ns = robot.period_ns()
    slow_ns = []
    until_ns = robot.clock.now_ns() + 26_000_000_000
    while robot.clock.now_ns() < until_ns:
        before_ns = robot.clock.now_ns()
        frame = robot.read()
        assert (frame.reading == Reading.OK).all()
        if (lasted_ns := robot.clock.now_ns() - before_ns) > 1.05 * period_ns:
            slow_ns.append(lasted_ns - period_ns)
    assert len(slow_ns) in {2, 3, 4, 5}
    assert max(slow_ns) < 6 * board.conversion_ns
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


@both
def test_an_absent_leg_costs_only_itself_and_comes_back(board: Board) -> None:
    """Its elements are NO_ANSWER, all others read on at the same pace; when it answers again it is taken up."""
    robot = Robot(distinct, board)
    period_ns = robot.period_ns()
    gone_ns = robot.clock.now_ns()
    for chip in robot.chips(2):
        chip.absent_ns = [(gone_ns, math.inf)]
    others = np.delete(np.arange(6), 2)
    for _ in range(12):
        before_ns = robot.clock.now_ns()
        frame = robot.read()
        assert (frame.reading[2] == Reading.NO_ANSWER).any()
        assert robot.is_right(frame)[others].all()
        assert robot.clock.now_ns() - before_ns < 1.05 * period_ns
    for chip in robot.chips(2):
        chip.absent_ns = []
    assert (robot.read(200).reading == Reading.OK).all()


@both
def test_a_stuck_converter_costs_only_itself(board: Board) -> None:
    """Its elements are NOT_READY; the others keep every element and their pace, but for what a try takes."""
    robot = Robot(distinct, board)
    period_ns = robot.period_ns()
    robot.converters[4].stuck_ns = [(robot.clock.now_ns(), math.inf)]
    robot.read()
    for _ in range(60):
        before_ns = robot.clock.now_ns()
        frame = robot.read()
        assert (frame.reading[4] == Reading.NOT_READY).all()
        assert robot.is_right(frame)[[0, 1, 2, 3, 5]].all()
        assert robot.clock.now_ns() - before_ns < 1.05 * period_ns + board.probe_ns


@both
def test_a_leg_that_is_missing_at_start_is_looked_for_again(board: Board) -> None:
    """The others start without it; once it is plugged in it takes part."""
    robot = Robot(distinct, board)
    robot.converters[0].absent_ns = [(0, math.inf)]
    robot.scanner.start()
    assert (robot.read(2).reading[0] == Reading.NO_ANSWER).any()
    robot.converters[0].absent_ns = []
    frame = robot.read(100)
    assert (frame.reading == Reading.OK).all()
    assert robot.is_right(frame).all()


@both
def test_readings_of_all_legs_belong_to_the_same_conversion(board: Board) -> None:
    """A broadcast triggers all legs at once: their stamps are equal to the nanosecond, and frames count from 0."""
    robot = Robot(distinct, board)
    assert robot.read().sequence == 0
    frame = robot.convert()
    assert frame.sequence == 1
    frame = robot.read()
    assert (frame.t_ns == frame.t_ns[0]).all()


@pytest.mark.parametrize(
    ("board", "order", "error"),
    [
        *(
            (FDC1004, order, error)
            for order in CONVERSION_ORDERS
            for error in (NackError("none"), I2cError("garbled"))
        ),
        (AD7746, "lo_shu", NackError("none")),
        (AD7746, "raster", I2cError("garbled")),
        *((board, "lo_shu", LateError("not heard")) for board in BOTH),
    ],
    ids=lambda value: getattr(value, "name", str(value)),
)
def test_one_failed_transaction_never_makes_a_wrong_number(board: Board, order: str, error: I2cError) -> None:
    """Whichever transaction of a scan fails: every element that is OK then and later is its own capacitance."""
    n_transactions = 160 if board is FDC1004 else 190
    for n_failing in range(n_transactions):
        robot = Robot(distinct, board, order=order)
        robot.read(2)
        robot.saboteurs[0].arm(only(n_failing, error))
        for _ in range(4):
            frame = robot.read()
            robot.assert_honest(frame)
        assert (frame.reading == Reading.OK).all()


@pytest.mark.parametrize("selection", [0b000001, 0b010100])
@pytest.mark.parametrize(("host_cost_us", "reads_back"), [(20, None), (100, True)])
@both
def test_another_program_that_switches_the_mux_makes_no_wrong_number(
    board: Board, selection: int, host_cost_us: int, *, reads_back: bool | None
) -> None:
    """Whenever in a scan: where the host leaves the time, or if it is to, the mux is read back after every leg."""
    foreign = Transaction(0x71, bytes((selection,)))
    for n_switched in range(0, 400, 19):
        robot = Robot(distinct, board, host_cost_ns=host_cost_us * 1000, reads_back=reads_back)
        robot.make_legs_distinct()
        robot.read(2)
        bus = robot.saboteurs[0]

        def switch(transaction: Transaction, n: int, bus: Saboteur = bus, at: int = n_switched) -> None:
            del transaction
            if n == at:
                bus._bus.transfer(foreign)

        bus.arm(switch)
        for _ in range(3):
            frame = robot.read()
            robot.assert_honest(frame)
            assert (frame.t_ns[frame.reading == Reading.OK] > 0).all()
        assert (robot.read(3).reading == Reading.OK).all()


@both
@pytest.mark.parametrize("error", [NackError("none"), I2cError("input/output error")])
def test_a_conversion_that_cannot_be_started_is_a_miss(board: Board, error: I2cError) -> None:
    """Legs are left out after three, and tried again later: whatever the adapter calls the failure, but no timeout."""
    robot = Robot(distinct, board)
    robot.read(2)
    steps = scan_plan("lo_shu", board.rates_sps[0], board.name).steps
    triggers = {step.trigger for step in steps}
    robot.saboteurs[0].arm(lambda transaction, n: error if transaction in triggers else None)
    frame = robot.read()
    assert (frame.reading[:, steps[0].element] == Reading.OK).all()  # it was running before
    assert (np.delete(frame.reading, steps[0].element, axis=1) == Reading.NO_ANSWER).all()
    robot.read(3)
    assert not any(leg.in_scan for leg in robot.buses[0].legs)


@both
@pytest.mark.parametrize("after_rel", np.linspace(0.0, 1.1, 26))
def test_a_converter_that_was_reset_is_noticed_and_set_up_again(board: Board, after_rel: float) -> None:
    """After a dip of its supply it would read something else than it was told, and acknowledge everything."""
    robot = Robot(distinct, board)
    robot.read(2)
    at_ns = robot.clock.now_ns() + round(after_rel * 9 * board.conversion_ns)
    for chip in robot.chips(3):
        chip.brown_outs_ns = [at_ns]
    seen = set()
    for _ in range(60):
        frame = robot.read()
        seen |= set(frame.reading[3].tolist())
        robot.assert_honest(frame)
        assert (frame.reading[[0, 1, 2, 4, 5]] == Reading.OK).all()
    assert seen & {Reading.MISCONFIGURED, Reading.NOT_READY}
    assert (frame.reading == Reading.OK).all()


@pytest.mark.parametrize(
    ("board", "switch"),
    [(FDC1004, 0), (AD7746, 0), (AD7746, 1)],
    ids=lambda value: getattr(value, "name", ""),
)
def test_a_deaf_line_switch_is_noticed(board: Board, switch: int) -> None:
    """The others acknowledge for it and its converter converts: only its own read-back tells."""
    robot = Robot(distinct, board)
    robot.read(2)
    robot.switches[1][switch].ignores_writes_ns = [(robot.clock.now_ns(), math.inf)]
    robot.read()
    for _ in range(40):
        frame = robot.read()
        robot.assert_honest(frame)
        assert not (frame.reading[1] == Reading.OK).all()
        assert (frame.reading[[0, 2, 3, 4, 5]] == Reading.OK).all()


@pytest.mark.parametrize("board_and_switch", [(FDC1004, 0), (AD7746, 0), (AD7746, 1)], ids=str)
@pytest.mark.parametrize("order", list(CONVERSION_ORDERS))
@pytest.mark.parametrize("line", range(3))
def test_a_line_that_is_closed_too_much_is_noticed(
    board_and_switch: tuple[Board, int], order: str, line: int
) -> None:
    """The wired AND of the legs hides it, so each leg is asked alone in turn; it stays out until it lets go."""
    board, switch = board_and_switch
    robot = Robot(distinct, board, order=order)
    period_ns = robot.period_ns(18)
    robot.switches[1][switch].stuck_closed = 1 << line
    start_ns = robot.clock.now_ns()
    robot.read(19)
    for _ in range(60):
        frame = robot.read()
        assert (frame.reading[1] == Reading.MISCONFIGURED).all()
        robot.assert_honest(frame)
        assert (frame.reading[[0, 2, 3, 4, 5]] == Reading.OK).all()
    assert robot.clock.now_ns() - start_ns < 1.3 * 79 * period_ns
    robot.switches[1][switch].stuck_closed = 0
    assert (robot.read(200).reading == Reading.OK).all()


@pytest.mark.parametrize("rate_sps", AD7746.rates_sps)
def test_a_temperature_costs_no_reading_and_is_no_stall(rate_sps: int) -> None:
    """Every ten seconds, at every rate: each element stays right, and nothing counts as late."""
    robot = Robot(distinct, AD7746, rate_sps=rate_sps)
    robot.read(2)
    thermometer = scan_plan("lo_shu", rate_sps, "ad7746").board.thermometer
    assert thermometer is not None
    n_asked = 0

    def count(transaction: Transaction, n: int) -> None:
        nonlocal n_asked
        n_asked += transaction == thermometer.start[0]

    robot.saboteurs[0].arm(count)
    until_ns = robot.clock.now_ns() + 25_000_000_000
    while robot.clock.now_ns() < until_ns:
        frame = robot.convert()
        assert (frame.reading == Reading.OK).all()
        assert robot.is_right(frame).all()
    assert np.isfinite(robot.scanner.temperature_c()).all()
    assert n_asked in {2, 3}
    assert [bus.n_late_discards for bus in robot.buses] == [0]


@pytest.mark.parametrize(
    ("n_buses", "n_after_start"), [(1, 0), (1, 1), (1, 3), (6, 0), (6, 1), (6, 2), (6, 3)]
)
def test_a_mux_that_is_reset_while_temperatures_are_read_costs_no_reading(
    n_buses: int, n_after_start: int
) -> None:
    """The selection is written again, so that every converter gets back the settings of its elements.

    A leg alone on its bus has the same selection before and after.
    """
    robot = Robot(distinct, AD7746, n_buses=n_buses)
    robot.read(2)
    thermometer = scan_plan("lo_shu", 91, "ad7746").board.thermometer
    assert thermometer is not None
    started: list[int] = []

    def reset_mux(transaction: Transaction, n: int) -> I2cError | None:
        if not started and transaction == thermometer.start[0]:
            started.append(n)
        if not started or n != started[0] + n_after_start or transaction.address == 0x71:
            return None
        robot.saboteurs[0].transfer(Transaction(0x71, b"\x00"))
        return NackError("no channel is connected")

    robot.saboteurs[0].arm(reset_mux)
    until_ns = robot.clock.now_ns() + 11_000_000_000
    while robot.clock.now_ns() < until_ns:
        assert (robot.read().reading == Reading.OK).all()
    assert started


@both
def test_a_result_from_before_a_stall_is_not_used(board: Board) -> None:
    """If the loop was held up, the conversion that had been running is done again."""
    robot = Robot(distinct, board)
    robot.read(2)
    robot.clock.sleep_until_ns(robot.clock.now_ns() + 200_000_000)
    frame = robot.read()
    assert (frame.reading == Reading.OK).all()
    assert np.ptp(frame.t_ns) < 9 * 1.1 * board.conversion_ns


@both
def test_a_result_from_before_a_stall_does_not_speak_for_the_conversion_after_it(board: Board) -> None:
    """It is read away first: a conversion that then hangs is NOT_READY, whatever the register still holds."""
    robot = Robot(distinct, board)
    robot.read(2)
    robot.clock.sleep_until_ns(robot.clock.now_ns() + 200_000_000)
    now_ns = robot.clock.now_ns()
    robot.converters[0].write(b"\x0c", now_ns)  # the conversion that had been running finishes
    robot.converters[0].stuck_ns = [(now_ns, now_ns + 1.5 * board.conversion_ns)]
    assert (robot.read().reading[0] == Reading.NOT_READY).all()


TROUBLES = st.lists(
    st.tuples(
        st.integers(0, 1500),  # transaction at which it begins
        st.integers(1, 200),  # transactions that it lasts
        st.sampled_from(
            [NackError("no acknowledge"), I2cError("garbled"), I2cTimeoutError("held low"), LateError("late")]
        ),
    ),
    max_size=6,
)
CHIP_FAULTS = st.lists(
    st.tuples(st.sampled_from(["absent", "brown_out", "stuck"]), st.integers(0, 5), st.floats(2.0, 18.0)),
    max_size=4,
)


@both
@given(TROUBLES, CHIP_FAULTS, st.sampled_from(list(CONVERSION_ORDERS)))
@settings(max_examples=20)
def test_whatever_fails_a_reading_is_right_or_missing(
    board: Board,
    troubles: list[tuple[int, int, I2cError]],
    chip_faults: list[tuple[str, int, float]],
    order: str,
) -> None:
    """Random failures of bus and chips: no exception, no wrong number, and all is well some time after the last."""
    robot = Robot(distinct, board, order=order)
    robot.read(2)
    scan_ns = 9 * board.conversion_ns

    def fails(transaction: Transaction, n: int) -> I2cError | None:
        del transaction
        return next((error for begin, length, error in troubles if begin <= n < begin + length), None)

    robot.saboteurs[0].arm(fails)
    for kind, leg, at_scans in chip_faults:
        at_ns = robot.clock.now_ns() + round(at_scans * scan_ns)
        if kind == "absent":
            for chip in robot.chips(leg):
                chip.absent_ns.append((at_ns, at_ns + 4 * scan_ns))
        elif kind == "brown_out":
            for chip in robot.chips(leg):
                chip.brown_outs_ns.append(at_ns)
        else:
            robot.converters[leg].stuck_ns.append((at_ns, at_ns + 8 * scan_ns))
    for _ in range(40):
        robot.assert_honest(robot.read())
    robot.saboteurs[0].arm(lambda transaction, n: None)
    for _ in range(500):
        frame = robot.read()
        robot.assert_honest(frame)
        if (frame.reading == Reading.OK).all():
            return
    pytest.fail("a leg has not come back")


@pytest.mark.parametrize("kind", ["short", "open"])
def test_codes_at_either_end_of_the_range_are_no_numbers(kind: str) -> None:
    """What lies beyond 6.6 +- 4.1 pF is over or under the range; such an element has been read all the same."""
    beyond_pf = 20.0 if kind == "short" else 0.1
    robot = Robot(lambda element, t_ns: beyond_pf if element == 4 else float(DISTINCT_PF[element]), AD7746)
    frame = robot.read(3)
    assert (frame.reading[:, 4] == (Reading.OVER_RANGE if kind == "short" else Reading.UNDER_RANGE)).all()
    assert (frame.t_ns > 0).all()
    assert robot.is_right(frame)[:, [0, 8]].all()
