"""Live cycles for Foxglove, Lichtblick and PlotJuggler, by Foxglove's SDK; needs the extra `foxglove`.

The topics are those of a recording, with its messages and schemas.

The SDK's server lets in whoever connects, also a page of another origin in a browser on this computer: it has no socket
but TCP, and no option for origins or a password. So it listens on one of 16 million addresses of the loopback, another
each time, which `server` alone knows: a page would have to try all of them, each with 28 000 ports.
"""

import secrets

from foxglove import Channel, Context, Schema, StatusLevel, set_log_level, start_server

from footsense import __version__
from footsense.clock import stopwatch_ns
from footsense.recording import messages
from footsense.view.live import LiveSource

#: Cycles at most that are handed to the SDK at once, if this process was held up.
_MAX_LAG_CYCLES = 128
#: Messages that the SDK keeps for a slow client; then it drops the oldest.
_BACKLOG_MESSAGES = 512
#: Time after which clients are told again why no cycles come: the SDK tells those alone that it has let in by then.
_TELL_PERIOD_NS = 1_000_000_000


class FoxgloveFeed:
    """Feeds a server of Foxglove's SDK on the loopback with the live cycles.

    Args:
        live: The followed service.

    Attributes:
        address: Address and port of the SDK's server.
    """

    def __init__(self, live: LiveSource) -> None:
        set_log_level("ERROR")
        self._live = live
        self._context = Context()
        host = ".".join(["127", *(str(1 + secrets.randbelow(254)) for _ in range(3))])
        self._server = start_server(
            name=f"footsense {__version__}",
            host=host,
            port=0,
            capabilities=[],
            context=self._context,
            message_backlog_size=_BACKLOG_MESSAGES,
        )
        self.address = f"{host}:{self._server.port}"
        self._service = 0
        self._channels: dict[str, Channel] = {}
        self._next = 0
        self._tell_at_ns = 0

    def publish(self) -> None:
        """Hand the cycles that are new to the SDK, as far as a client has subscribed; without a service, tell why."""
        live = self._live
        if (now_ns := stopwatch_ns()) >= self._tell_at_ns:
            self._tell_at_ns = now_ns + _TELL_PERIOD_NS
            if live.problem:
                self._server.publish_status(live.problem, StatusLevel.Warning, id="service")
            else:
                self._server.remove_status(["service"])
        if live.service != self._service:
            self._service, self._next = live.service, 0
            for channel in self._channels.values():
                channel.close()
            self._channels = {
                topic: self._channel(topic, schema)
                for topic, schema in messages.topic_schemas(live.legs).items()
            }
        new = live.cycles_since(self._next, _MAX_LAG_CYCLES)
        if new:
            self._next = new[-1].number + 1
        subscribed = {topic: channel for topic, channel in self._channels.items() if channel.has_sinks()}
        for viewed in new if subscribed else ():
            for topic, channel in subscribed.items():
                for _, data in messages.ENCODERS[topic](viewed.cycle, live.legs):
                    channel.log(data, log_time=viewed.cycle.forces.t_sent_ns)

    def _channel(self, topic: str, definition: bytes) -> Channel:
        schema = Schema(name=f"footsense.{topic[1:]}", encoding="jsonschema", data=definition)
        return Channel(topic, message_encoding="json", schema=schema, context=self._context)

    def close(self) -> None:
        """Stop the server."""
        self._server.stop()
