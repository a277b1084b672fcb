"""The legs' gait on CAN, and what a client makes of it."""

from collections.abc import Iterator

import pytest

from firmware_interface.can.codes import GaitEventKind
from firmware_interface.can.gait import GAIT_EVENT, GAIT_EVENT_ID, GROUND_ID
from footsense.client import GaitEvents, Reports
from footsense.frames import LEGS, GaitEvent
from tests.support.can_robot import MS, NarrowWire, Robot
from tests.support.frames import gait_frame

TOUCHDOWN = GaitEvent(GaitEventKind.TOUCHDOWN, 0, 100 * MS, 0.0021)


@pytest.fixture
def robot(request: pytest.FixtureRequest) -> Iterator[Robot]:
    """A robot with one leg."""
    robot = Robot(request.node.nodeid)
    yield robot
    robot.close()


def test_an_event_is_sent_at_once_with_its_age(robot: Robot) -> None:
    """In the cycle in which it was noticed, before the forces; the client dates it back."""
    robot.publish(111 * MS, gait=gait_frame(111 * MS, events=(TOUCHDOWN,)))
    first, *_ = robot.heard()
    assert first.arbitration_id == GAIT_EVENT_ID + 1
    event = GaitEvents().feed(first.arbitration_id, bytes(first.data), 5000 * MS)
    assert event is not None
    assert (event.node, event.kind, event.t_ns, event.all_in_air) == (
        1,
        GaitEventKind.TOUCHDOWN,
        4989 * MS,
        False,
    )
    assert event.sigma_s == pytest.approx(0.0022)


def test_grounds_come_ten_times_a_second(robot: Robot) -> None:
    """However often a gait comes; a client knows the ground as long as it comes."""
    reports = Reports()
    for k in range(1, 401):
        robot.publish(k * 5 * MS, gait=gait_frame(k * 5 * MS))
    messages = robot.heard()
    assert sum(m.arbitration_id == GROUND_ID + 1 for m in messages) in {20, 21}
    for message in messages:
        reports.feed(message.arbitration_id, bytes(message.data), 0)
    leg = reports.leg(1, 300 * MS)
    assert leg.ground is not None
    assert leg.ground.normal == pytest.approx((0.28, 0.0, 0.96), abs=0.002)
    assert leg.ground[3:] == pytest.approx((0.05, 0.2, 0.012, 0.6))
    assert reports.leg(1, 301 * MS).ground is None


def test_an_event_that_the_channel_did_not_take_is_sent_later_and_once(
    request: pytest.FixtureRequest,
) -> None:
    """With its age at that time; the counter has no gap."""
    wire = NarrowWire()
    robot = Robot(request.node.nodeid, wire=wire)
    wire.taken.clear()
    wire.room = 0
    robot.publish(111 * MS, gait=gait_frame(111 * MS, events=(TOUCHDOWN,)))
    wire.room = 100
    for t_ms in (114, 117, 120):
        robot.publish(t_ms * MS)
    robot.publish(123 * MS, gait=gait_frame(123 * MS, events=(TOUCHDOWN._replace(kind=GaitEventKind.SLIP),)))
    events = [GAIT_EVENT.decode(*frame) for frame in wire.taken if frame[0] == GAIT_EVENT_ID + 1]
    assert [(event.counter, event.kind, event.age_ns) for event in events] == [
        (0, GaitEventKind.TOUCHDOWN, 14 * MS),
        (1, GaitEventKind.SLIP, 23 * MS),
    ]
    robot.close()


def test_a_client_takes_no_event_twice(robot: Robot) -> None:
    """A repeated frame is dropped, one with a wrong crc too, and a restarted service believed."""
    robot.publish(111 * MS, gait=gait_frame(111 * MS, events=(TOUCHDOWN,)))
    (message,) = robot.heard(GAIT_EVENT_ID)
    events, frame = GaitEvents(), (message.arbitration_id, bytes(message.data))
    assert events.feed(*frame, 0) is not None
    assert events.feed(*frame, 2 * MS) is None
    assert events.feed(frame[0], bytes(6), 3 * MS) is None
    assert events.feed(0x109, bytes(8), 3 * MS) is None
    assert events.feed(*frame, 2000 * MS) is not None


def test_all_feet_in_one_cycle_find_room_in_the_next(request: pytest.FixtureRequest) -> None:
    """Six touchdowns at once: four go with the first forces, two with the next cycle."""
    robot = Robot(request.node.nodeid, LEGS, every=4)
    events = tuple(TOUCHDOWN._replace(leg=leg) for leg in range(6))
    for t_ms in range(109, 140, 3):
        robot.publish(t_ms * MS, gait=gait_frame(t_ms * MS, 6, events=events) if t_ms == 121 else None)
    sent_ms = [round(m.timestamp * 1e3) for m in robot.heard(GAIT_EVENT_ID)]
    assert sent_ms == [121] * 4 + [124] * 2
    robot.close()
