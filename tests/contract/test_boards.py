"""What a scanner promises of its legs, asked of board `fdc1004` over byte-level chips."""

import math

import numpy as np
import pytest

from footsense.acquisition.scan_plan import scan_plan
from footsense.errors import I2cError, NackError
from footsense.frames import Reading
from tests.contract.boards import CONVERSION_NS, PROBE_NS, LateError, Robot, distinct, only


@pytest.mark.parametrize("rate_sps", [400, 200, 100])
@pytest.mark.parametrize("n_buses", [1, 2])
def test_every_element_lands_at_its_place(rate_sps: int, n_buses: int) -> None:
    """Each of nine different capacitances is read exactly, on all legs and at every rate."""
    robot = Robot(distinct, rate_sps=rate_sps, n_buses=n_buses)
    frame = robot.read(2)
    assert (frame.reading == Reading.OK).all()
    assert robot.is_right(frame).all()


@pytest.mark.parametrize("reading", [Reading.NO_ANSWER, Reading.NOT_READY])
def test_an_absent_leg_or_a_stuck_converter_costs_only_itself(reading: Reading) -> None:
    """The others keep every element and their pace, but for a try and its timing; when it is well it is taken up."""
    robot = Robot(distinct)
    period_ns = robot.period_ns()
    away: list[tuple[float, float]] = [(robot.clock.now_ns(), math.inf)]
    for chip in robot.chips(2):
        chip.absent_ns = away if reading == Reading.NO_ANSWER else []
    robot.converters[2].stuck_ns = away if reading == Reading.NOT_READY else []
    cost_ns = 0 if reading == Reading.NO_ANSWER else PROBE_NS + 5 * CONVERSION_NS
    robot.read()
    for _ in range(60):
        before_ns = robot.clock.now_ns()
        frame = robot.read()
        assert (frame.reading[2] == reading).any()
        assert robot.is_right(frame)[[0, 1, 3, 4, 5]].all()
        assert robot.clock.now_ns() - before_ns < 1.05 * period_ns + cost_ns
    for chip in robot.chips(2):
        chip.absent_ns = []
    robot.converters[2].stuck_ns = []
    assert (robot.read(200).reading == Reading.OK).all()


def test_a_leg_that_is_missing_at_start_is_looked_for_again() -> None:
    """The others start without it; once it is plugged in it takes part."""
    robot = Robot(distinct)
    robot.converters[0].absent_ns = [(0, math.inf)]
    robot.scanner.start()
    assert (robot.read(2).reading[0] == Reading.NO_ANSWER).any()
    robot.converters[0].absent_ns = []
    frame = robot.read(100)
    assert (frame.reading == Reading.OK).all()
    assert robot.is_right(frame).all()


def test_a_leg_that_fails_again_is_tried_again_as_soon_as_at_first() -> None:
    """The pauses between its tries grow while it is away, and begin anew once it was there."""
    robot = Robot(distinct)
    for away_s in (1.5, 0.3):
        robot.read(2)
        now_ns = robot.clock.now_ns()
        until_ns = now_ns + round(away_s * 1e9)
        for chip in robot.chips(3):
            chip.absent_ns = [(now_ns, until_ns)]
        while robot.clock.now_ns() < until_ns:
            robot.read()
        while (robot.read().reading[3] != Reading.OK).any():
            assert robot.clock.now_ns() < until_ns + (2_000_000_000 if away_s > 1.0 else 600_000_000)


def test_readings_of_all_legs_belong_to_the_same_conversion() -> None:
    """A broadcast triggers all legs at once: their stamps are equal to the nanosecond, and frames count from 0."""
    robot = Robot(distinct)
    assert robot.read().sequence == 0
    frame = robot.convert()
    assert frame.sequence == 1
    frame = robot.read()
    assert (frame.t_ns == frame.t_ns[0]).all()


@pytest.mark.parametrize("error", [NackError("none"), I2cError("garbled"), LateError("not heard")], ids=str)
@pytest.mark.slow
def test_one_failed_transaction_never_makes_a_wrong_number(error: I2cError) -> None:
    """Whichever transaction of a scan fails: every element that is OK then and later is its own capacitance."""
    for n_failing in range(160):
        robot = Robot(distinct)
        robot.read(2)
        robot.saboteurs[0].arm(only(n_failing, error))
        for _ in range(4):
            frame = robot.read()
            robot.assert_honest(frame)
        assert (frame.reading == Reading.OK).all()


@pytest.mark.parametrize("error", [NackError("none"), I2cError("input/output error")])
def test_a_conversion_that_cannot_be_started_is_a_miss(error: I2cError) -> None:
    """Legs are left out after three, and tried again later: whatever the adapter calls the failure, but no timeout."""
    robot = Robot(distinct)
    robot.read(2)
    steps = scan_plan(400).steps
    triggers = {step.trigger for step in steps}
    robot.saboteurs[0].arm(lambda transaction, n: error if transaction in triggers else None)
    frame = robot.read()
    assert (frame.reading[:, steps[0].element] == Reading.OK).all()  # it was running before
    assert (np.delete(frame.reading, steps[0].element, axis=1) == Reading.NO_ANSWER).all()
    robot.read(3)
    assert not any(leg.in_scan for leg in robot.buses[0].legs)
