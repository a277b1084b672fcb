"""The node `footsense` of ROS 2: sends messages over Zenoh as nodes with `rmw_zenoh_cpp` expect them.

    key         0/footsense/lf/wrench/geometry_msgs::msg::dds_::WrenchStamped_/RIHS01_8dc3...
    attachment  number of the message, time [ns] since 1970, id of the publisher
    tokens      one for the node and one for each publisher, by which `ros2 node list` and `ros2 topic list` know them

Humble knows no hashes of types and has one word in their place, so every message has two keys; Zenoh sends what is
subscribed to, and nothing else.

Source:
    The design document of https://github.com/ros2/rmw_zenoh, and of its releases 0.1.9 (Humble), 0.2.10 (Jazzy), 0.6.7
    (Kilted) and 0.10.5 (Lyrical): attachment_helpers.cpp, liveliness_utils.cpp, rmw_publisher_data.cpp,
    zenoh_config.cpp and the default session. REP 2016 for the hashes.
"""

import os
import struct
from collections.abc import Mapping
from typing import Final

import xxhash
import zenoh

from footsense.errors import FootsenseError
from footsense.ros2.store import STORE

_NAME: Final = "footsense"
_HUMBLE_HASH: Final = "TypeHashNotSupported"
#: Reliable, volatile, the last ten; the rest as rmw_zenoh has it by default.
_QOS: Final = "::,10:,:,:,,"
_FILE: Final = "ZENOH_SESSION_CONFIG_URI"
_OVERRIDE: Final = "ZENOH_CONFIG_OVERRIDE"
#: As nodes have it by default: found by the router of this computer, not by multicast.
_SESSION: Final = """{
    mode: "peer", timestamping: { enabled: true },
    connect: { endpoints: ["tcp/localhost:7447"] }, listen: { endpoints: ["tcp/localhost:0"] },
    scouting: { multicast: { enabled: false }, gossip: { target: { router: ["router", "peer"], peer: ["router"] } } },
}"""


def topic_key(domain: int, topic: str, kind: str, type_hash: str) -> str:
    """Return the key of a topic's messages: of `/a`, with messages such as `std_msgs/msg/Float64` of this hash."""
    return f"{domain}{topic}/{_dds_name(kind)}/{type_hash}"


def node_token(domain: int, session_id: str, name: str) -> str:
    """Return the key of the liveliness token of a Zenoh session's first node, in the root namespace."""
    return f"@ros2_lv/{domain}/{session_id}/0/0/NN/%/%/{name}"


def publisher_token(
    domain: int, session_id: str, name: str, number: int, topic: str, kind: str, qos: str = _QOS
) -> str:
    """Return the key of the liveliness token of a publisher of that node.

    Args:
        domain: The ROS_DOMAIN_ID.
        session_id: Id of the Zenoh session.
        name: Name of the node.
        number: Number of the publisher in the session.
        topic: Name of the topic, with its leading slash.
        kind: Type of its messages.
        qos: Quality of service where it differs from the default of rmw_zenoh.
    """
    publisher = f"@ros2_lv/{domain}/{session_id}/0/{number}/MP/%/%/{name}"
    return f"{publisher}/{topic.replace('/', '%')}/{_dds_name(kind)}/{STORE.hash_rihs01(kind)}/{qos}"


def publisher_id(token: str) -> bytes:
    """Return the id of a publisher, 16 bytes: a hash of its token."""
    return xxhash.xxh3_128_intdigest(token.encode()).to_bytes(16, "little")


def attachment(number: int, t_wall_ns: int, publisher: bytes) -> bytes:
    """Return what goes with a message: its number from 1, the time of sending since 1970 [ns], its publisher's id."""
    return struct.pack("<qqB16s", number, t_wall_ns, len(publisher), publisher)


def _dds_name(kind: str) -> str:
    package, _, name = kind.partition("/msg/")
    return f"{package}::msg::dds_::{name}_"


