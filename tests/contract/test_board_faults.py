"""Chips and switches that reset, stall, or ignore settings: board `fdc1004` gives a right reading or none."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from footsense.errors import I2cError, I2cTimeoutError, NackError
from footsense.frames import Reading
from footsense.ports import Transaction
from tests.contract.boards import CONVERSION_NS, LateError, Robot, distinct


@pytest.mark.parametrize("after_rel", [0.0, 0.4, 0.7, 1.1])
@pytest.mark.parametrize("host_cost_us", [0, 150])
def test_a_converter_that_was_reset_is_noticed_and_set_up_again(after_rel: float, host_cost_us: int) -> None:
    """After a dip of its supply it would read something else than it was told, and acknowledge everything.

    Where the bus is the limit, its settings are checked once in nine scans.
    """
    robot = Robot(distinct, host_cost_ns=1000 * host_cost_us)
    robot.read(2)
    at_ns = robot.clock.now_ns() + round(after_rel * 9 * CONVERSION_NS)
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


@pytest.mark.parametrize("line", [None, 0, 1, 2])
def test_a_deaf_switch_and_a_line_that_is_closed_too_much_are_noticed(line: int | None) -> None:
    """The others acknowledge for it, and the wired AND hides it: each leg is asked alone; it is out until it heals."""
    robot = Robot(distinct)
    period_ns = robot.period_ns(18)
    switch = robot.switches[1]
    start_ns = robot.clock.now_ns()
    if line is None:
        switch.ignores_writes_ns = [(start_ns, math.inf)]
    else:
        switch.stuck_closed = 1 << line
    robot.read(19)
    for _ in range(60):
        frame = robot.read()
        robot.assert_honest(frame)
        if line is None:  # what it was left at is right for some elements
            assert not (frame.reading[1] == Reading.OK).all()
        else:
            assert (frame.reading[1] == Reading.MISCONFIGURED).all()
        assert (frame.reading[[0, 2, 3, 4, 5]] == Reading.OK).all()
    assert robot.clock.now_ns() - start_ns < 1.3 * 79 * period_ns
    switch.stuck_closed, switch.ignores_writes_ns = 0, []
    assert (robot.read(200).reading == Reading.OK).all()


@pytest.mark.parametrize("hangs", [False, True])
def test_a_result_from_before_a_stall_is_not_used(*, hangs: bool) -> None:
    """If the loop was held up, the conversion that had been running is read away and done again.

    One that then hangs is NOT_READY, whatever the register still holds.
    """
    robot = Robot(distinct)
    robot.read(2)
    robot.clock.sleep_until_ns(robot.clock.now_ns() + 200_000_000)
    now_ns = robot.clock.now_ns()
    robot.converters[0].write(b"\x0c", now_ns)  # the conversion that had been running finishes
    if hangs:
        robot.converters[0].stuck_ns = [(now_ns, now_ns + 1.5 * CONVERSION_NS)]
    frame = robot.read()
    assert (frame.reading[0] == (Reading.NOT_READY if hangs else Reading.OK)).all()
    assert (frame.reading[1:] == Reading.OK).all()
    assert hangs or np.ptp(frame.t_ns) < 9 * 1.1 * CONVERSION_NS


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


@given(TROUBLES, CHIP_FAULTS)
@settings(max_examples=20)
def test_whatever_fails_a_reading_is_right_or_missing(
    troubles: list[tuple[int, int, I2cError]],
    chip_faults: list[tuple[str, int, float]],
) -> None:
    """Random failures of bus and chips: no exception, no wrong number, and all is well some time after the last."""
    robot = Robot(distinct)
    robot.read(2)
    scan_ns = 9 * CONVERSION_NS

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
