"""The server: who may connect, what rubbish does, and that a slow page gets the newest."""

import asyncio
import json
import socket
import struct
from pathlib import Path
from typing import Any
from urllib.request import Request, urlopen

import msgspec
import numpy as np
import pytest
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed, InvalidStatus

from footsense.daemon.recording_header import ClosureConversion
from footsense.errors import ConfigError
from footsense.view.live import LiveSource
from footsense.view.recorded import RecordingSource
from footsense.view.server import MAX_CLIENTS, PAGE_PROTOCOL, ViewServer
from footsense.view.signals import SIGNALS, SignalTables
from tests.support.viewed_service import (
    HEADER,
    LEGS,
    TIMEOUT_S,
    UNLOADED_PF,
    ViewedService,
    run,
    served,
)

GOLDEN = Path(__file__).parents[2] / "golden/measured_walk.mcap"
COLUMN = {name: column for column, name in enumerate(SIGNALS)}


def page(host: str, **options: Any) -> connect:
    """Open a connection as the page does."""
    return connect(f"ws://{host}/", subprotocols=[PAGE_PROTOCOL], **options)


async def text_of(connection: ClientConnection, kind: str) -> dict[str, object]:
    """Return the next text message of a type."""
    async for message in connection:
        if isinstance(message, str) and (values := json.loads(message))["type"] == kind:
            return dict(values)
    raise AssertionError(f"no {kind}")


async def cycles_of(connection: ClientConnection) -> tuple[list[float], np.ndarray]:
    """Return times and tables of the next message of cycles."""
    async for message in connection:
        if isinstance(message, bytes):
            _, n, legs, signals = struct.unpack_from("<IIII", message)
            times = np.frombuffer(message, "<f8", n, 16).tolist()
            return times, np.frombuffer(message, "<f4", n * legs * signals, 16 + 8 * n).reshape(
                n, legs, signals
            )
    raise AssertionError("no cycles")


async def drain(connection: ClientConnection) -> None:
    """Read until the connection ends."""
    while True:
        await connection.recv()


def test_the_page_shows_forces_and_closures(tmp_path: Path) -> None:
    """Of the running service, with names, words and events."""

    async def test() -> None:
        with ViewedService(tmp_path / "cycles") as service:
            service.force_n[2] = 0.1, -0.2, 1.0
            service.publish(40)
            async with served(tmp_path / "cycles") as host, page(host) as browser:
                hello = await text_of(browser, "hello")
                assert (hello["mode"], hello["title"], hello["legs"]) == (
                    "live",
                    "six feet under a thumb",
                    list(LEGS),
                )
                times, tables = await cycles_of(browser)
                assert len(times) == 40
                last = tables[-1, 2]
                assert last[:3] == pytest.approx([0.1, -0.2, 1.0])
                closures = last[COLUMN["closure_0"] : COLUMN["closure_0"] + 9]
                assert closures == pytest.approx(np.linspace(0.2, 0.7, 9), abs=1e-5)
                assert tables[-1, :, COLUMN["friction"]] == pytest.approx(0.4)

    run(test)


def test_a_ground_that_nobody_told_of_for_0_3_s_is_unknown(tmp_path: Path) -> None:
    """As a consumer of CAN has it; a temperature stays."""
    service = ViewedService(tmp_path / "cycles")
    service.force_n[2] = 0.1, -0.2, 1.0
    tables = SignalTables(msgspec.json.decode(HEADER["elements"], type=ClosureConversion))
    baseline_pf = np.full((6, 9), UNLOADED_PF)
    with_gait = service.cycle(1)._replace(temperature_c=np.full(6, 21.0))
    without = service.cycle(2)
    friction, warmth = COLUMN["friction"], COLUMN["temperature"]
    for later_ns, known in ((-1, True), (300_000_000, True), (300_000_001, False)):
        t_ns = with_gait.forces.t_sent_ns + max(later_ns, 0)
        one = with_gait if later_ns < 0 else without._replace(forces=without.forces._replace(t_sent_ns=t_ns))
        table = tables.table(one, baseline_pf)
        assert np.isfinite(table[:, friction]).all() == known
        assert (table[:, warmth] == 21.0).all()
    service.close()