class Node:
    """A node of ROS 2 with one publisher per topic, in a Zenoh session of its own.

    The session takes the same variables as one of rmw_zenoh: ZENOH_SESSION_CONFIG_URI, a file in place of the default,
    and ZENOH_CONFIG_OVERRIDE, `key=value;...` on top of it. It opens without a router, and finds one that comes later.

    Args:
        domain: The domain, 0 to 232: nodes hear each other if their ROS_DOMAIN_ID is equal.
        topics: Type of the messages of each topic.

    Raises:
        FootsenseError: The session's settings are wrong, or it does not open.
    """

    def __init__(self, domain: int, topics: Mapping[str, str]) -> None:
        config = _session_config()
        self._endpoints = config.get_json("connect/endpoints").strip("[]").replace('"', "")
        self._has_router: bool | None = None
        try:
            self._session = zenoh.open(config)
        except zenoh.ZError as error:
            raise FootsenseError(f"no Zenoh session: {_reason(error)}; see {_FILE} and {_OVERRIDE}") from None
        session_id, declare_token = str(self._session.zid()), self._session.liveliness().declare_token
        self._tokens = [declare_token(node_token(domain, session_id, _NAME))]
        self._numbers = dict.fromkeys(topics, 0)
        self._ids: dict[str, bytes] = {}
        self._publishers: dict[str, list[zenoh.Publisher]] = {}
        for number, (topic, kind) in enumerate(topics.items(), start=1):
            token = publisher_token(domain, session_id, _NAME, number, topic, kind)
            self._ids[topic] = publisher_id(token)
            self._publishers[topic] = [
                self._session.declare_publisher(
                    topic_key(domain, topic, kind, type_hash),
                    congestion_control=zenoh.CongestionControl.DROP,
                    reliability=zenoh.Reliability.RELIABLE,
                )
                for type_hash in (STORE.hash_rihs01(kind), _HUMBLE_HASH)
            ]
            self._tokens.append(declare_token(token))

    def publish(self, topic: str, cdr: bytes, t_wall_ns: int) -> None:
        """Publish a message on a topic: its CDR bytes with their header, sent at a time since 1970 [ns].

        Raises:
            FootsenseError: It cannot be sent.
        """
        self._numbers[topic] += 1
        told = attachment(self._numbers[topic], t_wall_ns, self._ids[topic])
        try:
            for publisher in self._publishers[topic]:
                publisher.put(cdr, attachment=told)
        except zenoh.ZError as error:
            raise FootsenseError(f"{topic}: not published: {_reason(error)}") from None

    def router_news(self) -> str | None:
        """Return a line if a router has come or gone since the last call, or is missing at the first."""
        had_router, self._has_router = self._has_router, bool(self._session.info.routers_zid())
        if had_router is self._has_router or (had_router is None and self._has_router):
            return None
        if self._has_router:
            return "the Zenoh router is there"
        if had_router:
            return "the Zenoh router is gone: nodes that hear footsense may go on, no other finds it"
        return f"no Zenoh router at {self._endpoints}, so no node finds footsense: ros2 run rmw_zenoh_cpp rmw_zenohd"

    def close(self) -> None:
        """End the session: nodes see node and publishers leave."""
        self._session.close()  # type: ignore[no-untyped-call]


def _session_config() -> zenoh.Config:
    """Return the settings of the session.

    Raises:
        FootsenseError: They are wrong.
    """
    path = os.environ.get(_FILE)
    try:
        config = zenoh.Config.from_file(path) if path else zenoh.Config.from_json5(_SESSION)
    except zenoh.ZError as error:
        raise FootsenseError(f"{_FILE}={path}: {_reason(error)}") from None
    for pair in filter(str.strip, os.environ.get(_OVERRIDE, "").split(";")):
        key, _, value = pair.partition("=")
        try:
            config.insert_json5(key.strip(), value)
        except zenoh.ZError:
            raise FootsenseError(
                f"{_OVERRIDE}: {pair.strip()} is no setting of Zenoh; of the form "
                'connect/endpoints=["tcp/192.168.1.2:7447"];key=value'
            ) from None
    return config


def _reason(error: zenoh.ZError) -> str:
    """Return what Zenoh says, without the place in its sources."""
    return str(error).partition(" at /")[0].partition("\n")[0].strip()
