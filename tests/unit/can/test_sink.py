"""What the sink sends, and when."""

import math
from collections import Counter
from datetime import date
from pathlib import Path
from typing import Any

import can
import numpy as np
import pytest

from firmware_interface.can.codes import (
    NODE_IDS,
    BaselineStatus,
    CalibrationKind,
    Cause,
    CommandKind,
    Flag,
    GaitEventKind,
    NmtState,
    Result,
    State,
)
from firmware_interface.can.crc8 import kind_and_node
from firmware_interface.can.force import FORCE, FORCE_ID, QUALITY, QUALITY_ID
from firmware_interface.can.gait import GAIT_EVENT_ID, GROUND_ID
from firmware_interface.can.reports import (
    BASELINE,
    BASELINE_ID,
    CALIBRATION,
    CALIBRATION_ID,
    FAULT,
    FAULT_ID,
    HEARTBEAT_ID,
    IDENTITY,
    IDENTITY_ID,
    PROTOCOL_VERSION,
    CalibrationFrame,
    decode_heartbeat,
    foot_type_hash,
)
from firmware_interface.wire_timing import can_bits_per_s, max_can_frame_bits
from footsense.frames import LEGS, BaselineDrift, Command, CommandResult, GaitEvent
from tests.support.can_robot import MS, NarrowWire, Robot
from tests.support.frames import gait_frame

PRESSED = CalibrationFrame(0, 0, CalibrationKind.PRESSED, 2159, math.nan, math.nan)
NONE = CalibrationFrame(0, 0, CalibrationKind.NONE, None, math.nan, math.nan)


def test_each_leg_sends_force_and_quality_with_one_counter(request: pytest.FixtureRequest) -> None:
    """Twelve frames a scan for six legs, each decodable, counting 0..14 and on; every scan begins with another."""
    robot = Robot(request.node.nodeid, LEGS)
    for scan in range(17):
        robot.publish(scan * 20 * MS + MS, age_ns=12_300_000)
        messages = robot.heard()
        assert not any(m.is_extended_id for m in messages)
        forces = [FORCE.decode(m.arbitration_id, bytes(m.data)) for m in messages[:12:2]]
        qualities = [QUALITY.decode(m.arbitration_id, bytes(m.data)) for m in messages[1:12:2]]
        nodes = [(scan + row + 1) % 6 + 1 for row in range(6)]
        assert [force.node for force in forces] == [quality.node for quality in qualities] == nodes
        assert {force.counter for force in forces} == {q.counter for q in qualities} == {scan % 15}
        assert forces[0].force_n == (0.5, 0.5, 0.5)
        assert (qualities[0].age_ns, qualities[0].sigma_n) == (12_300_000, (0.010375, 0.010375, 0.010375))
    robot.close()


def test_every_fourth_cycle_sends_forces_and_the_others_what_else_is_due(
    request: pytest.FixtureRequest,
) -> None:
    """The first one, then each fourth; the counter goes on by one, and heartbeats keep their time."""
    robot = Robot(request.node.nodeid, every=4)
    for t_ms in range(2, 202):
        robot.publish(t_ms * MS)
    messages = robot.heard()
    sent_ms = {
        can_id: [round(m.timestamp * 1e3) for m in messages if m.arbitration_id == can_id]
        for can_id in (0x109, 0x119, 0x149)
    }
    assert sent_ms == {0x109: list(range(2, 202, 4)), 0x119: list(range(2, 202, 4)), 0x149: [2, 200]}
    counters = [FORCE.decode(0x109, bytes(m.data)).counter for m in messages if m.arbitration_id == 0x109]
    assert counters == [n % 15 for n in range(50)]
    robot.close()


