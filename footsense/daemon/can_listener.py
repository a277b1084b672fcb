"""A consumer of CAN, put together: the legs as whoever uses their forces sees them."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import NamedTuple

from firmware_interface.can_codes import NODE_IDS
from firmware_interface.socketcan import split_frames
from footsense.can.python_can import open_wire
from footsense.client import LINK_IDS, REPORT_IDS, Limits, Link, Report, Reports, Status, View
from footsense.errors import CanError
from footsense.ports import CanWire, Clock

__all__ = ["Listener", "Seen", "listening"]

#: How often the channel is read [ns].
_POLL_NS = 5_000_000


class Seen(NamedTuple):
    """One leg at a moment.

    Attributes:
        leg: Its name.
        view: What its forces are worth.
        report: What it tells beside them.
        n_forces: Frames of `Force` that came since the service or this listener began.
    """

    leg: str
    view: View
    report: Report
    n_forces: int

    @property
    def is_known(self) -> bool:
        """Whether the leg has spoken lately; else its state is only the last that it had."""
        silent = self.view.status is Status.STALE and self.report.node_state is None
        return self.n_forces > 0 and not silent


class Listener:
    """Hears everything that the legs say, and says nothing.

    Args:
        wire: The open channel.
        clock: The time of arrival.
        limits: When a force is trusted.
    """

    def __init__(self, wire: CanWire, clock: Clock, limits: Limits) -> None:
        self._wire = wire
        self._clock = clock
        self._link = Link(limits)
        self._reports = Reports()
        self._read_ns = clock.now_ns()
        self._n_forces = dict.fromkeys(NODE_IDS.values(), 0)

    def listen(self, until_ns: int) -> None:
        """Take what arrives until a time [ns].

        A frame counts as arrived when the channel was read before it: the age may look 5 ms too old, never too young.

        Raises:
            CanError: The channel is down or gone.
        """
        while (now_ns := self._clock.now_ns()) < until_ns:
            try:
                frames = self._wire.receive()
            except OSError as error:
                raise CanError(f"the CAN channel is gone: {error.strerror or error}") from error
            for can_id, data in split_frames(b"".join(frames)):
                if self._link.feed(can_id, data, self._read_ns):
                    if can_id & ~0xF == LINK_IDS[0] & ~0xF:
                        self._n_forces[can_id & 0xF] += 1
                else:
                    self._reports.feed(can_id, data, self._read_ns)
            self._read_ns = now_ns
            self._clock.sleep_until_ns(min(until_ns, now_ns + _POLL_NS))

    def look(self) -> list[Seen]:
        """Return every leg as it is now."""
        now_ns = self._clock.now_ns()
        return [
            Seen(leg, self._link.look(node, now_ns), self._reports.look(node, now_ns), self._n_forces[node])
            for leg, node in NODE_IDS.items()
        ]


@contextmanager
def listening(interface: str, channel: str, clock: Clock, limits: Limits) -> Iterator[Listener]:
    """Open a channel to listen to, and release it.

    Yields:
        The listener.

    Raises:
        CanError: The channel is missing or down.
    """
    wire = open_wire(interface, channel, 500_000, [*LINK_IDS, *REPORT_IDS])
    try:
        yield Listener(wire, clock, limits)
    finally:
        wire.close()
