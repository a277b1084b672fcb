"""The node of ROS 2: its bytes are those of rmw_zenoh, and they arrive in Zenoh sessions of the loopback."""

import json
import re
import socket
import struct
import threading
from collections.abc import Callable
from contextlib import closing
from typing import TypeVar

import pytest
import zenoh
from click.testing import CliRunner
from zenoh.ext import Int64, z_deserialize

from footsense.cli import main
from footsense.errors import FootsenseError
from footsense.ros2.messages import LegSample, LegTopics
from footsense.ros2.node import Node, attachment, node_token, publisher_id, publisher_token, topic_key
from footsense.ros2.store import STORE

T = TypeVar("T")
STRING = "std_msgs/msg/String"
STRING_HASH = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
TALKER = (
    "@ros2_lv/2/8b20917502ee955ac4476e0266340d5c/0/10/MP/%/%/talker/%chatter/std_msgs::msg::dds_::String_/"
    f"{STRING_HASH}/::,7:,:,:,,"
)
LISTENER = "@ros2_lv/2/aac3178e146ba6f1fc6e6a4085e77f21/0/0/NN/%/%/listener"
#: WrenchStamped of the frame lf_foot, 1 s + 5 ns, force (0.25, -0.5, 1), torque 0: header, stamp, text with its length
#: and end, 4 bytes up to a multiple of 8, six doubles.
WRENCH = bytes.fromhex("00010000 01000000 05000000 08000000") + b"lf_foot\0" + bytes(4)
WRENCH += struct.pack("<6d", 0.25, -0.5, 1.0, 0.0, 0.0, 0.0)


def test_keys_and_tokens_are_those_of_the_documentation() -> None:
    """The design document of rmw_zenoh has them: of `talker` and `listener`, in the root namespace and in `/robot1`."""
    dds = f"std_msgs::msg::dds_::String_/{STRING_HASH}"
    assert STORE.hash_rihs01(STRING) == STRING_HASH
    assert topic_key(0, "/chatter", STRING, STRING_HASH) == f"0/chatter/{dds}"
    assert topic_key(0, "/robot1/chatter", STRING, STRING_HASH) == f"0/robot1/chatter/{dds}"
    assert node_token(2, "aac3178e146ba6f1fc6e6a4085e77f21", "listener") == LISTENER
    talker = publisher_token(
        2, "8b20917502ee955ac4476e0266340d5c", "talker", 10, "/chatter", STRING, "::,7:,:,:,,"
    )
    assert talker == TALKER


@pytest.mark.parametrize(
    ("token", "told"),
    [(LISTENER, "49877999dacb858702d11ac823785912"), (TALKER, "ac170f31eadcd9ff0cd86d7a17907d1c")],
)
def test_ids_are_those_that_rmw_zenoh_computes(token: str, told: str) -> None:
    """What `simplified_XXH3_128bits` of rmw_zenoh 0.2.10 gives, its low eight bytes first as in `Entity`."""
    assert publisher_id(token).hex() == told


def test_an_attachment_is_laid_out_as_documented() -> None:
    """The design document: number and time as little-endian int64, a byte for the length of the id, the id.

    Zenoh's own deserializer, with which rmw_zenoh reads it, finds the three.
    """
    told = attachment(1, 1_700_000_000_123_456_789, bytes(range(16)))
    expected = "0100000000000000 15cd853dfe9c9717 10 000102030405060708090a0b0c0d0e0f"
    assert told == bytes.fromhex(expected)
    found = z_deserialize(tuple[Int64, Int64, bytes], zenoh.ZBytes(told))
    assert found == (1, 1_700_000_000_123_456_789, bytes(range(16)))


@pytest.mark.parametrize(
    ("kind", "told"),
    [
        (
            "geometry_msgs/msg/WrenchStamped",
            "8dc3deaf06b2ab281f9f9a742a8961c328ca7cec16e3fd6586d3a5c83fa78f77",
        ),
        (
            "geometry_msgs/msg/Vector3Stamped",
            "d4829622288cbb443886e7ea94ea5671a3b1be6bab4ad04224432a65f7d7887a",
        ),
        ("std_msgs/msg/Float64", "705ba9c3d1a09df43737eb67095534de36fd426c0587779bda2bc51fe790182a"),
        ("std_msgs/msg/Header", "f49fb3ae2cf070f793645ff749683ac6b06203e41c891e17701b1cb597ce6a01"),
        (
            "diagnostic_msgs/msg/DiagnosticArray",
            "5a8a36efb05fb25070fa0fb3810290c0e6cd4862b54a8fb975a1ee8dc55a333e",
        ),
        # An array of a fixed length, as LowState and its parts have.
        (
            "geometry_msgs/msg/PoseWithCovariance",
            "9a7c0fd234b7f45c6098745ecccd773ca1085670e64107135397aee31c02e1bb",
        ),
    ],
)
def test_hashes_are_those_of_the_distributions(kind: str, told: str) -> None:
    """As Kilted generates them for C (github.com/hpmicro/hpm_sdk, middleware/microros/kilted); the last of Pico-ROS."""
    assert STORE.hash_rihs01(kind) == f"RIHS01_{told}"


def opened(mode: str, listen: int = 0, connect: int | None = None) -> zenoh.Session:
    """Open a Zenoh session that knows nothing but these ports of the loopback."""
    settings = {
        "mode": mode,
        "scouting": {"multicast": {"enabled": False}, "delay": 0},
        "listen": {"endpoints": [f"tcp/127.0.0.1:{listen}"]},
        "connect": {"endpoints": [f"tcp/127.0.0.1:{connect}"] if connect else []},
    }
    return zenoh.open(zenoh.Config.from_json5(json.dumps(settings)))