@pytest.mark.parametrize(
    "change", [{"state": State.STALE}, {"fault_mask": 4}, {"cause": Cause.DELAYED}, {"flags": 1}]
)
def test_a_change_is_sent_at_once(request: pytest.FixtureRequest, change: dict[str, Any]) -> None:
    """Whichever cycle it falls on; the fourth cycle after it is the next one without a change."""
    for at in range(1, 5):
        robot = Robot(f"{request.node.nodeid}{at}", every=4)
        for n in range(at):
            robot.publish(n * MS)
        robot.heard()
        for n in range(at, at + 6):
            robot.publish(n * MS, **change)
        assert [round(m.timestamp * 1e3) for m in robot.heard(0x108)] == [at, at + 4]
        robot.close()


def test_changes_in_every_cycle_are_sent_with_every_other(request: pytest.FixtureRequest) -> None:
    """What flickers must not fill the bus; the last change goes out all the same."""
    robot = Robot(request.node.nodeid, every=4)
    for n in range(20):
        robot.publish(n * MS, fault_mask=n)
    robot.publish(20 * MS, fault_mask=20)
    robot.publish(21 * MS, fault_mask=20)
    assert [round(m.timestamp * 1e3) for m in robot.heard(0x108)] == [0, *range(1, 22, 2)]
    robot.close()


def test_what_is_sent_fits_into_the_queue(request: pytest.FixtureRequest) -> None:
    """Of 16 frames some are there after a cycle: forces of a change wait for their room, with the reports of it."""
    robot = Robot(request.node.nodeid, LEGS, every=6)
    robot.heard()
    n_sent = []
    for n in range(5):
        robot.publish(round(1.9 * n * MS), cause=Cause.DELAYED if n else Cause.NONE)
        n_sent.append(len(robot.heard()))
    assert n_sent == [16, 4, 4, 12, 0]
    robot.close()


def test_heartbeats_come_at_5_hz_and_missed_ones_are_not_made_up_for(robot: Robot) -> None:
    """One each 200 ms by the clock; after a stall one, not a burst."""
    for t_ms in range(0, 1000, 20):
        robot.publish(t_ms * MS)
    assert len(robot.heard(0x148)) == 5
    robot.publish(5010 * MS)
    robot.publish(5190 * MS)
    robot.publish(5200 * MS)
    assert [m.timestamp for m in robot.heard(0x148)] == [5.01, 5.2]


def test_heartbeats_tell_waiting_and_stopped_legs(robot: Robot) -> None:
    """A leg whose chips give nothing or that has no baseline is pre-operational, a stopped one stopped."""
    waiting = {State.ABSENT, State.STARTING, State.CONVERTER_FAULT, State.NO_BASELINE, State.TARING}
    for number, state in enumerate(State):
        robot.publish(number * 200 * MS, state)
        (beat,) = robot.heard(0x148)
        assert decode_heartbeat(0x149, bytes(beat.data))[1] == (
            NmtState.PRE_OPERATIONAL
            if state in waiting
            else NmtState.STOPPED
            if state == State.STOPPED
            else NmtState.OPERATIONAL
        )


def test_a_change_is_reported_once(robot: Robot) -> None:
    """The first state, each new state, each new element mask and each new cause make one report."""
    for state, mask, cause in (
        (State.VALID, 0, Cause.NONE),
        (State.VALID, 0, Cause.NONE),
        (State.ELEMENT_FAULT, 4, Cause.ELEMENT_OPEN),
        (State.ELEMENT_FAULT, 6, Cause.ELEMENT_OPEN),
        (State.ELEMENT_FAULT, 6, Cause.COLUMN_OPEN),
    ):
        robot.publish(0, state, fault_mask=mask, cause=cause)
    reports = [FAULT.decode(0x101, bytes(m.data)) for m in robot.heard(0x100)]
    assert reports == [
        (1, 0, State.VALID, State.STOPPED, 0, Cause.NONE),
        (1, 1, State.ELEMENT_FAULT, State.VALID, 4, Cause.ELEMENT_OPEN),
        (1, 2, State.ELEMENT_FAULT, State.ELEMENT_FAULT, 6, Cause.ELEMENT_OPEN),
        (1, 3, State.ELEMENT_FAULT, State.ELEMENT_FAULT, 6, Cause.COLUMN_OPEN),
    ]


