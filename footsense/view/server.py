"""Web server of page and Foxglove's programs on one port: HTTP, WebSockets, access checks.

A program of Foxglove's protocol is connected to the server of Foxglove's SDK, which checks neither Host nor Origin, and
so listens where no page finds it.

All runs in one thread. The cycles are polled; nothing in the service wakes, waits or knows of it.
"""

import asyncio
import logging
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from http import HTTPStatus
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from websockets.asyncio.client import connect
from websockets.asyncio.connection import Connection
from websockets.asyncio.server import ServerConnection, serve
from websockets.datastructures import MultipleValuesError
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response
from websockets.typing import Subprotocol

from footsense.errors import install_line, serving_errors
from footsense.recording.fault_recordings import FAULT_FOLDER
from footsense.view.http_answers import (
    file_response,
    is_allowed_origin,
    is_own_host,
    own_host_names,
    page_files,
    text_response,
)
from footsense.view.live import LiveSource
from footsense.view.page_session import PageSession
from footsense.view.recorded import RecordingSource

if TYPE_CHECKING:
    from footsense.view.foxglove import FoxgloveFeed

_log = logging.getLogger(__name__)

#: Connections at most: pages and Foxglove's programs together.
MAX_CLIENTS = 16
#: Period of polling the cycles while somebody looks [s]: 60 pictures a second.
_POLL_PERIOD_S = 0.015
#: Bytes towards a client that waits, from which the sender waits too.
_WRITE_BUFFER_BYTES = 32_768
#: Longest message of a client [bytes].
_MAX_REQUEST_BYTES = 65_536
#: Time in which a connection has to ask for something [s].
_OPEN_TIMEOUT_S = 5.0
#: Lines of the log about viewers, and characters that each quotes.
_MAX_WARNINGS_PER_MINUTE, _MAX_WARNING_CHARACTERS = 10, 200
#: WebSocket's close code for a message that breaks the rules.
_CLOSE_CODE_POLICY_VIOLATION = 1008

PAGE_PROTOCOL = Subprotocol("footsense.view.v1")
#: Both names of one protocol: that of Foxglove since 2025 and its SDK, and that of older Lichtblicks and PlotJuggler.
FOXGLOVE_PROTOCOLS = (Subprotocol("foxglove.sdk.v1"), Subprotocol("foxglove.websocket.v1"))
#: Origins of Foxglove's and Lichtblick's own pages and desktop applications, which may read by this protocol.
_FOXGLOVE_ORIGINS = frozenset(
    {"https://app.foxglove.dev", "https://studio.foxglove.dev", "http://localhost:8080", "file://"}
)


