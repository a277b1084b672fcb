"""Foxglove's protocol, spoken by a client and judged by schemas that are not ours."""

import asyncio
import base64
import json
from collections import defaultdict
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import fastjsonschema
import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from robo_ws_bridge import WebSocketBridgeClient
from websockets.asyncio.client import connect
from websockets.typing import Subprotocol

from footsense.clock import MonotonicClock
from footsense.recording.container.messages import decode_force, decode_scan
from footsense.view.foxglove.scene import DISPLAYED_FOOT_POSITIONS_M, orientation
from footsense.view.foxglove.session import FoxgloveSession
from footsense.view.live import LiveSource
from footsense.view.recorded import RecordingSource
from footsense.view.server import ViewServer
from tests.support.viewed_service import LEGS, ViewedService, header_of

GOLDEN = Path(__file__).parents[2] / "golden/measured_walk.mcap"
TIMEOUT_S = 20


def run(test: Callable[[], Awaitable[None]]) -> None:
    asyncio.run(asyncio.wait_for(test(), TIMEOUT_S))


@pytest.mark.parametrize("rows", [3, 4])
def test_a_client_of_the_protocol_gets_every_topic(rows: int, tmp_path: Path) -> None:
    """Messages fit the schemas that they are announced with, and say what the service said."""

    async def test() -> None:
        with ViewedService(tmp_path / "cycles", header_of(rows**2)) as service:
            service.force_n[3] = 0.3, 0.0, 0.4
            service.publish()
            live = LiveSource(tmp_path / "cycles", MonotonicClock())
            async with ViewServer(live).serving("127.0.0.1", 0) as url:
                client = WebSocketBridgeClient(url.replace("http", "ws"))
                received: dict[str, list[tuple[int, dict[str, Any]]]] = defaultdict(list)
                announced = asyncio.Event()
                client.on_message(
                    lambda channel, t_ns, data: received[channel["topic"]].append((t_ns, json.loads(data)))
                )
                client.on_advertised_channel(
                    lambda channel: announced.set() if channel["topic"] == "/tf" else None
                )
                await client.connect()
                await announced.wait()
                channels = {channel["topic"]: channel for channel in client.channels.values()}
                for topic in channels:
                    await client.subscribe(topic)
                while not {"/scan", "/force", "/gait", "/feet", "/closure/rf", "/tf"} <= received.keys():
                    service.publish(20)
                    await asyncio.sleep(0.01)
                for topic in channels:
                    await client.unsubscribe(topic)
                await client.disconnect()
            live.close()
        check(channels, received, rows)

    run(test)


def check(channels: dict[str, Any], received: dict[str, list[tuple[int, dict[str, Any]]]], rows: int) -> None:
    """Check what a client was sent against the schemas and against the service."""
    schemas = {topic: channel["schemaName"] for topic, channel in channels.items()}
    assert schemas["/feet"] == "foxglove.SceneUpdate"
    assert schemas["/tf"] == "foxglove.FrameTransforms"
    assert {schemas[f"/closure/{leg}"] for leg in LEGS} == {"foxglove.Grid"}
    for topic, channel in channels.items():
        assert (channel["encoding"], channel["schemaEncoding"]) == ("json", "jsonschema")
        validate = fastjsonschema.compile(json.loads(channel["schema"]))
        for _, message in received[topic][:3]:
            validate(message)
    t_ns, message = received["/force"][-1]
    forces = decode_force(json.dumps(message).encode(), LEGS)
    assert forces.t_sent_ns == t_ns
    assert forces.force_n[3] == pytest.approx([0.3, 0.0, 0.4])
    scan = decode_scan(json.dumps(received["/scan"][-1][1]).encode(), LEGS, rows**2)
    assert scan.capacitance_pf.shape == (6, rows**2)
    (entity,) = [entity for entity in received["/feet"][-1][1]["entities"] if entity["id"] == "rf"]
    (arrow,) = entity["arrows"]
    assert arrow["shaft_length"] + arrow["head_length"] == pytest.approx(0.05)
    assert tuple(arrow["pose"]["position"].values()) == DISPLAYED_FOOT_POSITIONS_M["rf"]
    grid = received["/closure/rf"][-1][1]
    cells = np.frombuffer(base64.b64decode(grid["data"]), "<f4").reshape(-1, grid["column_count"])
    # x forward along the columns, y to the left along the rows: element 0 is the most forward and leftmost.
    assert cells.shape == (rows, rows)
    assert (grid["row_stride"], grid["cell_size"]["x"]) == (4 * rows, pytest.approx(0.06 / rows))
    assert cells[-1, -1] == pytest.approx(0.4 * 0.2, abs=1e-6)
    assert cells[0, 0] == pytest.approx(0.4 * 0.7, abs=1e-6)
    assert cells[-1, 0] == pytest.approx(0.4 * np.linspace(0.2, 0.7, rows**2)[-rows], abs=1e-6)