def test_a_fault_report_is_repeated_every_second(robot: Robot) -> None:
    """So that who came later knows it; a change that falls on that time is told once, as a change."""
    for t_ms in range(0, 4000, 20):
        cause = Cause.ELEMENT_OPEN if t_ms >= 2500 else Cause.NONE
        robot.publish(t_ms * MS, State.DEGRADED, fault_mask=4 if t_ms >= 2500 else 0, cause=cause)
    told = {round(m.timestamp * 1e3): FAULT.decode(0x101, bytes(m.data)) for m in robot.heard(0x100)}
    assert list(told) == [0, 1500, 2500, 3500]
    assert [fault.counter for fault in told.values()] == [0, 1, 2, 3]
    assert told[3500][2:] == (State.DEGRADED, State.DEGRADED, 4, Cause.ELEMENT_OPEN)


def test_calibrations_are_told_every_second(request: pytest.FixtureRequest) -> None:
    """Each leg's own; expected errors are not known yet."""
    robot = Robot(request.node.nodeid, ("lf", "rr"), calibrations=(PRESSED, NONE))
    for t_ms in range(0, 2000, 20):
        robot.publish(t_ms * MS)
    told = [CALIBRATION.decode(m.arbitration_id, bytes(m.data)) for m in robot.heard(CALIBRATION_ID)]
    assert [(one.node, one.counter, one.kind) for one in told] == [
        (node, n, kind)
        for n in range(2)
        for node, kind in ((1, CalibrationKind.PRESSED), (6, CalibrationKind.NONE))
    ]
    assert (told[0].date, told[1].date) == (date(2025, 11, 29), None)
    assert math.isnan(told[0].size_error_percent)
    robot.close()


