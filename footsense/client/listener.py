"""Receiver of every leg's forces and reports on CAN, for `footsense.connect`, `footsense monitor` and `ros2`."""

from collections import Counter, defaultdict, deque
from typing import NamedTuple

from firmware_interface.can.codes import NODE_IDS
from firmware_interface.can.force import QUALITY_ID
from firmware_interface.can.reports import FAULT_ID, PROTOCOL_VERSION, Identity
from firmware_interface.can.socketcan import unpack_frame
from footsense.client.gait_events import GAIT_EVENT_IDS, GaitEvents, LegEvent
from footsense.client.link import LINK_IDS, LegForce, Link, LinkLimits, LinkStatus
from footsense.client.reports import REPORT_IDS, LegReport, Reports
from footsense.errors import CanError
from footsense.ports import CanWire, Clock
from footsense.wires.address import CanAddress
from footsense.wires.opening import POLL_PERIOD_NS, open_client_wire

#: Time over which forces are counted for their rate [ns].
_NS_PER_S = 1_000_000_000
#: Most forces of a leg in a second: a bus of 1 Mbit/s carries fewer.
_MAX_ARRIVALS = 10_000


class LegSnapshot(NamedTuple):
    """Latest force, report and event of one leg, as received on CAN.

    Attributes:
        leg: Its name.
        force: Its force and whether it may be used.
        report: Its last reports.
        n_force_frames: Forces received so far, each by its last frame, `Quality`.
        rate_hz: Forces in the last second; None before one has passed.
        event: Its last gait event; None before the first.
        event_ago_ns: Time since it happened [ns]; None if that is not known.
        identity: Version, force step and foot type; None before the first was received.
    """

    leg: str
    force: LegForce
    report: LegReport
    n_force_frames: int
    rate_hz: int | None = None
    event: LegEvent | None = None
    event_ago_ns: int | None = None
    identity: Identity | None = None

    @property
    def is_current(self) -> bool:
        """Whether frames arrived recently; otherwise the state is the last one received."""
        silent = self.force.status is LinkStatus.STALE and self.report.heartbeat is None
        return self.n_force_frames > 0 and not silent


class Listener:
    """Receives all legs' frames from CAN without sending anything.

    Args:
        wire: The open channel.
        clock: The time of arrival.
        limits: Limits for using a force.

    Attributes:
        close: Closes the channel.
    """

    def __init__(self, wire: CanWire, clock: Clock, limits: LinkLimits) -> None:
        self._wire = wire
        self.close = wire.close
        self._clock = clock
        self._link = Link(limits)
        self._reports = Reports()
        self._events = GaitEvents()
        self._last_events: dict[int, LegEvent] = {}
        self._last_poll_ns = clock.now_ns()
        self._n_force_frames = Counter[int]()  # by node
        self._began_ns = clock.now_ns()
        #: Times of arrival of each node's forces in the last second [ns].
        self._arrivals_ns: defaultdict[int, deque[int]] = defaultdict(lambda: deque(maxlen=_MAX_ARRIVALS))

    @property
    def n_forces(self) -> int:
        """Forces of all legs received so far."""
        return self._n_force_frames.total()

    def listen(self, until_ns: int) -> list[LegEvent]:
        """Receive and decode CAN frames until a time [ns]; return the gait events among them, errors as of `poll`."""
        events = []
        while (now_ns := self._clock.now_ns()) < until_ns:
            events += self.poll()
            self._clock.sleep_until_ns(min(until_ns, now_ns + POLL_PERIOD_NS))
        return events

    def poll(self) -> list[LegEvent]:
        """Receive and decode the CAN frames that have arrived, without waiting; return the gait events among them.

        A frame counts as arrived at the previous poll: its age may be too high, by the time between two, never too low.

        Raises:
            CanError: The channel is down or gone, or a leg's frames are of a version that is not known.
        """
        now_ns, events = self._clock.now_ns(), []
        try:
            frames = self._wire.receive()
        except OSError as error:
            raise CanError(f"the CAN channel is gone: {error.strerror or error}") from error
        for can_id, data in map(unpack_frame, frames):
            if self._link.feed(can_id, data, self._last_poll_ns):
                node = can_id - QUALITY_ID
                self._n_force_frames[node] += 1
                self._arrivals_ns[node].append(now_ns)
                if not FAULT_ID < can_id <= FAULT_ID + len(NODE_IDS):  # the reports have a fault's cause
                    continue
            if event := self._events.feed(can_id, data, self._last_poll_ns):
                self._last_events[event.node] = event
                events.append(event)
            else:
                self._reports.feed(can_id, data, self._last_poll_ns)
        self._refuse_unknown_identities()
        self._last_poll_ns = now_ns
        return events

    def _refuse_unknown_identities(self) -> None:
        for leg, node in NODE_IDS.items():
            told = self._link.identity(node)
            if told is not None and not told.is_known:
                raise CanError(
                    f"the service of leg {leg} sends version {told.version} of the CAN frames with forces in steps of "
                    f"{told.force_step_mn} mN, which this footsense (version {PROTOCOL_VERSION}) cannot read: install "
                    "the same footsense on both computers"
                )

    def snapshot(self) -> list[LegSnapshot]:
        """Return the latest values of every leg that was heard, at the present time."""
        now_ns = self._clock.now_ns()
        snapshots = []
        for leg, node in NODE_IDS.items():
            report = self._reports.leg(node, now_ns)
            if not self._n_force_frames[node] and report.heartbeat is None:
                continue
            arrivals_ns = self._arrivals_ns[node]
            while arrivals_ns and arrivals_ns[0] <= now_ns - _NS_PER_S:
                arrivals_ns.popleft()
            event = self._last_events.get(node)
            snapshots.append(
                LegSnapshot(
                    leg,
                    self._link.leg(node, now_ns),
                    report,
                    self._n_force_frames[node],
                    len(arrivals_ns) if now_ns >= self._began_ns + _NS_PER_S else None,
                    event,
                    None if event is None or event.t_ns is None else now_ns - event.t_ns,
                    self._link.identity(node),
                )
            )
        return snapshots


def open_listener(address: CanAddress, clock: Clock, limits: LinkLimits) -> Listener:
    """Open a CAN interface for listening only; arguments as of `Listener`.

    Raises:
        CanError: The channel is missing or down.
    """
    accept = {*LINK_IDS, *REPORT_IDS, *GAIT_EVENT_IDS}  # both of the first have faults
    return Listener(open_client_wire(address, accept), clock, limits)
