"""Session of one browser page: live cycles, sent as fast as the page draws them, or seconds of a recording.

A page acknowledges each message of cycles when it has drawn it, and at most two are unacknowledged: a slow or hidden
page is sent little or nothing, and then the newest cycles. Nothing waits for it, and no backlog grows.
"""

import asyncio
from typing import Protocol

import msgspec

from footsense.view.live import LiveSource
from footsense.view.page_messages import (
    ChunkRequest,
    DrawnAcknowledgement,
    decode_request,
    encode_cycles,
    events_message,
    hello_message,
    message,
)
from footsense.view.recorded import RecordingSource

#: Messages of cycles that a page may have ahead.
_MAX_UNDRAWN_MESSAGES = 2
#: Cycles in one message at most: those of a page that has just come, or come back.
_MAX_CYCLES_PER_MESSAGE = 256
_STATUS_PERIOD_S = 0.5


class MessageSender(Protocol):
    """Interface of the sending side of a WebSocket."""

    async def send(self, message: str | bytes) -> None:
        """Send a message; wait while the peer does not read."""
        ...


class LivePageSession:
    """Session of one browser page that shows live cycles.

    Args:
        live: The followed service.
    """

    def __init__(self, live: LiveSource) -> None:
        self._live = live
        self._credits = _MAX_UNDRAWN_MESSAGES
        self._service = -1
        self._next = 0
        self._next_event = 0
        self._status = ""
        self._status_due_s = 0.0

    def handle_message(self, text: str | bytes) -> list[str | bytes]:
        """Process a message of the page; return the answers.

        Raises:
            ValueError: It is none of this protocol.
        """
        if isinstance(decode_request(text), DrawnAcknowledgement):
            self._credits = min(self._credits + 1, _MAX_UNDRAWN_MESSAGES)
        return []

    async def send_new(self, connection: MessageSender, now_s: float) -> None:
        """Send what is new and fits the credits.

        Args:
            connection: The page.
            now_s: The time of the event loop [s].
        """
        live = self._live
        if self._credits == 0:
            return
        if self._service != live.service:
            self._service, self._status = live.service, ""
            await connection.send(live_hello(live))
        status = message("status", live.status())
        if status != self._status and (now_s >= self._status_due_s or not self._status):
            self._status, self._status_due_s = status, now_s + _STATUS_PERIOD_S
            await connection.send(status)
        events = [(number, event) for number, event in live.events if number >= self._next_event]
        if events:
            self._next_event = events[-1][0] + 1
            timed = [(live.event_time_s(event), event) for _, event in events]
            await connection.send(events_message(timed, live.legs))
        if not live.cycles or live.cycles[-1].number < self._next:
            return
        n_new = min(live.cycles[-1].number + 1 - self._next, len(live.cycles), _MAX_CYCLES_PER_MESSAGE)
        new = [live.cycles[-k] for k in range(n_new, 0, -1)]
        self._next = new[-1].number + 1
        self._credits -= 1
        await connection.send(encode_cycles(0, [one.t_s for one in new], [one.table for one in new]))


class RecordingPageSession:
    """Session of one browser page that shows a recording, and requests it second by second.

    Args:
        recorded: The recording.
    """

    def __init__(self, recorded: RecordingSource) -> None:
        self._recorded = recorded
        self._n_events = 0
        self._progress = ""

    async def send_new(self, connection: MessageSender, now_s: float) -> None:
        """Send how much has been read, and its events."""
        del now_s
        recorded = self._recorded
        if not self._progress:
            await connection.send(recording_hello(recorded))
        events = recorded.events[self._n_events :]
        if events:
            self._n_events += len(events)
            await connection.send(events_message(events, recorded.legs))
        values = {
            "end": recorded.end_s if recorded.done else float(recorded.n_seconds),
            "total": recorded.total_s,
            "damage": recorded.damage,
            "done": recorded.done,
        }
        text = message("progress", values)
        if text != self._progress:
            self._progress = text
            await connection.send(text)

    def handle_message(self, text: str | bytes) -> list[str | bytes]:
        """Process a message of the page; return the requested second of the recording, if any.

        Raises:
            ValueError: It is none of this protocol.
        """
        request = decode_request(text)
        if isinstance(request, ChunkRequest) and (cycles := self._recorded.encoded_second(request.number)):
            return [cycles]
        return []


def recording_hello(recorded: RecordingSource) -> str:
    """Return the first message to a page that shows a recording."""
    is_simulated = bool(recorded.header.get("scene"))
    return hello_message("replay", recorded.path.name, recorded.legs, simulated=is_simulated)


def live_hello(live: LiveSource) -> str:
    """Return the first message to a page that shows a running service."""
    scene = msgspec.json.decode(live.header.get("scene") or "{}")
    title = scene.get("description", "") if scene else "on the robot" if live.legs else "no service"
    return hello_message("live", title, live.legs, simulated=bool(scene))


class WakeUpSignal:
    """Repeatable signal that wakes all waiting asyncio tasks."""

    def __init__(self) -> None:
        self._event = asyncio.Event()

    def wake_all(self) -> None:
        """Wake every task that waits for the signal."""
        self._event.set()
        self._event = asyncio.Event()

    async def wait(self) -> None:
        """Wait for the next wake-up."""
        await self._event.wait()
