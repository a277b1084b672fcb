"""Forces on CAN reach a DDS participant of ROS 2's names and types as they are."""

import json
import math
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from firmware_interface.can.codes import BaselineStatus, Cause, Flag, GaitEventKind, NmtState, State
from firmware_interface.can.gait import Ground
from firmware_interface.can.reports import Baseline, Fault, Heartbeat
from footsense.cli import main
from footsense.client import LegEvent, LegForce, LegReport, LinkStatus
from footsense.client.listener import LegSnapshot
from footsense.ros2.messages import STORE, LegTopics

pytest.importorskip("cyclonedds", reason="cyclonedds has no wheel for this processor or Python: docs/ros2.md")
from footsense.ros2.live import LiveSamples, Participant

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


def messages_of(snapshot: LegSnapshot) -> dict[str, Any]:
    """Return the first messages of a leg by the last word of their topic, decoded."""
    topics = LegTopics(["lf"])
    samples = LiveSamples().samples([snapshot], WALL_NS, 0)
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
    """A leg without a force has no wrench; its contact is unknown, its health says why."""
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

    def due(t_ms: int, n_frames: int, force: LegForce = _FORCE, event: LegEvent | None = None) -> list[str]:
        snapshot, t_ns = LegSnapshot("lf", force, _REPORT, n_frames, event=event), t_ms * 1_000_000
        samples = live.samples([snapshot], WALL_NS + t_ns, t_ns)
        return [topic.rpartition("/")[2] for topic, _ in topics.due_messages(samples, WALL_NS + t_ns)]

    with_force = ["wrench", "contact_probability", "holds"]
    assert due(0, 1) == [*with_force, "contact", "diagnostics"]
    assert due(5, 1) == []
    assert due(10, 2) == with_force
    assert due(15, 2, event=event) == ["contact"]
    assert due(100, 3, event=event) == [*with_force, "contact"]
    assert due(105, 4, _NO_FORCE, event) == ["diagnostics"]
    assert due(1105, 4, _NO_FORCE, event) == ["contact", "diagnostics"]


def test_a_second_participant_reads_what_was_published(monkeypatch: pytest.MonkeyPatch) -> None:
    """Another process on the loopback, with types of its own, gets the numbers."""
    monkeypatch.setenv(
        "CYCLONEDDS_URI",
        "<General><Interfaces><NetworkInterface name='lo' multicast='true'/></Interfaces></General>",
    )
    domain = 100 + os.getpid() % 100
    topics = LegTopics(["lf"])
    samples = LiveSamples().samples([LegSnapshot("lf", _FORCE, _REPORT, 7)], WALL_NS + 4_000_005, 0)
    messages = list(topics.due_messages(samples, WALL_NS))
    publisher = Participant(domain, topics.types)
    script = Path(__file__).with_name("dds_reader.py")
    with subprocess.Popen(
        [sys.executable, str(script), str(domain)], stdout=subprocess.PIPE, text=True
    ) as reader:
        while reader.poll() is None:  # whatever the discovery of each other takes
            for topic, cdr in messages:
                publisher.publish(topic, cdr)
            try:
                reader.wait(0.05)
            except subprocess.TimeoutExpired:
                continue
        assert reader.stdout is not None
        told = [json.loads(line) for line in reader.stdout]
    assert told == [[1_700_000_000, 5, "lf_foot", 0.25, -0.5, 1.0]] * 3


def test_a_silent_channel_is_told() -> None:
    """After a second, once, as the monitor tells it."""
    options = [
        "--interface",
        "udp_multicast",
        "--channel",
        "239.74.163.76",
        "--duration",
        "1.5",
        "--domain",
        "97",
    ]
    result = CliRunner().invoke(main, ["ros2", *options])
    assert result.exit_code == 0, result.output
    assert result.output.count("no frames on 239.74.163.76; is the service running?") == 1
