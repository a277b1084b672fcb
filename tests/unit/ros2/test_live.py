"""Forces on CAN reach a DDS participant of ROS 2's names and types as they are."""

import json
import math
import os
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner

from firmware_interface.can.codes import BaselineStatus, Cause, Flag, GaitEventKind, NmtState, Slip, State
from firmware_interface.can.gait import Gait, Ground
from footsense.cli.can.ros2 import ros2
from footsense.client import LegEvent, LegForce, LegReport, LinkStatus
from footsense.daemon.can_listener import LegSnapshot
from footsense.ros2 import participant
from footsense.ros2.leg_messages import LegSample
from footsense.ros2.live_samples import LiveMessages, live_sample
from footsense.ros2.messages import ContactState, DiagnosticArray, WrenchStamped
from footsense.ros2.participant import Participant
from footsense.ros2.topics import TopicMessage, TopicMessageBuilder

needs_dds = pytest.mark.skipif(
    not participant.HAS_DDS, reason="cyclonedds has no wheel for this processor or Python: docs/ros2.md"
)
NAN = math.nan
WALL_NS = 1_700_000_000_000_000_000
_REPORT = LegReport(
    *(Cause.NONE, State.VALID, BaselineStatus.TRACKING, 0.0, 0.0, 0, NmtState.OPERATIONAL, False),
    gait=Gait(1, 0, True, True, False, Slip.SLIPPING, 1.0, 0.5),
    ground=Ground(1, 0, (0.0, 0.6, 0.8), 0.01, 0.3, 0.01, 0.7),
)
_FORCE = LegForce(
    LinkStatus.OK, True, State.VALID, Flag.CONTACT, 0, (0.25, -0.5, 1.0), (0.01, 0.01, 0.02), 4_000_000
)
_NO_FORCE = LegForce(LinkStatus.OK, False, State.SATURATED, Flag(0), 0, (NAN,) * 3, (NAN,) * 3, None)


def test_a_usable_force_has_the_time_of_its_measurement() -> None:
    """The age that CAN tells is taken off the time of the wall clock."""
    sample = live_sample(LegSnapshot("lf", _FORCE, _REPORT, 7), WALL_NS)
    assert sample.t_wall_ns == WALL_NS - 4_000_000
    assert sample.force_n == (0.25, -0.5, 1.0)
    (message,) = TopicMessageBuilder(["lf"]).wrench(sample)
    assert isinstance(message.message, WrenchStamped)
    contact = TopicMessageBuilder(["lf"]).contact(sample).message
    assert isinstance(contact, ContactState)
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
    topics, sample = TopicMessageBuilder(["lf"]), live_sample(snapshot, WALL_NS)
    assert topics.wrench(sample) == []
    contact = topics.contact(sample).message
    assert isinstance(contact, ContactState)
    assert (contact.status, math.isnan(contact.wrench.force.z), math.isnan(contact.wrench.torque.z)) == (
        *(0, True, True),
    )
    array = topics.diagnostics([sample], WALL_NS).message
    assert isinstance(array, DiagnosticArray)
    assert array.status[0].level == level


def test_the_health_names_each_of_sixteen_elements() -> None:
    """By their flat index."""
    array = TopicMessageBuilder(["lf"]).diagnostics([LegSample("lf", fault_mask=0x8201)], WALL_NS).message
    assert isinstance(array, DiagnosticArray)
    assert {item.key: item.value for item in array.status[0].values}["elements_out"] == "0 9 15"


def test_each_force_is_published_once_and_each_change_at_once() -> None:
    """The wrench comes with a new frame, the contact with an event or every 100 ms, the health with a change."""
    live = LiveMessages(TopicMessageBuilder(["lf"]))
    event = LegEvent(1, GaitEventKind.TOUCHDOWN, 0, 0.001, False)

    def due(t_ms: int, n_frames: int, force: LegForce = _FORCE, event: LegEvent | None = None) -> list[str]:
        snapshot = LegSnapshot("lf", force, _REPORT, n_frames, event)
        return [
            message.topic.rpartition("/")[2]
            for message in live.due_messages([snapshot], WALL_NS, t_ms * 1_000_000)
        ]

    assert due(0, 1) == ["wrench", "contact", "diagnostics"]
    assert due(5, 1) == []
    assert due(10, 2) == ["wrench"]
    assert due(15, 2, event=event) == ["contact"]
    assert due(100, 3, event=event) == ["wrench", "contact"]
    assert due(105, 4, _NO_FORCE, event) == ["diagnostics"]
    assert due(1105, 4, _NO_FORCE, event) == ["contact", "diagnostics"]


@needs_dds
def test_a_second_participant_reads_what_was_published(monkeypatch: pytest.MonkeyPatch) -> None:
    """Another process on the loopback, with types of its own, gets the numbers."""
    monkeypatch.setenv(
        "CYCLONEDDS_URI",
        "<General><Interfaces><NetworkInterface name='lo' multicast='true'/></Interfaces></General>",
    )
    domain = 100 + os.getpid() % 100
    topics = TopicMessageBuilder(["lf"])
    (message,) = topics.wrench(
        LegSample("lf", t_wall_ns=WALL_NS + 5, state=State.VALID, force_n=(0.25, -0.5, 1.0))
    )
    publisher = Participant(domain, topics.types)
    script = Path(__file__).with_name("dds_reader.py")
    with subprocess.Popen(
        [sys.executable, str(script), str(domain)], stdout=subprocess.PIPE, text=True
    ) as reader:
        while reader.poll() is None:  # whatever the discovery of each other takes
            publisher.publish(message)
            try:
                reader.wait(0.05)
            except subprocess.TimeoutExpired:
                continue
        assert reader.stdout is not None
        told = [json.loads(line) for line in reader.stdout]
    assert told == [[1_700_000_000, 5, "lf_foot", 0.25, -0.5, 1.0]] * 3


@needs_dds
def test_bytes_are_those_of_the_dds_library() -> None:
    """The DDS type and value of each message give the bytes of a bag."""
    from footsense.ros2.cdr import encode

    sample = live_sample(LegSnapshot("lf", _FORCE, _REPORT, 7), WALL_NS)
    topics = TopicMessageBuilder(["lf"])
    for message in (*topics.wrench(sample), topics.contact(sample), topics.diagnostics([sample], WALL_NS)):
        ours, theirs = encode(message.message), participant.dds_value(message.message).serialize()
        assert ours[4:] == theirs[4 : len(ours)]


def test_without_the_library_the_command_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(participant, "HAS_DDS", False)
    result = CliRunner().invoke(ros2, ["--interface", "udp_multicast", "--duration", "0.1"])
    assert "pip install 'footsense[ros2]'" in str(result.exception)


def test_a_topic_message_names_a_topic_of_the_robot() -> None:
    """Every message goes to a topic that is declared with its class."""
    topics = TopicMessageBuilder(["lf"])
    sample = live_sample(LegSnapshot("lf", _FORCE, _REPORT, 7), WALL_NS)
    sent: list[TopicMessage] = [*topics.wrench(sample), topics.contact(sample)]
    assert all(type(one.message) is topics.types[one.topic] for one in sent)
