"""Board `fdc1004_columns`: a row is read at one time by three converters, at the pace of their conversions.

Whatever one of them does, every reading is right or says that it is none.
"""

import itertools
import math
from typing import Any

import numpy as np
import pytest

from firmware_interface import schedule
from firmware_interface.schedule import scan_lower_bounds
from footsense.errors import I2cError, NackError
from footsense.frames import CapFrame, Reading
from footsense.sim.faults import scene_faults
from footsense.sim.faults.scene_faults import ChipFault
from footsense.sim.scene import Effects, OddColumn
from tests.contract.boards import COLUMNS, Robot, distinct, only

CONVERSION_NS = COLUMNS.conversion_ns
#: Triggers of the other two converters, at 400 kHz [ns].
START_NS = 96_300
LEG = 4
OTHERS = [0, 1, 2, 3, 5]


@pytest.mark.parametrize(
    ("n_buses", "host_cost_us", "limit"),
    [
        *((1, *rest) for rest in ((0, 1.25), (40, 1.75), (100, 2.50))),
        *((2, *rest) for rest in ((0, 1.03), (40, 1.07), (100, 1.53))),
        *((3, *rest) for rest in ((0, 1.03), (40, 1.04), (100, 1.21))),
    ],
)
def test_a_scan_takes_three_conversions_where_the_buses_carry_it(
    n_buses: int, host_cost_us: int, limit: float
) -> None:
    """Two buses do at 40 us a transaction; one carries 300 scans/s at most. It is near the best for any program."""
    robot = Robot(distinct, COLUMNS, n_buses=n_buses, host_cost_ns=host_cost_us * 1000)
    best = scan_lower_bounds(
        n_legs=6 // n_buses,
        conversion_ns=CONVERSION_NS,
        bus_hz=400_000,
        host_cost_ns=host_cost_us * 1000,
        traffic=schedule.FDC1004_COLUMNS_TRAFFIC,
    )
    period_ns = robot.period_ns(18)
    assert 3 * CONVERSION_NS < period_ns < min(limit * 3 * CONVERSION_NS, 1.035 * best.scan_period_bound_ns)
    frame = robot.read()
    assert (frame.reading == Reading.OK).all()
    assert robot.is_right(frame).all()
    for bus in robot.buses:
        assert bus.bus_timing is not None
        assert math.isclose(
            bus.bus_timing.lower_bounds.scan_period_bound_ns, best.scan_period_bound_ns, rel_tol=1e-4
        )


@pytest.mark.parametrize("clock_error_rel", [-0.02, 0.0, 0.02, 0.1, 0.24])
def test_a_row_is_read_at_one_time_and_stamps_are_the_middle_of_each_conversion(
    clock_error_rel: float,
) -> None:
    """But for the triggers, one after the other; a capacitance that counts time is read as the time of its stamp."""
    robot = Robot(
        lambda element, t_ns: 4.0 + t_ns * 2**-30, COLUMNS, n_buses=3, clock_error_rel=clock_error_rel
    )
    frame = robot.read(3)
    assert (frame.reading == Reading.OK).all()
    atol = 2**-11 + 0.01 * CONVERSION_NS * 2**-30
    np.testing.assert_allclose(frame.capacitance_pf - 4.0, frame.t_ns * 2**-30, atol=atol)
    rows_ns = frame.t_ns[0].reshape(3, 3)
    assert (np.diff(rows_ns, axis=1) == START_NS).all()
    assert (np.diff(rows_ns[:, 0]) > CONVERSION_NS * (1 + max(clock_error_rel, 0.0))).all()


@pytest.mark.parametrize(
    ("trigger", "both", "keeps"), list(itertools.product((False, True), repeat=3)), ids=str
)
@pytest.mark.parametrize("odd", [None, 0, 2])
def test_any_kind_of_chip_is_read_rightly_also_if_one_column_has_another(
    odd: int | None, *, trigger: bool, both: bool, keeps: bool
) -> None:
    """What clears DONE is asked of each converter; the leg is read in the slower way of its three."""
    effects = Effects(trigger_clears_done=trigger, done_needs_both_reads=both, keeps_old_result=keeps)
    if odd is not None:
        effects = Effects(
            keeps_old_result=keeps,
            odd_column=OddColumn(
                column=odd, slower_rel=0.08, trigger_clears_done=trigger, done_needs_both_reads=both
            ),
        )
    robot = Robot(distinct, COLUMNS, n_buses=2, host_cost_ns=40_000, effects=effects)
    for _ in range(12):
        frame = robot.read()
        assert (frame.reading == Reading.OK).all()
        assert robot.is_right(frame).all()
    for leg in robot.scanner.legs:
        assert leg.timing.keeps_done_bit == (not trigger)
        assert leg.timing.reads_whole_result == both
        slow = [timing.wait_factor > 1.0 for timing in leg.timings]
        assert slow == [column == odd for column in range(3)]


