"""Session of one client of Foxglove's protocol: subscriptions, requests, and messages to send."""

import json
import struct
from pathlib import Path
from typing import Any

import msgspec
from websockets.typing import Subprotocol

from footsense import __version__
from footsense.view.foxglove.channels import MIN_SCENE_INTERVAL_NS, TopicChannel, topic_channels
from footsense.view.live import LiveSource, ViewedCycle
from footsense.view.page_session import MessageSender

#: Both names of the protocol: that of Lichtblick and PlotJuggler, and that of Foxglove since 2025.
FOXGLOVE_PROTOCOLS = (Subprotocol("foxglove.sdk.v1"), Subprotocol("foxglove.websocket.v1"))

#: Longest message of a client [bytes].
MAX_REQUEST_BYTES = 65_536
#: Cycles that a slow client may lag behind; older ones are left out.
_MAX_LAG_CYCLES = 128
_MESSAGE_HEADER_STRUCT = struct.Struct("<BIQ")
_MESSAGE_DATA = 1
_WARNING, _ERROR = 1, 2


class _Subscription(msgspec.Struct, rename="camel"):
    id: int
    channel_id: int


class _Subscribe(msgspec.Struct, tag="subscribe", tag_field="op"):
    subscriptions: list[_Subscription]


class _Unsubscribe(msgspec.Struct, tag="unsubscribe", tag_field="op", rename="camel"):
    subscription_ids: list[int]


class _OtherRequest(msgspec.Struct):
    op: str


_decode = msgspec.json.Decoder(_Subscribe | _Unsubscribe).decode
_decode_other = msgspec.json.Decoder(_OtherRequest).decode


class FoxgloveSession:
    """Session of one client of Foxglove's protocol on live cycles.

    Args:
        live: The followed service.
    """

    def __init__(self, live: LiveSource) -> None:
        self._live = live
        self._greeted = False
        self._legs: tuple[str, ...] = ()
        self._n_elements = live.n_elements
        self._channels: dict[int, TopicChannel] = {}
        self._first_id = 1
        self._by_channel: dict[int, int] = {}
        self._next = 0
        self._picture_ns = 0
        self._problem = ""
        self.n_skipped = 0

    def handle_message(self, text: str | bytes) -> list[str]:
        """Process a client's message; return the answers.

        Raises:
            ValueError: It is none of this protocol.
        """
        if isinstance(text, bytes):
            return [_status_json(_ERROR, "this server takes no messages: it is read-only")]
        try:
            request = _decode(text)
        except msgspec.ValidationError as error:
            other = _decode_other(text)
            if other.op in {"subscribe", "unsubscribe"}:
                raise ValueError(str(error)) from None
            return [_status_json(_WARNING, f"{other.op[:40]}: not supported by this server")]
        if isinstance(request, _Subscribe):
            return [answer for asked in request.subscriptions for answer in self._subscribe(asked)]
        ended = set(request.subscription_ids)
        self._by_channel = {
            channel: number for channel, number in self._by_channel.items() if number not in ended
        }
        return []

    def _subscribe(self, asked: _Subscription) -> list[str]:
        if asked.channel_id not in self._channels:
            return [_status_json(_WARNING, f"no channel {asked.channel_id}")]
        if asked.channel_id in self._by_channel or asked.id in self._by_channel.values():
            return [
                _status_json(
                    _WARNING, f"subscription {asked.id} ignored: its channel or its id has one already"
                )
            ]
        if not 0 <= asked.id < 1 << 32:
            return [
                _status_json(_WARNING, f"subscription {asked.id}: its id has to be an unsigned 32-bit number")
            ]
        if not self._by_channel:
            self._next = self._newest_cycle_number + 1
        self._by_channel[asked.channel_id] = asked.id
        return []

    @property
    def _newest_cycle_number(self) -> int:
        return self._live.cycles[-1].number if self._live.cycles else -1

    async def send_new(self, connection: MessageSender, now_s: float) -> None:
        """Send what is new; wait while the client does not read, and leave out what has become old meanwhile."""
        del now_s
        if not self._greeted:
            self._greeted = True
            await connection.send(_server_info_json())
            await connection.send(_message_json(op="advertise", channels=[]))
        await self._advertise(connection)
        if self._live.problem != self._problem:
            self._problem = self._live.problem
            if self._problem:
                await connection.send(_status_json(_WARNING, self._problem))
        while self._by_channel and self._next <= self._newest_cycle_number:
            cycles = self._live.cycles
            oldest = max(cycles[0].number, self._newest_cycle_number - _MAX_LAG_CYCLES)
            self.n_skipped += max(0, oldest - self._next)
            self._next = max(self._next, oldest)
            viewed = cycles[self._next - cycles[0].number]
            self._next += 1
            await self._send_cycle(connection, viewed)

    async def _send_cycle(self, connection: MessageSender, viewed: ViewedCycle) -> None:
        t_ns = viewed.cycle.forces.t_sent_ns
        is_due = not 0 <= t_ns - self._picture_ns < MIN_SCENE_INTERVAL_NS
        if is_due:
            self._picture_ns = t_ns
        for channel_id, subscription in list(self._by_channel.items()):
            channel = self._channels[channel_id]
            if channel.is_rate_limited and not is_due:
                continue
            for message in channel.messages(viewed):
                await connection.send(
                    _MESSAGE_HEADER_STRUCT.pack(_MESSAGE_DATA, subscription, t_ns) + message
                )

    async def _advertise(self, connection: MessageSender) -> None:
        """Announce the channels of the service; anew if another service has other legs or elements."""
        if (self._live.legs, self._live.n_elements) == (self._legs, self._n_elements):
            return
        self._legs, self._n_elements = self._live.legs, self._live.n_elements
        if self._channels:
            await connection.send(_message_json(op="unadvertise", channelIds=list(self._channels)))
            self._first_id += len(self._channels)
        self._by_channel.clear()
        self._channels = dict(enumerate(topic_channels(self._legs, self._n_elements), self._first_id))
        entries = [
            {
                "id": number,
                "topic": channel.topic,
                "encoding": "json",
                "schemaName": channel.schema_name,
                "schemaEncoding": "jsonschema",
                "schema": channel.schema,
            }
            for number, channel in self._channels.items()
        ]
        await connection.send(_message_json(op="advertise", channels=entries))


class FoxgloveRefusalSession:
    """Session of a client while a recording is shown: tells it to open the file itself.

    Args:
        path: The recording.
    """

    def __init__(self, path: Path) -> None:
        self._text = f"this is the page of a recording: open {path.name} itself"
        self._sent = False

    def handle_message(self, text: str | bytes) -> list[str]:
        """Answer any request with the refusal."""
        del text
        return [_status_json(_WARNING, self._text)]

    async def send_new(self, connection: MessageSender, now_s: float) -> None:
        """Send the refusal, once."""
        del now_s
        if not self._sent:
            self._sent = True
            await connection.send(_server_info_json())
            await connection.send(_message_json(op="advertise", channels=[]))
            await connection.send(_status_json(_WARNING, self._text))


def _server_info_json() -> str:
    return _message_json(
        op="serverInfo",
        name=f"footsense {__version__}",
        capabilities=[],
        supportedEncodings=["json"],
        metadata={},
    )


def _status_json(level: int, text: str) -> str:
    return _message_json(op="status", level=level, message=text)


def _message_json(**values: Any) -> str:  # noqa: ANN401 - any JSON
    return json.dumps(values)