def test_a_slow_page_is_sent_the_newest_and_no_backlog(tmp_path: Path) -> None:
    """Without acknowledgements nothing more comes than two messages; then the newest cycles in one."""

    async def test() -> None:
        with ViewedService(tmp_path / "cycles") as service:
            service.publish()
            async with served(tmp_path / "cycles") as host, page(host) as browser:
                await cycles_of(browser)
                service.publish()
                await cycles_of(browser)
                service.publish(400)
                with pytest.raises(TimeoutError):
                    async with asyncio.timeout(0.2):
                        await cycles_of(browser)
                await browser.send('{"type": "drawn"}')
                times, _ = await cycles_of(browser)
                assert len(times) == 256
                assert times[-1] == pytest.approx(401 * 0.0027, abs=1e-6)

    run(test)


def test_a_service_that_ends_and_starts_again(tmp_path: Path) -> None:
    """The page is told, and then greeted by the next service, which may have waited for it."""

    async def test() -> None:
        path = tmp_path / "cycles"
        async with served(path) as host, page(host) as browser:
            status = await text_of(browser, "status")
            assert "no service runs" in str(status["problem"])
            for force_n in (0.5, 0.7):
                with ViewedService(path) as service:
                    service.force_n[:, 2] = force_n
                    service.publish(3)
                    assert (await text_of(browser, "hello"))["legs"] == list(LEGS)
                    _, tables = await cycles_of(browser)
                    assert tables[-1, 0, 2] == pytest.approx(force_n)
                    await browser.send('{"type": "drawn"}')
                while "has ended" not in str((await text_of(browser, "status"))["problem"]):
                    pass

    run(test)


def test_what_came_while_nobody_looked_is_not_shown_as_new(tmp_path: Path) -> None:
    """The last page saw a service that has ended; the next one sees what its successor wrote last, at once."""

    async def test() -> None:
        path = tmp_path / "cycles"
        async with served(path) as host:
            with ViewedService(path) as service:
                service.publish(3)
                async with page(host) as browser:
                    await cycles_of(browser)
                service.publish(300)
            with ViewedService(path) as service:
                service.publish(1)
                service.force_n[:, 2] = 0.7
                service.publish(1500)
                async with page(host) as browser:
                    _, tables = await cycles_of(browser)
                    assert tables[-1, 0, 2] == pytest.approx(0.7)

    run(test)


def test_other_names_and_origins_are_refused(tmp_path: Path) -> None:
    """A site whose name points here, and a page of another origin; Foxglove's own pages may read its protocol."""

    async def status_of(opening: connect) -> int:
        try:
            async with opening:
                return 101
        except InvalidStatus as refused:
            return refused.response.status_code

    async def test() -> None:
        async with served(tmp_path / "cycles") as host:
            ours, foxglove = f"http://{host}", "https://app.foxglove.dev"
            url, protocols = f"ws://{host}/", ["foxglove.websocket.v1"]
            assert await status_of(page(host, origin=ours)) == 101
            assert await status_of(page(host, origin="https://evil.example")) == 403
            assert await status_of(page(host, origin=foxglove)) == 403
            assert await status_of(connect(url, subprotocols=protocols, origin=foxglove)) == 101  # type: ignore[arg-type]
            assert await status_of(connect(url, subprotocols=protocols, origin="https://evil.example")) == 403  # type: ignore[arg-type]
            port = int(host.rpartition(":")[2])
            opening = connect(
                f"ws://evil.example:{port}/", subprotocols=[PAGE_PROTOCOL], host="127.0.0.1", port=port
            )
            assert await status_of(opening) == 421

    run(test)


def test_clients_are_bounded(tmp_path: Path) -> None:
    """One viewer too many is refused in words, and the others go on."""

    async def test() -> None:
        async with served(tmp_path / "cycles") as host:
            browsers = [await page(host) for _ in range(MAX_CLIENTS)]
            with pytest.raises(InvalidStatus) as refused:
                await page(host)
            assert refused.value.response.status_code == 503
            assert b"16 viewers are connected already" in refused.value.response.body
            await browsers.pop().close()
            while True:
                try:
                    browsers.append(await page(host))
                    break
                except InvalidStatus:
                    await asyncio.sleep(0)
            for browser in browsers:
                await browser.close()

    run(test)


