"""The legs' gait on CAN: events at once, contact and ground at a slow rate, with their counters."""

from collections import deque
from collections.abc import Sequence

from firmware_interface.can.crc8 import next_counter
from firmware_interface.can.gait import (
    GAIT_EVENT_ID,
    GAIT_ID,
    GROUND_ID,
    encode_gait,
    encode_gait_event,
    encode_ground,
)
from firmware_interface.can.socketcan import pack_frame
from footsense.frames import GaitEvent, GaitFrame

#: Period of `Gait` and `Ground` [ns].
_PERIOD_NS = 100_000_000
#: Events that wait for room at most; the oldest is lost first.
_MAX_WAITING_EVENTS = 24


class GaitFrames:
    """The frames of the legs' gait that are to be sent.

    Args:
        nodes: CAN node id of each leg.

    Attributes:
        events: Events that wait to be sent, oldest first, each with whether all feet were in the air then.
        waiting: Rows of the legs whose slow frames wait.
    """

    def __init__(self, nodes: Sequence[int]) -> None:
        self._nodes = nodes
        self._event_counters, self._counters = [0] * len(nodes), [0] * len(nodes)
        self.events: deque[tuple[GaitEvent, bool]] = deque(maxlen=_MAX_WAITING_EVENTS)
        self._gait: GaitFrame | None = None
        self._due_ns = 0
        self.waiting: deque[int] = deque()

    def take(self, gait: GaitFrame) -> None:
        """Queue the events of a gait frame, and its slow frames if they are due."""
        self.events += [(event, gait.all_in_air) for event in gait.events]
        if gait.t_ns >= self._due_ns:
            self._due_ns = (gait.t_ns // _PERIOD_NS + 1) * _PERIOD_NS
            self._gait = gait
            self.waiting = deque(range(len(self._nodes)))

    def event_frames(self, now_ns: int, room: int) -> list[bytes]:
        """Return the CAN frames of the oldest unsent events, `room` at most; report the accepted ones to `set_sent`.

        Args:
            now_ns: Time of sending [ns].
            room: Number of frames.
        """
        counters = self._event_counters.copy()
        frames = []
        for event, all_in_air in list(self.events)[:room]:
            node, counter = self._nodes[event.leg], counters[event.leg]
            counters[event.leg] = next_counter(counter)
            data = encode_gait_event(
                node, counter, event.kind, now_ns - event.t_ns, event.sigma_s, all_in_air=all_in_air
            )
            frames.append(pack_frame(GAIT_EVENT_ID + node, data))
        return frames

    def set_sent(self, n: int) -> None:
        """Remove the `n` oldest events, which were sent."""
        for _ in range(n):
            event, _ = self.events.popleft()
            self._event_counters[event.leg] = next_counter(self._event_counters[event.leg])

    def slow_frames(self, room: int) -> list[bytes]:
        """Return `Gait` and `Ground` of the legs that wait, `room` frames at most."""
        frames: list[bytes] = []
        for _ in range(min(len(self.waiting), room // 2)):
            frames += self._of_leg(self.waiting.popleft())
        return frames

    def _of_leg(self, row: int) -> tuple[bytes, bytes]:
        gait, node, counter = self._gait, self._nodes[row], self._counters[row]
        assert gait is not None
        self._counters[row] = next_counter(counter)
        contact = encode_gait(
            node,
            counter,
            gait.slip.item(row),
            gait.probability.item(row),
            gait.load_share.item(row),
            contact=gait.contact.item(row),
            contact_raw=gait.contact_raw.item(row),
            all_in_air=gait.all_in_air,
        )
        ground = encode_ground(
            node,
            counter,
            gait.normal[row].tolist(),
            gait.normal_sigma_rad.item(row),
            gait.friction_use.item(row),
            gait.friction_use_sigma.item(row),
            gait.friction,
        )
        return pack_frame(GAIT_ID + node, contact), pack_frame(GROUND_ID + node, ground)