class ViewServer:
    """Web server for one running service or one recording.

    Args:
        source: The followed service, or a recording.
        faults: Folder of the recordings of faults, which need not exist.

    Attributes:
        source: As given.
    """

    def __init__(self, source: LiveSource | RecordingSource, faults: Path = FAULT_FOLDER) -> None:
        self.source, self._faults = source, faults
        self._files = page_files()
        self._names = own_host_names()
        self._has_polled = asyncio.Condition()
        self._n_clients = 0
        self._minute = self._n_warnings = 0
        self._foxglove: FoxgloveFeed | None = None

    @asynccontextmanager
    async def serving(self, address: str, port: int) -> AsyncIterator[str]:
        """Serve as long as the context lasts.

        Args:
            address: IP address to listen on.
            port: TCP port; 0 for any free one.

        Yields:
            The address of the page.

        Raises:
            ConfigError: The port is in use or needs privileges, or the address is not of this machine.
        """
        # A failed handshake is the client's affair.
        logging.getLogger("websockets").setLevel(logging.CRITICAL)
        with serving_errors("the page", "view", address, port):
            server = await serve(
                self._session,
                address,
                port,
                process_request=self._answer_http,
                subprotocols=[PAGE_PROTOCOL, *FOXGLOVE_PROTOCOLS],
                open_timeout=_OPEN_TIMEOUT_S,
                compression=None,
                max_size=_MAX_REQUEST_BYTES,
                max_queue=4,
                write_limit=_WRITE_BUFFER_BYTES,
                server_header=None,
                close_timeout=1.0,
            )
        async with server:
            poller = asyncio.create_task(self._poll())
            host = f"[{address}]" if ":" in address else address
            try:
                yield f"http://{host}:{server.sockets[0].getsockname()[1]}"
            finally:
                poller.cancel()
                if self._foxglove is not None:
                    self._foxglove.close()

    async def _poll(self) -> None:
        while True:
            if self._n_clients:
                if isinstance(self.source, LiveSource):
                    self.source.poll()
                if self._foxglove is not None:
                    self._foxglove.publish()
                async with self._has_polled:
                    self._has_polled.notify_all()
            await asyncio.sleep(_POLL_PERIOD_S)

    def _answer_http(self, connection: ServerConnection, request: Request) -> Response | None:
        """Return the HTTP response to a request: a file or a refusal; None to accept a WebSocket."""
        del connection
        try:
            return self._answer_headers(request)
        except MultipleValuesError as error:
            return text_response(HTTPStatus.BAD_REQUEST, f"the header {error.args[0]} comes more than once")

    def _answer_headers(self, request: Request) -> Response | None:
        """Return the response to a request, as `_answer_http`.

        Raises:
            MultipleValuesError: A header that decides comes more than once.
        """
        host = request.headers.get("Host")
        if not is_own_host(host, self._names):
            return text_response(
                HTTPStatus.MISDIRECTED_REQUEST,
                "Host is none of this computer's names; use its IP address",
            )
        protocols = ",".join(request.headers.get_all("Sec-WebSocket-Protocol"))
        asked = {name.strip() for name in protocols.split(",")}
        is_page = PAGE_PROTOCOL in asked or not asked.intersection(FOXGLOVE_PROTOCOLS)
        if not is_allowed_origin(request.headers.get("Origin"), host, () if is_page else _FOXGLOVE_ORIGINS):
            return text_response(HTTPStatus.FORBIDDEN, "pages of other origins may not read this")
        if request.headers.get("Upgrade", "").lower() != "websocket":
            return file_response(self._files, self._faults, request.path)
        if self._n_clients >= MAX_CLIENTS:
            return text_response(
                HTTPStatus.SERVICE_UNAVAILABLE, f"{MAX_CLIENTS} viewers are connected already"
            )
        problem = self._foxglove_problem() if asked.intersection(FOXGLOVE_PROTOCOLS) else ""
        if problem:
            self._warn("no connection to Foxglove: %s", problem)
            return text_response(HTTPStatus.NOT_IMPLEMENTED, problem)
        return None

    def _warn(self, text: str, why: str) -> None:
        """Log what a viewer did, a few times a minute: whoever reaches the port can do it without end."""
        minute = int(asyncio.get_running_loop().time() // 60)
        if minute != self._minute:
            self._minute, self._n_warnings = minute, 0
        self._n_warnings += 1
        if self._n_warnings <= _MAX_WARNINGS_PER_MINUTE:
            _log.warning(text, why[:_MAX_WARNING_CHARACTERS])

    def _foxglove_problem(self) -> str:
        if isinstance(self.source, RecordingSource):
            return f"this is the page of a recording: open {self.source.path.name} itself"
        if find_spec("foxglove") is None:
            return f"Foxglove, Lichtblick and PlotJuggler need foxglove-sdk; {install_line('foxglove')}"
        return ""

    async def _session(self, connection: ServerConnection) -> None:
        self._n_clients += 1
        if isinstance(self.source, LiveSource):
            self.source.catch_up()
        try:
            with suppress(ConnectionClosed):
                if connection.subprotocol in FOXGLOVE_PROTOCOLS and isinstance(self.source, LiveSource):
                    await self._relay_foxglove(connection, self.source)
                else:
                    await self._serve_page(connection)
        finally:
            self._n_clients -= 1

    async def _relay_foxglove(self, connection: ServerConnection, live: LiveSource) -> None:
        """Relay a program of Foxglove's protocol to the SDK's server, which starts with the first of them."""
        if self._foxglove is None:
            from footsense.view.foxglove import FoxgloveFeed

            self._foxglove = FoxgloveFeed(live)
        url = f"ws://{self._foxglove.address}"
        # What has been read ahead of a client that left is in the way of the end: do not wait for it.
        async with connect(
            url,
            subprotocols=FOXGLOVE_PROTOCOLS[:1],
            compression=None,
            max_size=None,
            proxy=None,
            close_timeout=0.1,
        ) as sdk:
            self._foxglove.publish()
            answers = asyncio.create_task(_forward(sdk, connection))
            try:
                await _forward(connection, sdk)
            finally:
                answers.cancel()

    async def _serve_page(self, connection: ServerConnection) -> None:
        page = PageSession(self.source)
        sender = asyncio.create_task(self._send_new(connection, page))
        try:
            async for text in connection:
                try:
                    answers = page.handle_message(text)
                except ValueError as error:
                    self._warn("a viewer sent no message of its protocol, and was dismissed: %s", str(error))
                    await connection.close(_CLOSE_CODE_POLICY_VIOLATION, "no message of this protocol")
                    return
                for answer in answers:
                    await connection.send(answer)
        finally:
            sender.cancel()

    async def _send_new(self, connection: ServerConnection, page: PageSession) -> None:
        loop = asyncio.get_running_loop()
        with suppress(ConnectionClosed):
            while True:
                await page.send_new(connection, loop.time())
                async with self._has_polled:
                    await self._has_polled.wait()


async def _forward(source: Connection, target: Connection) -> None:
    """Send each message of one connection to another, until either ends."""
    with suppress(ConnectionClosed):
        async for message in source:
            await target.send(message)
    await target.close()