RUBBISH: list[str | bytes] = [
    "",
    "null",
    "{",
    "[]",
    '{"type": "drawn", "more": 1}',
    '{"type": "chunk", "number": "one"}',
    b"\x00\xff",
    "x" * 100_000,
    "\N{SNOWMAN}" * 100,
    '{"x": ' + "[" * 60_000,
]


def test_rubbish_ends_the_connection_and_nothing_else(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """Each in one line of the log, and a reason for the page."""

    async def test() -> None:
        async with served(tmp_path / "cycles") as host, page(host) as other:
            for rubbish in RUBBISH:
                async with page(host) as browser:
                    await browser.send(rubbish)
                    with pytest.raises(ConnectionClosed):
                        await drain(browser)
            await other.send('{"type": "drawn"}')
            assert (await text_of(other, "hello"))["mode"] == "live"

    run(test)
    lines = [record.getMessage() for record in caplog.records if record.name.startswith("footsense")]
    assert len(lines) == len(RUBBISH) - 1  # the longest is refused before it is read
    assert all("\n" not in line and "was dismissed" in line for line in lines)


def test_rubbish_without_end_does_not_fill_the_log(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """Ten lines a minute, and little of what is quoted."""

    async def test() -> None:
        async with served(tmp_path / "cycles") as host:
            for _ in range(30):
                async with page(host) as browser:
                    await browser.send('{"type": "' + "x" * 60_000 + '"}')
                    with pytest.raises(ConnectionClosed):
                        await drain(browser)

    run(test)
    lines = [record.getMessage() for record in caplog.records if record.name.startswith("footsense")]
    assert 0 < len(lines) <= 20  # a new minute may have begun
    assert all(len(line) < 300 for line in lines)


def test_a_doubled_header_is_refused_with_a_reason(tmp_path: Path) -> None:
    """One of two hosts, or two origins, might be the right one; protocols may come in several."""

    async def test() -> None:
        async with served(tmp_path / "cycles") as host:
            for name in ("Host", "Upgrade", "Origin"):
                reader, writer = await asyncio.open_connection(*host.split(":"))
                headers = ["Upgrade: websocket", f"Host: {host}", f"Origin: http://{host}", f"{name}: x"]
                writer.write("\r\n".join(["GET / HTTP/1.1", *headers, "\r\n"]).encode())
                answer = (await reader.read()).decode()
                assert answer.startswith("HTTP/1.1 400 ")
                assert f"the header {name} comes more than once" in answer
                writer.close()
            async with page(host, additional_headers={"Sec-WebSocket-Protocol": "other"}) as browser:
                assert (await text_of(browser, "hello"))["mode"] == "live"

    run(test)


HEADERS_OF_OTHERS = {
    "a scene without end": {**HEADER, "scene": '{"a":' * 100_000},
    "no closures": {"scene": ""},
    "closures of other legs": {**HEADER, "elements": '{"stray_pf": [[0.0]], "distance_pf": [[0.0]]}'},
}


@pytest.mark.parametrize("kind", HEADERS_OF_OTHERS)
def test_a_ring_of_another_version_is_told_and_kept_open_by_nobody(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "cycles"
    with ViewedService(path, HEADERS_OF_OTHERS[kind]):
        live = LiveSource(path)
        n_opened = len([*Path("/proc/self/fd").iterdir()])
        for _ in range(3):
            live.poll()
            assert "its header is of another version of footsense" in live.problem
        assert len([*Path("/proc/self/fd").iterdir()]) == n_opened


def test_a_recording_comes_second_by_second(tmp_path: Path) -> None:
    """All cycles of the golden walk, its events, and its length."""

    async def test() -> None:
        recorded = RecordingSource(GOLDEN)
        recorded.read()
        async with (
            ViewServer(recorded).serving("127.0.0.1", 0) as url,
            page(url.removeprefix("http://")) as browser,
        ):
            assert (await text_of(browser, "hello"))["title"] == "measured_walk.mcap"
            assert (await text_of(browser, "status"))["end"] == pytest.approx(3.947, abs=1e-3)
            events = await text_of(browser, "events")
            kinds = {event["kind"] for event in events["events"]}  # type: ignore[attr-defined]
            assert kinds == {"touchdown", "lift-off", "state", "command"}
            n = 0
            for number in range(4):
                await browser.send(json.dumps({"type": "chunk", "number": number}))
                times, _ = await cycles_of(browser)
                assert number <= times[0] <= times[-1] < number + 1
                n += len(times)
            assert n == 585
        recorded.close()

    run(test)


def test_a_busy_port_is_one_line(tmp_path: Path) -> None:
    """With the remedy."""
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]

        async def test() -> None:
            server = ViewServer(LiveSource(tmp_path / "cycles"))
            wanted = f"127.0.0.1:{port}: Address already in use; choose another port: --port, or view.port"
            with pytest.raises(ConfigError, match=wanted):
                async with server.serving("127.0.0.1", port):
                    pass

        run(test)


def test_files_of_the_page_and_nothing_else(tmp_path: Path) -> None:
    """They may load nothing from elsewhere; all of them are small."""

    async def test() -> None:
        async with served(tmp_path / "cycles") as host:

            def get(path: str) -> tuple[int, str, bytes]:
                with urlopen(f"http://{host}{path}", timeout=TIMEOUT_S) as answer:
                    return answer.status, answer.headers["Content-Security-Policy"], answer.read()

            status, policy, page_html = await asyncio.to_thread(get, "/")
            assert status == 200
            assert "default-src 'none'" in policy
            assert b"http" not in page_html
            for path in ("/view.js", "/uPlot.js", "/uPlot.LICENSE.txt"):
                assert (await asyncio.to_thread(get, path))[2]
            for path in ("/../server.py", "/%2e%2e/server.py", "//etc/passwd", "/nothing"):
                with pytest.raises(OSError, match="404"):
                    await asyncio.to_thread(get, path)

    run(test)
    assets = Path(__file__).parents[3] / "footsense/view/assets"
    assert sum(path.stat().st_size for path in assets.iterdir()) < 500_000


def test_recordings_of_faults_are_listed_and_come_in_parts(tmp_path: Path) -> None:
    """To the page alone; nothing else in the folder, and nothing beside it."""
    faults, recording = tmp_path / "faults", "2026-11-29T12-00-00Z-lf-element-drifts.mcap"
    faults.mkdir()
    content = bytes(range(256)) * 300
    (faults / recording).write_bytes(content)
    for other in ("2026-11-29T12-01-00Z-lf-a.mcap.unfinished", "notes.txt"):
        (faults / other).write_text("other")
    (faults / "2026-11-29T12-02-00Z-lf-link.mcap").symlink_to("/etc/passwd")

    async def test() -> None:
        async with served(tmp_path / "cycles") as host:

            async def get(path: str, **headers: str) -> bytes:
                request = Request(f"http://{host}{path}", headers=headers)
                return await asyncio.to_thread(lambda: urlopen(request, timeout=TIMEOUT_S).read())

            listed = json.loads(await get("/faults"))
            assert listed["recordings"][-1] == {"name": recording, "bytes": len(content)}
            assert len(listed["recordings"]) == 2
            n = -(-len(content) // listed["part_bytes"])
            assert n > 1
            parts = [await get(f"/faults/{recording}/{k}") for k in range(n)]
            assert b"".join(parts) == content
            assert await get(f"/faults/{recording}/{n}") == b""
            names = (
                "notes.txt/0",
                f"{recording}",
                f"{recording}/-1",
                f"{recording}/{10**20}",
                "../cycles/0",
                "//0",
            )
            for name in (
                *names,
                "2026-11-29T12-02-00Z-lf-link.mcap/0",
                "%2e%2e/cycles/0",
                f"{recording}/0/0",
            ):
                with pytest.raises(OSError, match="404"):
                    await get(f"/faults/{name}")
            assert await get("/faults", Origin=f"http://{host}")
            for headers, status in (
                ({"Origin": "https://evil.example"}, "403"),
                ({"Host": "evil.example"}, "421"),
            ):
                with pytest.raises(OSError, match=status):
                    await get("/faults", **headers)
                with pytest.raises(OSError, match=status):
                    await get(f"/faults/{recording}/0", **headers)

    run(test)
