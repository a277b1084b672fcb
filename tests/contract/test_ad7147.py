"""Board `ad7147` as its bus and a user see it: whatever host or wires do, a reading is right or none."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_interface.chips import ad7147 as chip
from firmware_interface.chips.ad7147 import Ad7147Register
from footsense.acquisition.scan_plan import AD7147_PLAN
from footsense.errors import I2cError, I2cTimeoutError, NackError
from footsense.frames import ELEMENTS, Reading
from footsense.ports import Transaction
from footsense.sim.faults import scene_faults
from footsense.sim.faults.scene_faults import ChipFault, StuckSda
from footsense.sim.scene import Ad7147Effects
from tests.contract.ad7147_robot import (
    ADDRESSES,
    CHANNELS,
    MCU,
    MS_NS,
    N_LEGS,
    ONE_MUX,
    S_NS,
    Robot,
    Wiring,
    true_pf,
    wirings,
    with_mux,
    without_mux,
)
from tests.contract.boards import TIMEOUT_NS, LateError


class Outage(NamedTuple):
    """What a leg had for how long.

    Attributes:
        seen: Readings other than OK.
        shown_ns: Time until the first of them [ns].
        over_ns: Time until the last of them [ns].
    """

    seen: set[Reading]
    shown_ns: int
    over_ns: int


def outage(
    robot: Robot, s: float, *, bad: tuple[int, ...] = (3,), pause_ms: float = 25.0, loses_count: bool = False
) -> Outage:
    """Return what legs had for some time, in the end all OK; the others have a new reading within a pause."""
    start_ns = robot.clock.now_ns()
    seen: set[Reading] = set()
    shown_ns = over_ns = 0
    newest_ns = np.full(N_LEGS, start_ns)
    for now_ns, reading, t_ns in robot.read_for(s):
        others = [leg for leg in range(N_LEGS) if leg not in bad]
        assert np.isin(reading[others], (Reading.OK, Reading.NOT_READY) if loses_count else Reading.OK).all()
        newest_ns = np.maximum(newest_ns, t_ns.max(axis=1))
        assert (now_ns - newest_ns[others]).max() < pause_ms * MS_NS
        missing = {Reading(each) for each in reading[list(bad)].ravel().tolist()} - {Reading.OK}
        if missing:
            shown_ns, over_ns = shown_ns or now_ns - start_ns, now_ns - start_ns
        seen |= missing
    assert (reading == Reading.OK).all()
    return Outage(seen, shown_ns, over_ns)


@wirings
@pytest.mark.parametrize("lasts_ms", [30, 200])
def test_a_leg_that_is_gone_is_found_again(wiring: Wiring, lasts_ms: int) -> None:
    """A cable that breaks for 30 ms costs as much; after a longer time the leg is tried in turn.

    A microcontroller says that it sets the leg up meanwhile.
    """
    robot = Robot(wiring)
    robot.read()
    now_ns = robot.clock.now_ns()
    robot.chips[3].absent_ns = [(now_ns, now_ns + lasts_ms * MS_NS)]
    seen = outage(robot, 1.5)
    set_up = {Reading.NOT_READY} if wiring.on_mcu else set()
    assert {Reading.NO_ANSWER} <= seen.seen <= {Reading.NO_ANSWER} | set_up
    assert seen.shown_ns < 10 * MS_NS
    assert seen.over_ns < (55 if lasts_ms == 30 else 450) * MS_NS


def test_a_leg_that_was_not_read_for_a_while_does_not_count_as_not_converting() -> None:
    robot = Robot()
    robot.read()
    now_ns = robot.clock.now_ns()
    robot.chips[3].absent_ns = [(now_ns, now_ns + 45 * MS_NS)]
    assert outage(robot, 0.2).seen == {Reading.NO_ANSWER}


@wirings
def test_another_chip_in_the_place_of_one_is_measured_anew(wiring: Wiring) -> None:
    """Its gain and its steps of the offset are its own."""
    robot = Robot(wiring)
    robot.read()
    now_ns, swapped = robot.clock.now_ns(), robot.chips[3]
    swapped.absent_ns = [(now_ns, now_ns + 150 * MS_NS)]
    swapped.brown_outs_ns = [now_ns + 150 * MS_NS]
    robot.read_for(0.1)
    swapped._codes_per_pf, swapped._offset_step_pf, swapped.clock_factor = 3400.0, 0.37, 0.97
    assert outage(robot, 1.0).seen <= {Reading.NO_ANSWER, Reading.NOT_READY}


@wirings
@pytest.mark.parametrize("after_us", [0, 900, 2500])
def test_a_chip_that_was_reset_is_started_again(wiring: Wiring, after_us: int) -> None:
    """Its status does not fit: that costs three scans, and no other leg anything."""
    robot = Robot(wiring, Ad7147Effects(noise_ff=1.0, junk_sequences=2, calibration_moves_results=True))
    robot.read()
    robot.chips[3].brown_outs_ns = [robot.clock.now_ns() + 1000 * after_us]
    seen = outage(robot, 0.4)
    assert seen.seen <= {Reading.MISCONFIGURED, Reading.UNDER_RANGE, Reading.NOT_READY}
    assert Reading.MISCONFIGURED in seen.seen
    assert seen.shown_ns < 16 * MS_NS
    assert seen.over_ns - seen.shown_ns < 80 * MS_NS


@wirings
def test_a_sequence_that_hangs_is_ended_by_a_reset(wiring: Wiring) -> None:
    """It holds its settings and converts nothing."""
    robot = Robot(wiring)
    robot.read()
    robot.chips[3].hangs_ns = [robot.clock.now_ns()]
    seen = outage(robot, 1.0)
    assert seen.seen == {Reading.NOT_READY}
    assert seen.shown_ns < 40 * MS_NS
    assert seen.over_ns < 450 * MS_NS


@without_mux
def test_a_chip_that_does_not_convert_is_left_out_until_it_does(wiring: Wiring) -> None:
    robot = Robot(wiring)
    robot.read()
    now_ns = robot.clock.now_ns()
    robot.chips[3].stuck_ns = [(now_ns, now_ns + S_NS)]
    seen = outage(robot, 4.0)
    assert seen.seen == {Reading.NOT_READY}
    assert seen.over_ns < 3 * S_NS


@without_mux
@pytest.mark.parametrize(
    ("register", "word"),
    [
        (chip.stage_register(0), 0x1234),
        (chip.stage_register(8) + 2, 0x1234),
        (Ad7147Register.PWR_CONTROL, chip.power_control(5, 64)),
        (Ad7147Register.PWR_CONTROL, 1),
        (Ad7147Register.STAGE_CAL_EN, 0x0FFF),
    ],
)
def test_a_setting_that_has_changed_is_found_and_set_again(wiring: Wiring, register: int, word: int) -> None:
    """Each block of registers is read back in its turn, all of them within ten scans of each leg of the bus."""
    robot = Robot(wiring, Ad7147Effects(noise_ff=0.0, calibration_moves_results=True))
    robot.read()
    robot.chips[3].write(chip.write_bytes(register, word), robot.clock.now_ns())
    until_ns = robot.clock.now_ns() + 32 * AD7147_PLAN.scan_ns
    seen = set()
    while robot.clock.now_ns() < until_ns:
        frame = robot.scanner.read()  # until then its readings may be wrong
        seen |= set(frame.reading[3].tolist())
        assert (np.delete(frame.reading, 3, axis=0) == Reading.OK).all()
        robot.clock.now_ns()
    assert Reading.MISCONFIGURED in seen
    assert (robot.read_for(0.1)[-1][1] == Reading.OK).all()


def _in_span(kind: Callable[..., ChipFault], **values: float) -> ChipFault:
    return kind(leg="lf", at_s=0.3, until_s=0.8, **values)


@wirings
def test_another_kind_of_chip_is_told_by_its_identity(
    wiring: Wiring, caplog: pytest.LogCaptureFixture
) -> None:
    """Its set-up is tried ten times, each of which delays the others of its bus by 4 ms."""
    robot = Robot(wiring, faults=[_in_span(scene_faults.WrongChip)])
    seen = outage(robot, 2.5, pause_ms=40.0, loses_count=True)
    assert Reading.WRONG_CHIP in seen.seen
    assert wiring.on_mcu or "such as a potentiometer" in caplog.text
    assert seen.over_ns < 1.8 * S_NS


@wirings
@pytest.mark.parametrize("rate_rel", [0.02, 0.3])
def test_acknowledges_that_are_lost_cost_no_right_reading(wiring: Wiring, rate_rel: float) -> None:
    robot = Robot(wiring, faults=[_in_span(scene_faults.NackAtRandom, rate_rel=rate_rel)])
    seen = outage(robot, 3.0)
    assert seen.seen <= {Reading.NO_ANSWER, Reading.MISCONFIGURED, Reading.NOT_READY}
    if rate_rel < 0.1:
        assert seen.over_ns < 0.85 * S_NS


@without_mux
def test_reads_with_a_wrong_bit_leave_one_wrong_reading_at_most(wiring: Wiring) -> None:
    """Nothing tells which bit of a result is wrong; its stamp and the other elements are right."""
    robot = Robot(wiring, faults=[_in_span(scene_faults.CorruptReads, rate_rel=0.05)])
    n_wrong = n = 0
    while robot.clock.now_ns() < 1.5 * S_NS:
        frame = robot.scanner.read()
        robot.clock.now_ns()
        right_pf = true_pf(np.arange(N_LEGS)[:, None], np.arange(ELEMENTS), frame.t_ns)
        wrong = np.abs(frame.capacitance_pf - right_pf) > 0.006
        n_wrong, n = n_wrong + int(wrong.sum()), n + 1
        assert wrong.sum() <= 3
        assert not np.delete(wrong, 3, axis=0).any()
        assert (np.delete(frame.reading, 3, axis=0) == Reading.OK).all()
    assert n_wrong < 0.2 * n
    assert (frame.reading == Reading.OK).all()


@with_mux
def test_a_leg_that_holds_sda_low_behind_a_mux_costs_the_others_two_timeouts(wiring: Wiring) -> None:
    robot = Robot(wiring, wire_faults=[StuckSda(leg="lf", at_s=0.3, until_s=0.8)])
    seen = outage(robot, 4.5, pause_ms=5 * TIMEOUT_NS / MS_NS, loses_count=True)
    assert Reading.BUS_STUCK in seen.seen <= {Reading.BUS_STUCK, Reading.NOT_READY}


@without_mux
def test_legs_without_a_mux_are_stuck_together_and_come_back(wiring: Wiring) -> None:
    """Those of another bus have every reading."""
    robot = Robot(wiring, wire_faults=[StuckSda(leg="lf", at_s=0.3, until_s=0.8)])
    bad, pause_ms = ((3,), 15.0) if wiring.on_mcu else ((3, 4, 5), 3 * TIMEOUT_NS / MS_NS)
    seen = outage(robot, 2.5, bad=bad, pause_ms=pause_ms)
    assert Reading.BUS_STUCK in seen.seen <= {Reading.BUS_STUCK, Reading.NOT_READY}
    assert seen.over_ns < 1.7 * S_NS


def test_of_two_chips_at_one_address_no_reading_is_ok(caplog: pytest.LogCaptureFixture) -> None:
    """The other address does not answer, which is said with its usual cause."""
    robot = Robot(straps={4: chip.ADDRESSES[0]})
    for _, reading, _ in robot.read_for(2.0):
        assert (reading[[0, 1, 2, 5]] == Reading.OK).all()
        assert (reading[4] == Reading.NO_ANSWER).all()
        assert (reading[3] != Reading.OK).all()
    assert "leg leg 4: no answer at 0x2d: broken wire, no supply, or other straps ADD0, ADD1" in caplog.text


def test_a_strap_that_is_not_as_the_firmware_wants_it_has_its_line(caplog: pytest.LogCaptureFixture) -> None:
    """Each leg has a bus of its own: no other one is touched."""
    robot = Robot(MCU, straps={4: chip.ADDRESSES[1]})
    for _, reading, _ in robot.read_for(2.0)[30:]:
        assert (np.delete(reading, 4, axis=0) == Reading.OK).all()
        assert (reading[4] == Reading.NO_ANSWER).all()
    lines = [record.message for record in caplog.records if record.levelname == "WARNING"]
    line = "leg rm, by its microcontroller: its chips do not answer; check its plug, its supply, its address straps, "
    assert lines == [line + "and whether this is its channel"]


@with_mux
@pytest.mark.parametrize("after_us", [0, 1900])
def test_a_mux_that_keeps_its_channels_is_noticed(
    wiring: Wiring, after_us: int, caplog: pytest.LogCaptureFixture
) -> None:
    """Within two scans of its bus; then only the leg that it does connect may have readings."""
    robot = Robot(wiring)
    robot.read()
    now_ns = robot.clock.now_ns() + 1000 * after_us
    robot.muxes[-1].keeps_channels_ns = [(now_ns, now_ns + S_NS)]
    behind = range(N_LEGS - N_LEGS // wiring.n_buses, N_LEGS)
    while robot.clock.now_ns() < now_ns + 0.95 * S_NS:
        frame = robot.scanner.read()
        robot.clock.now_ns()
        if robot.clock.now_ns() > now_ns + 3 * 9 * MS_NS:
            ok = (frame.reading == Reading.OK).any(axis=1)
            assert ok[list(behind)].sum() <= 1
            assert ok[: behind[0]].all()
            right_pf = true_pf(np.arange(N_LEGS)[:, None], np.arange(ELEMENTS), frame.t_ns)
            assert not (np.abs(frame.capacitance_pf - right_pf) > 0.006).any()
    assert "its multiplexer acknowledges other channels than it connects" in caplog.text
    assert (robot.read_for(5.0)[-1][1] == Reading.OK).all()


TROUBLES = st.lists(
    st.tuples(
        st.integers(0, 600),  # transaction at which it begins
        st.integers(1, 60),  # transactions that it lasts
        st.sampled_from(
            [NackError("no acknowledge"), I2cError("garbled"), I2cTimeoutError("held low"), LateError("late")]
        ),
    ),
    max_size=5,
)
CHIP_FAULTS = st.lists(
    st.tuples(
        st.sampled_from(["absent", "brown_out", "stuck", "hang"]), st.integers(0, 5), st.floats(0.01, 0.15)
    ),
    max_size=4,
)


@given(st.sampled_from((ADDRESSES, CHANNELS, ONE_MUX, MCU)), TROUBLES, CHIP_FAULTS, st.booleans())
@settings(max_examples=6)
def test_whatever_fails_a_reading_is_right_or_missing(
    wiring: Wiring,
    troubles: list[tuple[int, int, I2cError]],
    chip_faults: list[tuple[str, int, float]],
    from_start: bool,  # noqa: FBT001 - drawn
) -> None:
    """Random failures of bus and chips, as legs are set up and later: no wrong number, and all is well in the end."""
    robot = Robot(wiring, Ad7147Effects(noise_ff=1.0, junk_sequences=2, torn_words=True))

    def fails(transaction: Transaction, n: int) -> I2cError | None:
        del transaction
        return next((error for begin, length, error in troubles if begin <= n < begin + length), None)

    if not from_start:
        robot.read_for(0.1)
    robot.hosts[-1].arm(fails)
    for kind, leg, at_s in chip_faults:
        at_ns = robot.clock.now_ns() + round(at_s * S_NS)
        hit = robot.chips[leg]
        if kind == "absent":
            hit.absent_ns.append((at_ns, at_ns + 30 * MS_NS))
        elif kind == "brown_out":
            hit.brown_outs_ns.append(at_ns)
        elif kind == "stuck":
            hit.stuck_ns.append((at_ns, at_ns + 60 * MS_NS))
        else:
            hit.hangs_ns.append(at_ns)
    robot.read_for(0.3)
    robot.hosts[-1].arm(lambda transaction, n: None)
    until_ns = robot.clock.now_ns() + 6 * S_NS
    while (robot.read().reading != Reading.OK).any():
        assert robot.clock.now_ns() < until_ns


def test_elements_below_the_range_of_a_chip_are_given_another_one() -> None:
    """Those of leg 3 read 1.5 pF less than designed: from 2.5 pF on, the range as designed begins at 2.6."""
    robot = Robot()
    robot.legs[3] = -115
    robot.read_for(1.2)
    assert all((reading == Reading.OK).all() for _, reading, _ in robot.read_for(2.0))