@pytest.mark.parametrize("name", ["foxglove.sdk.v1", "foxglove.websocket.v1"])
def test_both_names_of_the_protocol(name: str, tmp_path: Path) -> None:
    """The server is greeted by either; a recording says that Foxglove opens it itself."""

    async def greetings(server: ViewServer) -> list[dict[str, Any]]:
        async with (
            server.serving("127.0.0.1", 0) as url,
            connect(url.replace("http", "ws"), subprotocols=[Subprotocol(name)]) as client,
        ):
            assert client.subprotocol == name
            return [json.loads(await client.recv()) for _ in range(3)]

    async def test() -> None:
        live = LiveSource(tmp_path / "cycles", MonotonicClock())
        info, channels, status = await greetings(ViewServer(live))
        assert (info["op"], info["capabilities"]) == ("serverInfo", [])
        assert (channels["op"], channels["channels"]) == ("advertise", [])
        assert "no service runs" in status["message"]
        recorded = RecordingSource(GOLDEN)
        assert "open measured_walk.mcap itself" in (await greetings(ViewServer(recorded)))[2]["message"]
        recorded.close()

    run(test)


class SlowConnection:
    """A client that reads when it is told to."""

    def __init__(self) -> None:
        self.sent: list[str | bytes] = []
        self.reads = asyncio.Event()

    async def send(self, message: str | bytes) -> None:
        """Wait until the client reads."""
        await self.reads.wait()
        self.sent.append(message)


def test_a_slow_client_skips_what_became_old(tmp_path: Path) -> None:
    """While it does not read nothing is kept for it; then it gets at most the last cycles."""

    async def test() -> None:
        with ViewedService(tmp_path / "cycles") as service:
            service.publish()
            live = LiveSource(tmp_path / "cycles", MonotonicClock())
            live.poll()
            client, connection = FoxgloveSession(live), SlowConnection()
            connection.reads.set()
            await client.send_new(connection, 0.0)
            assert (
                client.handle_message('{"op": "subscribe", "subscriptions": [{"id": 5, "channelId": 2}]}')
                == []
            )
            service.publish()
            live.poll()
            connection.reads.clear()
            connection.sent.clear()
            sending = asyncio.create_task(client.send_new(connection, 0.0))
            for _ in range(5):
                await asyncio.sleep(0)
                service.publish(200)
                live.poll()
            connection.reads.set()
            await sending
            assert len(connection.sent) == 1 + 129
            assert client.n_skipped == 1002 - 1 - 1 - 129
            live.close()

    run(test)


OPERATIONS = st.sampled_from(["subscribe", "unsubscribe", "advertise", "getParameters", ""])
NUMBERS = st.integers(-2, 20) | st.integers() | st.text(max_size=3) | st.none()
REQUESTS = st.fixed_dictionaries(
    {"op": OPERATIONS},
    optional={
        "subscriptions": st.lists(st.fixed_dictionaries({"id": NUMBERS, "channelId": NUMBERS}), max_size=3),
        "subscriptionIds": st.lists(NUMBERS, max_size=3),
    },
).map(json.dumps)


@given(st.lists(REQUESTS | st.text() | st.binary(), max_size=8))
def test_any_requests_are_answered_or_dismissed(requests: list[str | bytes]) -> None:
    """A client of any kind gets statuses, or the one error by which it is dismissed; a channel is sent at most once."""
    client = FoxgloveSession(LiveSource(Path("/nonexistent/cycles"), MonotonicClock()))
    for request in requests:
        try:
            answers = client.handle_message(request)
        except ValueError:
            continue
        assert all(json.loads(answer)["op"] == "status" for answer in answers)


@example([-1.0, 0.0, 1.5e-161])
@given(st.lists(st.floats(-10, 10), min_size=3, max_size=3).filter(lambda v: np.linalg.norm(v) > 1e-3))
def test_an_arrow_points_along_its_force(force_n: list[float]) -> None:
    """The quaternion turns the x axis, along which Foxglove's arrows lie, into the force."""
    x, y, z, w = orientation(np.array(force_n)).values()
    turned = [1 - 2 * (y * y + z * z), 2 * (x * y + z * w), 2 * (x * z - y * w)]
    assert np.linalg.norm([x, y, z, w]) == pytest.approx(1.0)
    assert turned == pytest.approx(np.array(force_n) / np.linalg.norm(force_n), abs=1e-6)