def test_six_legs_load_the_bus_by_less_than_40_percent() -> None:
    """Every frame that is sent in a second, with its worst stuff bits: 92 forces, two steps with a slip of each leg."""
    wire = NarrowWire()
    robot = Robot("load", LEGS, wire=wire, every=4)
    kinds = (GaitEventKind.TOUCHDOWN, GaitEventKind.SLIP, GaitEventKind.SLIP_END, GaitEventKind.LIFT_OFF)
    for second in range(2):
        wire.taken.clear()
        for n in range(368):
            t_ns = round((second + n / 368) * 1000 * MS)
            event = GaitEvent(kinds[n // 7 % 4], n // 28 % 6, t_ns, 0.002)
            events = (event,) if n % 7 == 0 and n < 336 else ()
            robot.publish(t_ns, gait=gait_frame(t_ns, 6, events=events) if events or n % 37 == 0 else None)
    robot.sink.close()
    sent = Counter(kind_and_node(can_id)[0] for can_id, _ in wire.taken[:-6])
    assert sent[FORCE_ID] == sent[QUALITY_ID] == 6 * 92
    assert (sent[GAIT_EVENT_ID], sent[GROUND_ID], sent[HEARTBEAT_ID]) == (48, 60, 30)
    once = (FAULT_ID, BASELINE_ID, IDENTITY_ID, CALIBRATION_ID)
    assert [sent[kind] for kind in once] == [6] * 4
    bits = sum(max_can_frame_bits(len(data)) for _, data in wire.taken[:-6])
    assert bits == can_bits_per_s(6, 92.0) == 167_610
    assert bits <= 0.4 * 500_000
    robot.close()


def test_what_does_not_fit_beside_the_forces_waits_for_the_next_scan(request: pytest.FixtureRequest) -> None:
    """Four frames beside those of the forces: reports first, then heartbeats and baselines."""
    robot = Robot(request.node.nodeid, LEGS)
    kinds = []
    for scan in range(4):
        robot.publish(scan * 20 * MS)
        kinds.append([kind_and_node(m.arbitration_id)[0] for m in robot.heard()][12:])
    assert kinds == [[0x100] * 4, [0x100] * 2 + [0x148, 0x128], [0x148], []]
    robot.close()


def test_forces_that_fill_the_bus_leave_room_for_heartbeats(request: pytest.FixtureRequest) -> None:
    """Twelve frames a millisecond are three times what the bus carries; each leg is heard of five times a second."""
    wire = NarrowWire()
    robot = Robot(request.node.nodeid, LEGS, wire=wire)
    for t_ms in range(1000):
        robot.publish(t_ms * MS)
    robot.close()
    told = [can_id - 0x148 for can_id, _ in wire.taken if can_id - 0x148 in NODE_IDS.values()]
    assert [told.count(NODE_IDS[leg]) for leg in LEGS] == [7] * 6  # with those of start and end


@pytest.mark.parametrize("room", range(19))
def test_each_fault_report_goes_out_once_whatever_part_of_a_scan_is_taken(
    request: pytest.FixtureRequest, room: int
) -> None:
    """A report counts as sent only if the interface took it; the others follow, and none comes twice."""
    wire = NarrowWire()
    robot = Robot(request.node.nodeid, LEGS, wire=wire)
    for scan in range(5):
        wire.room = room if scan == 0 else 100
        robot.publish(scan * 20 * MS)
    robot.close()
    reported = sorted(can_id for can_id, _ in wire.taken if can_id - 0x100 in NODE_IDS.values())
    assert reported == [0x100 + NODE_IDS[leg] for leg in LEGS]


def test_each_leg_boots_before_anything_else(request: pytest.FixtureRequest) -> None:
    """The first frames of all are heartbeats that say so, and what a consumer needs to read the forces."""
    wire = NarrowWire()
    robot = Robot(request.node.nodeid, LEGS, wire=wire)
    robot.close()
    assert wire.taken[:6] == [(0x148 + node, bytes([NmtState.BOOT])) for node in range(1, 7)]
    assert [can_id for can_id, _ in wire.taken[6:]][:6] == [IDENTITY_ID + node for node in range(1, 7)]


def test_the_tares_of_a_start_are_told_a_few_a_scan(request: pytest.FixtureRequest) -> None:
    """Six that nobody asked for: no more than four frames beside those of the forces, and each once."""
    robot = Robot(request.node.nodeid, LEGS)
    for scan in range(20):
        robot.publish(scan * 20 * MS)
    robot.heard()
    for row in range(6):
        robot.sink.answer(CommandResult(Command(CommandKind.TARE, row), Result.DONE, ""))
    told = []
    for scan in range(20, 24):
        robot.publish(scan * 20 * MS)
        events = robot.heard()[12:]
        assert len(events) <= 4
        told += [m.arbitration_id for m in events if kind_and_node(m.arbitration_id)[0] == 0x140]
    assert sorted(told) == [0x140 + node for node in range(1, 7)]
    robot.close()


def test_the_baseline_is_sent_once_a_second(robot: Robot) -> None:
    """Where it stands, and how long ago it moved; of a leg without one, that there is none."""
    robot.publish(0)
    row = np.ones(1)
    baseline = BaselineDrift(
        (row * BaselineStatus.HELD).astype(np.uint8), row * 0.01, row * -0.02, np.array([500 * MS])
    )
    for t_ms in range(20, 2000, 20):
        robot.publish(t_ms * MS, baseline=baseline)
    none, held = (BASELINE.decode(0x129, bytes(m.data)) for m in robot.heard(0x128))
    assert (none.counter, none.status, none.age_ns) == (0, BaselineStatus.NONE, None)
    assert (held.counter, held.status, held.mean_pf, held.worst_pf) == (1, BaselineStatus.HELD, 0.01, -0.02)
    assert held.age_ns == 500 * MS


def test_each_leg_tells_every_second_how_its_forces_are_read(request: pytest.FixtureRequest) -> None:
    """Before the first force and then once a second, spread over it: version, force step, foot type."""
    robot = Robot(request.node.nodeid, LEGS, step_mn=10)
    for t_ms in range(0, 3000, 10):
        robot.publish(t_ms * MS)
    heard = robot.heard(IDENTITY_ID)
    told = [IDENTITY.decode(m.arbitration_id, bytes(m.data)) for m in [*robot.boot[6:], *heard]]
    content = PROTOCOL_VERSION, 10, foot_type_hash("aoyagi-3x3")
    assert {identity[2:] for identity in told} == {content}
    assert sorted((identity.node, identity.counter) for identity in told) == [
        (node, n) for node in range(1, 7) for n in range(4 if node < 6 else 3)
    ]
    assert len({m.timestamp for m in heard}) == len(heard)
    robot.close()


def test_an_interface_that_is_gone_is_tried_at_growing_intervals(
    request: pytest.FixtureRequest, caplog: pytest.LogCaptureFixture
) -> None:
    """50, 100, 200 ms, then every 250 ms; back, it says for how long it was away, each time."""
    wire = NarrowWire()
    robot = Robot(request.node.nodeid, wire=wire)
    for outage in range(2):
        begin_ns = outage * 2_000 * MS
        robot.publish(begin_ns)
        wire.opened_ns.clear()
        wire.gone = True
        for t_ms in range(10, 900, 10):
            robot.publish(begin_ns + t_ms * MS)
        assert [(t_ns - begin_ns) // MS for t_ns in wire.opened_ns] == [60, 160, 360, 610, 860]
        wire.gone = False
        robot.publish(begin_ns + 1200 * MS)
        assert robot.sink.stats.reopened == outage + 1
    robot.close()
    lines = [record.getMessage() for record in caplog.records]
    assert all(line.endswith("; no frame goes out until it is back") for line in lines[::2])
    assert lines[1::2] == [f"CAN channel {request.node.nodeid} (virtual) is back after 1.2 s"] * 2


def test_a_full_channel_drops_frames_and_the_consumer_sees_the_gap(
    request: pytest.FixtureRequest, tmp_path: Path
) -> None:
    """What does not go out is counted, is not in the log, and never comes later."""
    slow = can.Bus(interface="virtual", channel=request.node.nodeid, rx_queue_size=5)
    log_file = tmp_path / "sent.log"
    robot = Robot(
        request.node.nodeid, log_file=log_file
    )  # boot heartbeat and identity are the first of the five
    robot.publish(0)  # Force, Quality, a fault report; a heartbeat and a baseline find no room
    robot.publish(MS)
    assert (robot.sink.stats.sent, robot.sink.stats.dropped) == (5, 4)
    while slow.recv(timeout=0):
        pass
    robot.publish(2 * MS)
    arrived = slow.recv(timeout=0)
    assert arrived is not None
    assert FORCE.decode(0x109, bytes(arrived.data)).counter == 2
    slow.shutdown()
    robot.close()
    counters = [
        int(line.split("#")[1][3], 16) for line in log_file.read_text().splitlines() if " 109#" in line
    ]
    assert counters == [0, 2]


def test_closing_says_stopped_for_every_leg_and_twice_is_once(request: pytest.FixtureRequest) -> None:
    """The last thing that a consumer hears of each leg is `stopped`, with degraded timing as the forces had it."""
    robot = Robot(request.node.nodeid, ("lf", "rr"))
    robot.publish(0, flags=Flag.DEGRADED_TIMING)
    robot.sink.close()
    robot.sink.close()
    beats = [decode_heartbeat(m.arbitration_id, bytes(m.data)) for m in robot.heard(0x148)]
    assert beats == [
        (1, NmtState.OPERATIONAL, True),
        (1, NmtState.STOPPED, True),
        (6, NmtState.STOPPED, True),
    ]
    robot.consumer.shutdown()
