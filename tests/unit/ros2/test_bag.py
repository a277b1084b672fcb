"""A bag says what the recording says: read by rosbags, which shares no code with footsense."""

import math
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from footsense.errors import ConfigError, RecordingError
from footsense.frames import USABLE, Cycle, State
from footsense.recording.replay import Replay
from footsense.ros2.bag_export import write_bag
from footsense.ros2.cdr import encode
from footsense.ros2.definitions import fields_of, message_definition, ros_type_name
from footsense.ros2.messages import (
    ContactState,
    DiagnosticArray,
    DiagnosticStatus,
    Header,
    KeyValue,
    Message,
    Point,
    Pose,
    Quaternion,
    TFMessage,
    Time,
    Transform,
    TransformStamped,
    Twist,
    Vector3,
    Wrench,
    WrenchStamped,
)
from footsense.ros2.participant import TYPE_HASHES
from footsense.ros2.topics import FootFrame, load_foot_frames

GOLDEN = Path(__file__).parents[2] / "golden" / "measured_walk.mcap"
STORE = get_typestore(Stores.ROS2_HUMBLE)
STORE.register(get_types_from_msg(message_definition(ContactState), ros_type_name(ContactState)))

floats = st.floats(allow_nan=False)
texts = st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0"), max_size=9)
times = st.builds(Time, st.integers(-(2**31), 2**31 - 1), st.integers(0, 2**32 - 1))
headers = st.builds(Header, times, texts)
vectors = st.builds(Vector3, floats, floats, floats)
rotations = st.builds(Quaternion, floats, floats, floats, floats)
wrenches = st.builds(Wrench, vectors, vectors)
values = st.lists(st.builds(KeyValue, texts, texts), max_size=2)
statuses = st.builds(DiagnosticStatus, st.integers(0, 3), texts, texts, texts, values)
transforms = st.builds(TransformStamped, headers, texts, st.builds(Transform, vectors, rotations))
poses = st.builds(Pose, st.builds(Point, floats, floats, floats), rotations)
twists = st.builds(Twist, vectors, vectors)
bytes_ = st.integers(0, 255)
messages = st.one_of(
    st.builds(WrenchStamped, headers, wrenches),
    st.builds(DiagnosticArray, headers, st.lists(statuses, max_size=2)),
    st.builds(TFMessage, st.lists(transforms, max_size=2)),
    st.builds(ContactState, texts, bytes_, bytes_, poses, twists, wrenches, vectors, floats),
)


def assert_same(ours: Any, theirs: Any) -> None:
    """Compare two messages field by field, whatever their classes."""
    if isinstance(ours, list):
        assert len(ours) == len(theirs)
        for pair in zip(ours, theirs, strict=True):
            assert_same(*pair)
    elif type(ours).__module__ == Time.__module__:
        kind: type = type(ours)
        for field in fields_of(kind):
            assert_same(getattr(ours, field.name), getattr(theirs, field.name))
    else:
        assert ours == theirs


@given(messages)
@settings(max_examples=60)
def test_bytes_are_those_of_another_implementation(message: Message) -> None:
    """Every message decodes elsewhere to the same fields."""
    assert_same(message, STORE.deserialize_cdr(encode(message), ros_type_name(type(message))))


@pytest.mark.parametrize("kind", [WrenchStamped, DiagnosticArray, TFMessage, ContactState])
def test_definitions_are_those_of_ros(kind: type) -> None:
    """The hash of our text is that of the type as ROS 2 ships it; ContactState's stands beside the DDS types."""
    name, ours = ros_type_name(kind), get_typestore(Stores.EMPTY)
    ours.register(get_types_from_msg(message_definition(kind), name))
    assert ours.hash_rihs01(name) == TYPE_HASHES[kind]
    if kind is not ContactState:
        assert TYPE_HASHES[kind] == STORE.hash_rihs01(name)


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("bag") / "walk"
    frames = {"lf": FootFrame("lf_toe", "lf_tibia", (0.0, 0.0, -0.1))}
    assert write_bag(Replay(GOLDEN), folder, frames) == 1448
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
    """Every new usable force is there once, with the time of its reading, and nothing else."""
    wrenches = topics[f"/footsense/{leg}/wrench"]
    usable = [cycle.forces for cycle in cycles if cycle.forces.state[row] in USABLE]
    assert [xyz(message.wrench.force) for _, message in wrenches] == [tuple(f.force_n[row]) for f in usable]
    offset_ns = topics["/diagnostics"][0][0] - cycles[0].forces.t_sent_ns
    stamps = [message.header.stamp.sec * 10**9 + message.header.stamp.nanosec for _, message in wrenches]
    assert stamps == [f.t_ns[row] + offset_ns for f in usable]
    assert [t_ns for t_ns, _ in wrenches] == [f.t_sent_ns + offset_ns for f in usable]
    assert {message.header.frame_id for _, message in wrenches} == {
        "lf_toe" if leg == "lf" else f"{leg}_foot"
    }


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


def test_diagnostics_say_each_change(topics: dict[str, list[tuple[int, Any]]], cycles: list[Cycle]) -> None:
    """The states are told once a second and when one changes."""
    told = [(t_ns, [s.values[0].value for s in array.status]) for t_ns, array in topics["/diagnostics"]]
    changes = [[State(code).name for code in cycle.forces.state] for cycle in cycles]
    distinct = [states for at, states in enumerate(changes) if at == 0 or states != changes[at - 1]]
    seen = [states for at, (_, states) in enumerate(told) if at == 0 or states != told[at - 1][1]]
    assert seen == distinct
    assert max(np.diff([t_ns for t_ns, _ in told])) < 1_010_000_000
    assert [status.level for status in topics["/diagnostics"][-1][1].status] == [0] * 6


def test_a_foot_with_a_parent_has_a_transform(topics: dict[str, list[tuple[int, Any]]]) -> None:
    ((_, message),) = topics["/tf_static"]
    (transform,) = message.transforms
    assert (transform.header.frame_id, transform.child_frame_id) == ("lf_tibia", "lf_toe")
    assert xyz(transform.transform.translation) == (0.0, 0.0, -0.1)


def test_nothing_but_cdr_is_in_the_file(bag: Path) -> None:
    """rosbag2 takes the encoding of the first topic for all; the profile tells a reader what the file is."""
    with (bag / "walk_0.mcap").open("rb") as file:
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


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("lx: {frame: a}", "lx"),
        ("lf: {frame: a, parent: b, quaternion_xyzw: [0, 0, 0, 0.5]}", "length 0.500"),
        ("lf: {parent: b}", "frame"),
    ],
)
def test_wrong_frames_are_named(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "frames.yaml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=message):
        load_foot_frames(path)
