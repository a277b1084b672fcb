"""Foxglove's protocol, spoken by a client that decodes by the announced schemas."""

import asyncio
import ipaddress
import json
import socket
import struct
import sys
from collections import defaultdict
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest
from websockets.asyncio.client import connect
from websockets.exceptions import InvalidStatus
from websockets.typing import Subprotocol

from footsense.frames import LEGS
from footsense.recording.messages import topic_schemas
from footsense.view.foxglove import FoxgloveFeed
from footsense.view.live import LiveSource
from footsense.view.recorded import RecordingSource
from footsense.view.server import FOXGLOVE_PROTOCOLS, ViewServer
from tests.support.viewed_service import ViewedService, run, served

GOLDEN = Path(__file__).parents[2] / "golden/measured_walk.mcap"


class FoxgloveClient:
    """A program that subscribes to every topic and keeps its messages.

    Attributes:
        channels: Announced channels by topic.
        received: Time and decoded message of each topic.
        statuses: Texts that the server has told.
    """

    def __init__(self) -> None:
        self.channels: dict[str, dict[str, Any]] = {}
        self.received: defaultdict[str, list[tuple[int, Any]]] = defaultdict(list)
        self.statuses: list[str] = []

    async def listen(self, host: str, name: str, topics: Sequence[str], publish: Callable[[], None]) -> None:
        """Listen until there is a message on each of the topics; for none, until a status has come twice."""
        async with connect(f"ws://{host}/", subprotocols=[Subprotocol(name)], max_queue=None) as server:
            assert server.subprotocol == name
            while not (self.received.keys() >= set(topics) if topics else len(self.statuses) > 1):
                publish()
                message = await server.recv()
                if isinstance(message, bytes):
                    self._add(message)
                    continue
                values = json.loads(message)
                if values["op"] == "status":
                    self.statuses.append(values["message"])
                if values["op"] == "advertise":
                    channels = values["channels"]
                    self.channels |= {channel["topic"]: channel for channel in channels}
                    asked = [{"id": channel["id"], "channelId": channel["id"]} for channel in channels]
                    await server.send(json.dumps({"op": "subscribe", "subscriptions": asked}))

    def _add(self, message: bytes) -> None:
        kind, channel_id, t_ns = struct.unpack_from("<BIQ", message)
        assert kind == 1
        (channel,) = [channel for channel in self.channels.values() if channel["id"] == channel_id]
        self.received[channel["topic"]].append((t_ns, decoded(channel, message[13:])))


def decoded(channel: dict[str, Any], data: bytes) -> Any:
    """Return a message decoded by the schema of its channel."""
    values = json.loads(data)
    assert channel["encoding"] == "json"
    assert values.keys() <= json.loads(channel["schema"])["properties"].keys()
    return values


@pytest.mark.parametrize("name", FOXGLOVE_PROTOCOLS)
def test_a_program_gets_every_topic(name: str, tmp_path: Path) -> None:
    """By either name of the protocol; the messages say what the service said."""
    client = FoxgloveClient()

    async def test() -> None:
        with ViewedService(tmp_path / "cycles") as service:
            service.force_n[3] = 0.3, 0.0, 0.4
            service.publish()
            async with served(tmp_path / "cycles") as host:
                topics = ["/scan", "/force", "/gait"]
                await client.listen(host, name, topics, lambda: service.publish(20))

    run(test)
    t_ns, values = client.received["/force"][-1]
    assert values["t_sent_ns"] == t_ns
    assert [values["rf"][key] for key in ("fx_n", "fy_n", "fz_n")] == pytest.approx([0.3, 0.0, 0.4])
    assert len(client.received["/scan"][-1][1]["rr"]["capacitance_pf"]) == 9


def test_a_program_is_told_why_nothing_comes(tmp_path: Path) -> None:
    """Again and again, as the SDK tells nothing to a program that it has not let in yet."""
    client = FoxgloveClient()

    async def test() -> None:
        async with served(tmp_path / "cycles") as host:
            await client.listen(host, FOXGLOVE_PROTOCOLS[0], [], lambda: None)

    run(test)
    assert all("no service runs" in told for told in client.statuses)


async def refusal(server: ViewServer) -> str:
    """Return the line with which a program is refused."""
    async with server.serving("127.0.0.1", 0) as url:
        with pytest.raises(InvalidStatus) as refused:
            await connect(url.replace("http", "ws"), subprotocols=FOXGLOVE_PROTOCOLS)
        return refused.value.response.body.decode()


def test_a_recording_and_a_missing_extra_refuse_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    recorded = RecordingSource(GOLDEN)
    told = asyncio.run(refusal(ViewServer(recorded)))
    recorded.close()
    assert told == "footsense view: this is the page of a recording: open measured_walk.mcap itself\n"
    monkeypatch.setitem(sys.modules, "foxglove", None)
    told = asyncio.run(refusal(ViewServer(LiveSource(tmp_path / "cycles"))))
    assert told.endswith(
        "need foxglove-sdk; in the clone of footsense: pip install -e deploy/client -e '.[foxglove]'\n"
    )


def test_the_sdk_s_server_is_where_no_page_finds_it(tmp_path: Path) -> None:
    """It checks no origin: its address is another each time, and the usual ones do not answer on its port."""
    found = []
    for _ in range(2):
        live = LiveSource(tmp_path / "cycles")
        feed = FoxgloveFeed(live)
        host, _, port = feed.address.partition(":")
        socket.create_connection((host, int(port))).close()
        found.append(host)
        for usual in ("127.0.0.1", "127.0.1.1", "::1"):
            with pytest.raises(OSError, match=r"refused|available|route|assign"):
                socket.create_connection((usual, int(port)))
        feed.close()
    assert found[0] != found[1]
    assert all(ipaddress.ip_address(host).is_loopback for host in found)


def test_each_path_of_the_layout_is_in_a_channel_that_is_sent() -> None:
    """Live and in a recording, which have the same topics; each panel has its place, and each leg its line."""
    layout = json.loads((Path(__file__).parents[3] / "deploy/foxglove/footsense.json").read_text())
    panels = layout["configById"]

    def placed(node: str | dict[str, Any]) -> list[str]:
        return [node] if isinstance(node, str) else [*placed(node["first"]), *placed(node["second"])]

    assert sorted(placed(layout["layout"])) == sorted(panels)
    paths = [entry["value"] for panel in panels.values() for entry in panel.get("paths", ())]
    paths += [panel["topicPath"] for panel in panels.values() if "topicPath" in panel]
    with_schema = {topic: json.loads(schema) for topic, schema in topic_schemas(LEGS).items()}
    for path in paths:
        topic, *fields = path.split(".")
        schema = with_schema[topic]
        for field in fields:
            schema = schema["properties"][field]
        assert not fields or schema["type"] in ("string", ["number", "null"]), path
    for panel in panels.values():
        assert {entry["value"].split(".")[1] for entry in panel.get("paths", ())} in (set(), set(LEGS))
