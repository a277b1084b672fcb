"""What is received from CAN becomes messages of ROS 2 as it is, each once."""

import math
from typing import Any

import pytest

from firmware_interface.can.codes import BaselineStatus, Cause, Flag, GaitEventKind, NmtState, State
from firmware_interface.can.gait import Ground
from firmware_interface.can.reports import Baseline, Fault, Heartbeat
from footsense.client import LegEvent, LegForce, LegReport, LinkStatus
from footsense.client.listener import LegSnapshot
from footsense.frames import ALL_LEGS
from footsense.ros2.live import LiveSamples
from footsense.ros2.messages import LegTopics
from footsense.ros2.store import LOW_STATE, STORE

NAN = math.nan
WALL_NS = 1_700_000_000_000_000_000
_REPORT = LegReport(
    fault=Fault(1, 0, State.VALID, State.TARING, 0, Cause.NONE),
    baseline=Baseline(1, 0, BaselineStatus.TRACKING, 0.0, 0.0, 0),
    heartbeat=Heartbeat(1, NmtState.OPERATIONAL, False),
    ground=Ground(1, 0, (0.0, 0.6, 0.8), 0.01, 0.3, 0.01, 0.7),
)
_FORCE = LegForce(
    *(LinkStatus.OK, True, State.VALID, Flag.CONTACT, 0, (0.25, -0.5, 1.0), (0.01, 0.01, 0.02), 4_000_000),
    *(0.98, 0.25),
)
_NO_FORCE = LegForce(LinkStatus.OK, False, State.SATURATED, Flag(0), 0, (NAN,) * 3, (NAN,) * 3, None)


def messages_of(snapshot: LegSnapshot, *events: LegEvent) -> dict[str, Any]:
    """Return the first messages of a leg by the last word of their topic, decoded; the present is 20 ms."""
    topics = LegTopics(["lf"])
    samples = LiveSamples().samples([snapshot], events, WALL_NS, 20_000_000)
    return {
        topic.rpartition("/")[2]: STORE.deserialize_cdr(cdr, topics.types[topic])
        for topic, cdr in topics.due_messages(samples, WALL_NS)
    }


def test_a_usable_force_has_the_time_of_its_measurement() -> None:
    """The age that CAN tells is taken off the time of the wall clock."""
    messages = messages_of(LegSnapshot("lf", _FORCE, _REPORT, 7))
    stamp, force = messages["wrench"].header.stamp, messages["wrench"].wrench.force
    assert stamp.sec * 10**9 + stamp.nanosec == WALL_NS - 4_000_000
    assert (force.x, force.y, force.z) == (0.25, -0.5, 1.0)
    sigma = messages["sigma"].vector
    assert (sigma.x, sigma.y, sigma.z) == (0.01, 0.01, 0.02)
    assert messages["sigma"].header == messages["wrench"].header
    assert (messages["contact_probability"].data, messages["holds"].data) == (0.98, 0.25)
    contact = messages["contact"]
    assert (contact.status, contact.surface_normal.z, contact.friction_coefficient) == (3, 0.8, 0.7)


@pytest.mark.parametrize(
    ("snapshot", "level"),
    [
        (LegSnapshot("lf", _NO_FORCE, _REPORT, 7), 2),
        (LegSnapshot("lf", _FORCE, _REPORT, 0), 3),
    ],
    ids=["saturated", "silent"],
)
def test_what_is_not_known_is_no_number(snapshot: LegSnapshot, level: int) -> None:
    """A leg without a force has no wrench and no sigma; its contact is unknown, its health says why."""
    messages = messages_of(snapshot)
    assert messages.keys() == {"contact", "diagnostics"}
    contact = messages["contact"]
    assert contact.status == 0
    assert math.isnan(contact.wrench.force.z)
    assert math.isnan(contact.wrench.torque.z)
    assert messages["diagnostics"].status[0].level == level


def test_each_force_is_published_once_and_each_change_at_once() -> None:
    """The wrench comes with a new frame, the contact with an event or every 100 ms, the health with a change."""
    topics, live = LegTopics(["lf"]), LiveSamples()
    event = LegEvent(1, GaitEventKind.TOUCHDOWN, 0, 0.001, False)

    def due(t_ms: int, n_frames: int, force: LegForce = _FORCE, *events: LegEvent) -> list[str]:
        snapshot, t_ns = LegSnapshot("lf", force, _REPORT, n_frames), t_ms * 1_000_000
        samples = live.samples([snapshot], events, WALL_NS + t_ns, t_ns)
        return [topic.rpartition("/")[2] for topic, _ in topics.due_messages(samples, WALL_NS + t_ns)]

    with_force = ["wrench", "sigma", "contact_probability", "holds"]
    assert due(0, 1) == [*with_force, "contact", "diagnostics"]
    assert due(5, 1) == []
    assert due(10, 2) == with_force
    assert due(15, 2, _FORCE, event) == ["contact", "touchdown"]
    assert due(100, 3) == [*with_force, "contact"]
    assert due(105, 4, _NO_FORCE) == ["diagnostics"]
    assert due(1105, 4, _NO_FORCE) == ["contact", "diagnostics"]


def test_each_event_has_the_time_at_which_it_happened() -> None:
    """Two of a leg within one reading of CAN are both there; a time that is not known is 0, as in ROS."""
    ends = LegEvent(1, GaitEventKind.SLIP_END, 8_000_000, 0.001, False)
    lifts = LegEvent(1, GaitEventKind.LIFT_OFF, None, math.nan, False)
    other = LegEvent(2, GaitEventKind.TOUCHDOWN, 8_000_000, 0.001, False)
    messages = messages_of(LegSnapshot("lf", _FORCE, _REPORT, 7), ends, lifts, other)
    times_ns = {
        name: header.stamp.sec * 10**9 + header.stamp.nanosec
        for name, header in messages.items()
        if name in ("touchdown", "slip_end", "lift_off")
    }
    assert times_ns == {"slip_end": WALL_NS - 12_000_000, "lift_off": 0}
    assert messages["slip_end"].frame_id == "lf_foot"


def test_four_feet_are_a_low_state_of_unitree() -> None:
    """Loads along the legs in N, in the order FR, FL, RR, RL; a foot without a force is one in the air."""
    topics, live = LegTopics(["lf", "lr", "rf", "rr"]), LiveSamples()
    loads_n = {"lf": 31.6, "lr": 0.4, "rf": -0.7, "rr": None}
    snapshots = [
        LegSnapshot(leg, _NO_FORCE if n is None else _FORCE._replace(force_n=(9.0, 9.0, n)), _REPORT, 1)
        for leg, n in loads_n.items()
    ]
    due = dict(topics.due_messages(live.samples(snapshots, [], WALL_NS, 0), WALL_NS))
    state: Any = STORE.deserialize_cdr(due["/footsense/lowstate"], LOW_STATE)
    assert state.foot_force.tolist() == state.foot_force_est.tolist() == [-1, 32, 0, 0]
    assert math.isnan(state.imu_state.accelerometer[2])
    assert math.isnan(state.motor_state[11].q)
    assert "/footsense/lowstate" not in dict(
        topics.due_messages(live.samples(snapshots, [], WALL_NS, 5), WALL_NS)
    )
    assert "/footsense/lowstate" not in LegTopics(ALL_LEGS).types
