"""One port for the page and for Foxglove: HTTP, WebSockets, and the checks of who connects.

All runs in one thread. The cycles are polled; nothing in the service wakes, waits or knows of it.
"""

import asyncio
import errno
import logging
import signal
from collections.abc import Callable
from contextlib import suppress
from http import HTTPStatus

from websockets.asyncio.server import Server, ServerConnection, serve
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response
from websockets.typing import Subprotocol

from footsense.errors import ConfigError
from footsense.view.access import MAX_CLIENTS, is_allowed_origin, is_own_host, own_names
from footsense.view.assets import Assets, text_response
from footsense.view.live import Live
from footsense.view.page_messages import MAX_REQUEST_BYTES, ChunkRequest, Drawn, decode_request
from footsense.view.page_messages import Request as PageRequest
from footsense.view.page_session import LivePage, Pulse, RecordingPage
from footsense.view.recorded import Recorded

_log = logging.getLogger(__name__)

#: Period of polling the cycles while somebody looks [s]: 60 pictures a second.
_POLL_S = 0.015
#: Bytes towards a client that waits, from which the sender waits too.
_WRITE_LIMIT = 32_768
#: WebSocket's close code for a message that breaks the rules.
_POLICY_VIOLATION = 1008

PAGE_PROTOCOL = Subprotocol("footsense.view.v1")


class ViewServer:
    """The server of one service or recording.

    Args:
        source: The followed service, or a recording.
    """

    def __init__(self, source: Live | Recorded) -> None:
        self._source = source
        self._assets = Assets()
        self._names = own_names()
        self._pulse = Pulse()
        self._n_clients = 0

    async def run(self, address: str, port: int, on_ready: Callable[[str], None]) -> None:
        """Serve until SIGINT or SIGTERM.

        Args:
            address: IP address to listen on.
            port: TCP port; 0 for any free one.
            on_ready: Called with the address of the page.

        Raises:
            ConfigError: The port is in use or needs privileges, or the address is not of this machine.
        """
        logging.getLogger("websockets").setLevel(
            logging.CRITICAL
        )  # a failed handshake is the client's affair
        loop, stop = asyncio.get_running_loop(), asyncio.Event()
        for number in (signal.SIGINT, signal.SIGTERM):
            loop.add_signal_handler(number, stop.set)
        try:
            server = await self._serve(address, port)
        except OSError as error:
            remedy = "view.address has to be an address of this machine, such as 127.0.0.1"
            if error.errno in {errno.EADDRINUSE, errno.EACCES}:
                remedy = "choose another port: --port, or view.port"
            raise ConfigError(
                f"the page cannot be served on {address}:{port}: {error.strerror}; {remedy}"
            ) from error
        async with server:
            host = f"[{address}]" if ":" in address else address
            on_ready(f"http://{host}:{server.sockets[0].getsockname()[1]}")
            poller = asyncio.create_task(self._poll())
            await stop.wait()
            poller.cancel()

    async def _serve(self, address: str, port: int) -> Server:
        return await serve(
            self._session,
            address,
            port,
            process_request=self._answer,
            subprotocols=[PAGE_PROTOCOL],
            compression=None,
            max_size=MAX_REQUEST_BYTES,
            max_queue=4,
            write_limit=_WRITE_LIMIT,
            server_header=None,
            close_timeout=1.0,
        )

    async def _poll(self) -> None:
        while True:
            if self._n_clients:
                if isinstance(self._source, Live):
                    self._source.poll()
                self._pulse.wake()
            await asyncio.sleep(_POLL_S)

    def _answer(self, connection: ServerConnection, request: Request) -> Response | None:
        """Answer a request: a file, a refusal, or None to go on with a WebSocket."""
        del connection
        host = request.headers.get("Host")
        if not is_own_host(host, self._names):
            return text_response(
                HTTPStatus.MISDIRECTED_REQUEST,
                "footsense view: Host is none of this computer's names; use its IP address",
            )
        if request.headers.get("Upgrade", "").lower() != "websocket":
            return self._assets.response(request.path)
        if not is_allowed_origin(request.headers.get("Origin"), host):
            return text_response(
                HTTPStatus.FORBIDDEN, "footsense view: pages of other origins may not read this"
            )
        if self._n_clients >= MAX_CLIENTS:
            return text_response(
                HTTPStatus.SERVICE_UNAVAILABLE, f"footsense view: {MAX_CLIENTS} viewers are connected already"
            )
        return None

    async def _session(self, connection: ServerConnection) -> None:
        self._n_clients += 1
        try:
            with suppress(ConnectionClosed):
                await self._serve_page(connection)
        finally:
            self._n_clients -= 1

    async def _serve_page(self, connection: ServerConnection) -> None:
        source = self._source
        page = LivePage(source, commands=False) if isinstance(source, Live) else RecordingPage(source)
        sender = asyncio.create_task(self._send(connection, page))
        try:
            async for text in connection:
                try:
                    await self._execute(decode_request(text), connection, page)
                except ValueError as error:
                    _log.warning("a viewer sent no message of this protocol, and was dismissed: %s", error)
                    await connection.close(_POLICY_VIOLATION, "no message of this protocol")
                    return
        finally:
            sender.cancel()

    async def _execute(
        self, request: PageRequest, connection: ServerConnection, page: LivePage | RecordingPage
    ) -> None:
        """Execute a page's request; ignore one for the other kind of page."""
        if isinstance(request, Drawn) and isinstance(page, LivePage):
            page.acknowledge()
        elif isinstance(request, ChunkRequest) and isinstance(page, RecordingPage):
            await page.send_second(connection, request.number)

    async def _send(self, connection: ServerConnection, page: LivePage | RecordingPage) -> None:
        loop = asyncio.get_running_loop()
        with suppress(ConnectionClosed):
            while True:
                await page.send_new(connection, loop.time())
                await self._pulse.wait()
