"""Session of one browser page: hello, status, events, and cycles, live or of a recording.

    server -> page   hello, status, events    JSON objects with `type`
                     cycles                   binary, see `encode_cycles`
    page -> server   drawn, chunk             JSON objects with `type`

Live cycles are sent as fast as the page draws them: it acknowledges each message of cycles when it has drawn it, and at
most two are unacknowledged. A slow or hidden page is sent little or nothing, and then the newest cycles. Nothing waits
for it, and no backlog grows. The page of a recording asks for its seconds.
"""

from typing import Any

import msgspec
from websockets.asyncio.connection import Connection

from footsense import __version__
from footsense.frames import FAULT_FREE, BaselineStatus
from footsense.leg_words import CAUSE_WORDS, STATE_WORDS, phase_of, word_of
from footsense.view.live import LiveSource
from footsense.view.recorded import RecordingSource
from footsense.view.signals import SIGNALS, encode_cycles

#: Messages of cycles that a page may have ahead.
_MAX_UNDRAWN_MESSAGES = 2
#: Cycles in one message at most: those of a page that has just come, or come back.
_MAX_CYCLES_PER_MESSAGE = 256
_STATUS_PERIOD_S = 0.5


class DrawnAcknowledgement(msgspec.Struct, tag="drawn", tag_field="type", forbid_unknown_fields=True):
    """Message from the page: a message of cycles has been drawn, the next may be sent."""


class ChunkRequest(msgspec.Struct, tag="chunk", tag_field="type", forbid_unknown_fields=True):
    """Message from the page: request for one second of a recording, by number."""

    number: int


Request = DrawnAcknowledgement | ChunkRequest
_decoder: msgspec.json.Decoder[Request] = msgspec.json.Decoder(Request)


def decode_request(message: str | bytes) -> Request:
    """Return a message of the page decoded to its type.

    Raises:
        ValueError: It is none of this protocol.
    """
    if isinstance(message, bytes):
        raise ValueError("a binary message, and only text is meant")  # noqa: TRY004 - one error for all rubbish
    try:
        return _decoder.decode(message)
    except RecursionError:
        raise ValueError("a message nested without end") from None


class PageSession:
    """Session of one browser page.

    Args:
        source: The followed service, or the recording, that it shows.
    """

    def __init__(self, source: LiveSource | RecordingSource) -> None:
        self._source = source
        self._service = -1
        self._credits = _MAX_UNDRAWN_MESSAGES
        self._next = self._next_event = 0
        self._status = ""
        self._status_due_s = 0.0

    def handle_message(self, text: str | bytes) -> list[bytes]:
        """Process a message of the page; return the requested second of the recording, if any.

        Raises:
            ValueError: It is none of this protocol.
        """
        request = decode_request(text)
        if isinstance(request, DrawnAcknowledgement):
            self._credits = min(self._credits + 1, _MAX_UNDRAWN_MESSAGES)
        elif isinstance(self._source, RecordingSource):
            return self._source.encoded_second(request.number)
        return []

    async def send_new(self, connection: Connection, now_s: float) -> None:
        """Send what is new and fits the credits.

        Args:
            connection: The page.
            now_s: The time of the event loop [s].
        """
        source = self._source
        if self._credits == 0:
            return
        if self._service != source.service:
            self._service, self._status = source.service, ""
            self._next = self._next_event = 0
            await connection.send(_message("hello", {**source.description(), **_CONSTANTS}))
        status = _message("status", source.status())
        if status != self._status and (now_s >= self._status_due_s or not self._status):
            self._status, self._status_due_s = status, now_s + _STATUS_PERIOD_S
            await connection.send(status)
        if events := source.events.since(self._next_event):
            self._next_event = source.events.n
            await connection.send(_message("events", {"events": events}))
        new = (
            source.cycles_since(self._next, _MAX_CYCLES_PER_MESSAGE) if isinstance(source, LiveSource) else []
        )
        if new:
            self._next = new[-1].number + 1
            self._credits -= 1
            await connection.send(encode_cycles(0, [one.t_s for one in new], [one.table for one in new]))


def _message(kind: str, values: dict[str, Any]) -> str:
    return msgspec.json.encode({"type": kind, **values}).decode()


#: What does not depend on the robot: names of the signals, and texts of the codes, which the page shows.
_CONSTANTS = {
    "version": __version__,
    "signals": SIGNALS,
    "words": {
        "states": [
            {
                "name": word_of(state),
                "phase": word_of(phase_of(state)),
                "fault_free": state in FAULT_FREE,
                "what": words.meaning,
                "check": words.remedy,
            }
            for state, words in sorted(STATE_WORDS.items())
        ],
        "causes": [
            {"name": word_of(cause), "what": words.meaning, "check": words.remedy}
            for cause, words in sorted(CAUSE_WORDS.items())
        ],
        "baselines": [word_of(status) for status in BaselineStatus],
    },
}