@pytest.fixture
def port(monkeypatch: pytest.MonkeyPatch) -> int:
    """A free port of the loopback, where the node looks for its router."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        free: int = probe.getsockname()[1]
    router = f'connect/endpoints=["tcp/127.0.0.1:{free}"]'
    monkeypatch.setenv(
        "ZENOH_CONFIG_OVERRIDE", f"{router};connect/retry={{period_init_ms:20}};scouting/delay=0"
    )
    monkeypatch.delenv("ZENOH_SESSION_CONFIG_URI", raising=False)
    return free


def until(value: Callable[[], T]) -> T:
    """Return the value once it is true, after whatever sessions need to hear of each other."""
    for _ in range(1000):
        if found := value():
            return found
        threading.Event().wait(0.01)
    raise AssertionError("never became true")


def publish_wrench(node: Node) -> bool:
    """Publish the wrench that `WRENCH` is."""
    sample = LegSample("lf", is_new_force=True, t_wall_ns=1_000_000_005, force_n=(0.25, -0.5, 1.0))
    topic, cdr = next(iter(LegTopics(["lf"]).due_messages([sample], 0)))
    node.publish(topic, cdr, 7)
    return True


@pytest.mark.parametrize(
    "type_hash",
    ["RIHS01_8dc3deaf06b2ab281f9f9a742a8961c328ca7cec16e3fd6586d3a5c83fa78f77", "TypeHashNotSupported"],
    ids=["jazzy", "humble"],
)
def test_messages_arrive_under_the_key_of_each_distribution(port: int, type_hash: str) -> None:
    """Bytes, number, time and id, through a router; the tokens come and go with the node."""
    key = f"5/footsense/lf/wrench/geometry_msgs::msg::dds_::WrenchStamped_/{type_hash}"
    samples: list[zenoh.Sample] = []
    alive: set[str] = set()

    def see(token: zenoh.Sample) -> None:
        (alive.add if token.kind == zenoh.SampleKind.PUT else alive.discard)(str(token.key_expr))

    with opened("router", listen=port), opened("peer", connect=port) as reader:
        reader.declare_subscriber(key, samples.append)
        tokens = reader.liveliness().declare_subscriber("@ros2_lv/5/**", see, history=True)
        with closing(Node(5, LegTopics(["lf"]).types)) as node:
            until(lambda: publish_wrench(node) and len(samples) > 1)
            until(lambda: len(alive) == 11)
            token = next(told for told in alive if "%footsense%lf%wrench/" in told)
        until(lambda: not alive)
        tokens.undeclare()  # type: ignore[no-untyped-call]
    assert {sample.payload.to_bytes() for sample in samples} == {WRENCH}
    attachments = [told.to_bytes() for sample in samples if (told := sample.attachment) is not None]
    numbers = [struct.unpack_from("<q", told)[0] for told in attachments]
    assert numbers == list(range(numbers[0], numbers[0] + len(samples)))
    assert {told[8:] for told in attachments} == {struct.pack("<qB", 7, 16) + publisher_id(token)}


def test_a_router_may_be_away_come_late_leave_and_come_back(port: int) -> None:
    """Each is told in one line, once; nothing else ends, and what is published then is heard once there is a way."""
    samples: list[zenoh.Sample] = []
    with closing(Node(0, LegTopics(["lf"]).types)) as node:
        news = node.router_news()
        assert news == (
            f"no Zenoh router at tcp/127.0.0.1:{port}, so no node finds footsense: ros2 run rmw_zenoh_cpp rmw_zenohd"
        )
        assert publish_wrench(node)
        assert node.router_news() is None
        for _ in range(2):
            with opened("router", listen=port) as router:
                assert until(node.router_news) == "the Zenoh router is there"
                router.declare_subscriber("0/footsense/lf/wrench/**", samples.append)
                until(lambda: publish_wrench(node) and samples)
                samples.clear()
            assert (until(node.router_news) or "").startswith("the Zenoh router is gone")
            assert publish_wrench(node)


@pytest.mark.parametrize(
    ("variable", "value", "line"),
    [
        ("ZENOH_CONFIG_OVERRIDE", "mode=peeer", "ZENOH_CONFIG_OVERRIDE: mode=peeer is no setting of Zenoh"),
        ("ZENOH_CONFIG_OVERRIDE", "no/such=1", "ZENOH_CONFIG_OVERRIDE: no/such=1 is no setting of Zenoh"),
        ("ZENOH_SESSION_CONFIG_URI", "/no/such.json5", "URI=/no/such.json5: No such file or directory"),
        ("ZENOH_CONFIG_OVERRIDE", 'listen/endpoints=["tcp/192.0.2.1:1"]', "no Zenoh session: Can not create"),
    ],
)
def test_wrong_settings_are_one_line(
    port: int, monkeypatch: pytest.MonkeyPatch, variable: str, value: str, line: str
) -> None:
    monkeypatch.setenv(variable, value)
    with pytest.raises(FootsenseError, match=re.escape(line)) as caught:
        Node(0, {})
    assert "\n" not in str(caught.value)


def test_a_silent_channel_and_a_missing_router_are_told_once(port: int) -> None:
    """After a second, as the monitor tells it."""
    udp = ["--channel", "239.74.163.76"]
    result = CliRunner().invoke(main, ["ros2", *udp, "--duration", "1.5"])
    assert result.exit_code == 0, result.output
    assert result.output.count("no frames on 239.74.163.76; is the service running") == 1
    assert result.output.count(f"footsense: no Zenoh router at tcp/127.0.0.1:{port}") == 1