def test_the_column_whose_converter_is_slow_is_named_once(caplog: pytest.LogCaptureFixture) -> None:
    odd = OddColumn(column=1, slower_rel=0.1)
    robot = Robot(distinct, COLUMNS, n_buses=3, effects=Effects(odd_column=odd))
    robot.read(3)
    slow = [text for text in caplog.messages if "longer than the slowest converter may" in text]
    assert len(slow) == 6
    assert all(", column 1: its conversions take up to 10 %" in text for text in slow)


def faults(at_s: float, until_s: float) -> dict[str, tuple[ChipFault, Reading, str]]:
    span: dict[str, Any] = {"leg": "rm", "at_s": at_s, "until_s": until_s}
    return {
        "silent 0": (scene_faults.ConverterSilent(**span, column=0), Reading.NO_ANSWER, "no answer at 0x50"),
        "silent 1": (scene_faults.ConverterSilent(**span, column=1), Reading.NO_ANSWER, "no answer at 0x51"),
        "collide": (
            scene_faults.ConvertersCollide(**span, column=2),
            Reading.NO_ANSWER,
            "no answer at 0x52: broken wire, no 3.3 V, or two converters at one address",
        ),
        "dead": (
            scene_faults.TranslatorDead(**span),
            Reading.NO_ANSWER,
            "no answer at 0x51: broken wire, no 3.3 V, or a dead address translator",
        ),
        "stuck": (scene_faults.StuckConverter(**span, column=2), Reading.NOT_READY, ""),
    }


@pytest.mark.parametrize("name", faults(0, 1))
def test_one_of_three_costs_its_leg_alone_and_is_named(name: str, caplog: pytest.LogCaptureFixture) -> None:
    """From its first step on no reading of the leg is wrong; the others keep all of theirs; it comes back."""
    caplog.set_level("INFO", "footsense.acquisition")
    fault, reading, why = faults(0.1, 0.8)[name]
    robot = Robot(distinct, COLUMNS, n_buses=2, host_cost_ns=40_000, faults=[(LEG, fault)])
    seen: set[int] = set()
    while robot.clock.now_ns() < 1_000_000_000:
        frame = robot.convert()
        robot.assert_honest(frame)
        assert (frame.reading[OTHERS] == Reading.OK).all()
        seen |= set(frame.reading[LEG].tolist())
    # Of two at one address the slower one may be asked first.
    assert {Reading.OK, reading} <= seen <= {Reading.OK, Reading.NOT_READY, reading}
    assert any(why in text for text in caplog.messages)
    while robot.clock.now_ns() < 6_000_000_000:
        frame = robot.read()
    assert (frame.reading == Reading.OK).all()
    assert robot.is_right(frame).all()


@pytest.mark.parametrize("column", [0, 1, 2])
@pytest.mark.parametrize("forgets", [False, True])
@pytest.mark.parametrize(("n_buses", "host_cost_us"), [(1, 0), (2, 100), (3, 0)])
def test_one_converter_that_was_reset_is_noticed_and_set_up_again(
    column: int, n_buses: int, host_cost_us: int, *, forgets: bool
) -> None:
    """Whenever its supply dips: it would then convert its first pin in every measurement, and says that it is done."""
    robot = Robot(
        distinct,
        COLUMNS,
        n_buses=n_buses,
        host_cost_ns=host_cost_us * 1000,
        effects=Effects(trigger_clears_done=forgets),
    )
    robot.read(2)
    for n in range(24):
        robot.converters_of_leg[LEG][column].brown_outs_ns = [robot.clock.now_ns() + n * 333_000]
        seen: set[int] = set()
        for _ in range(8):
            frame = robot.read()
            seen |= set(frame.reading[LEG].tolist())
            robot.assert_honest(frame)
            assert (frame.reading[OTHERS] == Reading.OK).all()
        assert seen & {Reading.MISCONFIGURED, Reading.NOT_READY}
        assert (frame.reading == Reading.OK).all()


@pytest.mark.slow
@pytest.mark.parametrize("error", [NackError("none"), I2cError("garbled")], ids=str)
def test_one_failed_transaction_never_makes_a_wrong_number(error: I2cError) -> None:
    """Whichever transaction of three scans fails."""
    n_failing = 0
    while n_failing < 3 * 90:
        robot = Robot(distinct, COLUMNS, n_buses=2)
        robot.read(2)
        robot.saboteurs[0].arm(only(n_failing, error))
        frame: CapFrame = robot.read()
        for _ in range(5):
            robot.assert_honest(frame)
            frame = robot.read()
        assert (frame.reading == Reading.OK).all()
        n_failing += 1
