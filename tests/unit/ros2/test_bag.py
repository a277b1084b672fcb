"""A bag says what the recording says."""

import math
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader

from footsense.errors import RecordingError
from footsense.frames import USABLE, Cycle, State
from footsense.recording.replay import Replay
from footsense.ros2.bag import write_bag
from footsense.ros2.store import CONTACT, STORE
from tests.support.cycles import write

GOLDEN = Path(__file__).parents[2] / "golden" / "measured_walk.mcap"


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("bag") / "walk"
    assert write_bag(Replay(GOLDEN), folder) == 585
    return folder


@pytest.fixture(scope="module")
def topics(bag: Path) -> dict[str, list[tuple[int, Any]]]:
    found = defaultdict(list)
    with AnyReader([bag], default_typestore=STORE) as reader:
        for connection, t_ns, data in reader.messages():
            found[connection.topic].append((t_ns, reader.deserialize(data, connection.msgtype)))
    return dict(found)


@pytest.fixture(scope="module")
def cycles() -> list[Cycle]:
    return list(Replay(GOLDEN))


def xyz(vector: Any) -> tuple[float, float, float]:
    return vector.x, vector.y, vector.z


@pytest.mark.parametrize(("row", "leg"), [(0, "lf"), (4, "rm")])
def test_wrenches_are_the_recorded_forces(
    row: int, leg: str, topics: dict[str, list[tuple[int, Any]]], cycles: list[Cycle]
) -> None:
    """Every new usable force is there once, with its sigma and the time of its reading, and nothing else."""
    wrenches = topics[f"/footsense/{leg}/wrench"]
    usable = [cycle.forces for cycle in cycles if cycle.forces.state[row] in USABLE]
    assert [xyz(message.wrench.force) for _, message in wrenches] == [tuple(f.force_n[row]) for f in usable]
    sigmas = topics[f"/footsense/{leg}/sigma"]
    assert [xyz(message.vector) for _, message in sigmas] == [tuple(f.sigma_n[row]) for f in usable]
    assert [message.header for _, message in sigmas] == [message.header for _, message in wrenches]
    offset_ns = topics["/diagnostics"][0][0] - cycles[0].forces.t_sent_ns
    stamps = [message.header.stamp.sec * 10**9 + message.header.stamp.nanosec for _, message in wrenches]
    assert stamps == [f.t_ns[row] + offset_ns for f in usable]
    assert [t_ns for t_ns, _ in wrenches] == [f.t_sent_ns + offset_ns for f in usable]
    assert {message.header.frame_id for _, message in wrenches} == {f"{leg}_foot"}


def test_contacts_are_the_recorded_gait(
    topics: dict[str, list[tuple[int, Any]]], cycles: list[Cycle]
) -> None:
    """A contact has status, normal and friction; one without a usable force is unknown, and its force NaN."""
    gaits = [(cycle.forces, cycle.forces.gait) for cycle in cycles if cycle.forces.gait is not None]
    contacts = [message for _, message in topics["/footsense/lf/contact"]]
    assert len(contacts) == len(gaits)
    for contact, (forces, gait) in zip(contacts, gaits, strict=True):
        usable = forces.state[0] in USABLE
        assert contact.status == ((2 if gait.contact[0] else 1) if usable else 0)
        assert np.array_equal(xyz(contact.surface_normal), gait.normal[0], equal_nan=True)
        assert np.array_equal(xyz(contact.wrench.force), forces.force_n[0], equal_nan=True)
        assert math.isnan(contact.pose.position.x)
    assert {contact.status for contact in contacts} == {0, 1, 2}


def test_events_are_the_recorded_ones(topics: dict[str, list[tuple[int, Any]]], cycles: list[Cycle]) -> None:
    """Each touchdown and lift-off, at the time at which it happened."""
    offset_ns = topics["/diagnostics"][0][0] - cycles[0].forces.t_sent_ns
    gaits = [cycle.forces.gait for cycle in cycles if cycle.forces.gait is not None]
    recorded = [(event.kind.name.lower(), event.t_ns + offset_ns) for gait in gaits for event in gait.events]
    told = [
        (topic.rpartition("/")[2], message.stamp.sec * 10**9 + message.stamp.nanosec)
        for topic, messages in topics.items()
        for _, message in messages
        if topic.endswith(("touchdown", "lift_off", "slip", "slip_end"))
    ]
    assert len(told) > 5
    assert sorted(told) == sorted(recorded)


def test_diagnostics_say_each_change(topics: dict[str, list[tuple[int, Any]]], cycles: list[Cycle]) -> None:
    """The states are told once a second and when one changes."""
    told = [(t_ns, [s.values[0].value for s in array.status]) for t_ns, array in topics["/diagnostics"]]
    changes = [[State(code).name for code in cycle.forces.state] for cycle in cycles]
    distinct = [states for at, states in enumerate(changes) if at == 0 or states != changes[at - 1]]
    seen = [states for at, (_, states) in enumerate(told) if at == 0 or states != told[at - 1][1]]
    assert seen == distinct
    assert max(np.diff([t_ns for t_ns, _ in told])) < 1_010_000_000
    assert [status.level for status in topics["/diagnostics"][-1][1].status] == [0] * 6


def test_what_humble_and_foxglove_need_is_in_the_file(bag: Path) -> None:
    """Metadata of a version that Humble reads, CDR alone, and definitions; that of the contact is no part of ROS."""
    assert "version: 8\n" in (bag / "metadata.yaml").read_text()
    assert STORE.hash_rihs01(CONTACT).startswith("RIHS01_1e2281fe2dc3ac42")
    with (bag / "walk.mcap").open("rb") as file:
        reader = make_reader(file)
        summary = reader.get_summary()
        assert reader.get_header().profile == "ros2"
        assert summary is not None
        assert {channel.message_encoding for channel in summary.channels.values()} == {"cdr"}
        assert {schema.encoding for schema in summary.schemas.values()} == {"ros2msg"}


def test_what_is_whole_of_a_cut_recording_becomes_a_bag(tmp_path: Path) -> None:
    """The bag can be read, and the error says what is missing."""
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(GOLDEN.read_bytes()[:200_000])
    with pytest.raises(RecordingError, match="cut short"):
        write_bag(Replay(cut), tmp_path / "bag")
    with AnyReader([tmp_path / "bag"], default_typestore=STORE) as reader:
        assert reader.message_count > 100
    with pytest.raises(RecordingError, match="exists and is not overwritten"):
        write_bag(Replay(cut), tmp_path / "bag")


def test_a_time_that_ros_cannot_write_is_one_line(tmp_path: Path, cycles: list[Cycle]) -> None:
    """Its seconds have 31 bits; what was before is in the bag."""
    late = cycles[3]._replace(forces=cycles[3].forces._replace(t_sent_ns=cycles[2].forces.t_sent_ns + 10**13))
    header = Replay(GOLDEN).header
    limit_ns = 2**31 * 10**9 - cycles[2].forces.t_sent_ns - 10**9
    path = write(
        tmp_path / "late.mcap", [*cycles[:3], late], header={**header, "wall_offset_ns": str(limit_ns)}
    )
    with pytest.raises(RecordingError, match="a time after cycle 3 is none that ROS 2 can write"):
        write_bag(Replay(path), tmp_path / "bag")
    assert (tmp_path / "bag").exists()
