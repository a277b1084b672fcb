"""Content and counters of each leg's reports on CAN: fault report, heartbeat, baseline, identity, calibration, gait."""

from collections import deque
from collections.abc import Iterable, Sequence
from functools import cache, partial
from typing import Any

import numpy as np

from firmware_interface.can.codes import Cause, NmtState, State
from firmware_interface.can.crc8 import next_counter
from firmware_interface.can.gait import GAIT_EVENT, GROUND, GaitEventFrame, Ground
from firmware_interface.can.reports import (
    BASELINE,
    CALIBRATION,
    FAULT,
    HEARTBEAT_ID,
    IDENTITY,
    Baseline,
    CalibrationFrame,
    Fault,
    Identity,
    encode_heartbeat,
)
from firmware_interface.can.socketcan import pack_frame
from footsense.frames import ContactFrame, GaitEvent, GaitFrame

#: A leg whose chips do not answer waits for them as one without a baseline waits for its tare.
_NMT_OF_STATE = {
    State.STOPPED: NmtState.STOPPED,
    State.ABSENT: NmtState.PRE_OPERATIONAL,
    State.STARTING: NmtState.PRE_OPERATIONAL,
    State.CONVERTER_FAULT: NmtState.PRE_OPERATIONAL,
    State.NO_BASELINE: NmtState.PRE_OPERATIONAL,
    State.TARING: NmtState.PRE_OPERATIONAL,
}


def heartbeat_frame(node: int, nmt_state: NmtState, *, degraded_timing: bool = False) -> bytes:
    """Return a node's heartbeat as `struct can_frame`."""
    data = encode_heartbeat(nmt_state, degraded_timing=degraded_timing)
    return pack_frame(HEARTBEAT_ID + node, data)


@cache
def heartbeat_of_state(node: int, state: int, degraded_timing: bool) -> bytes:  # noqa: FBT001 - called positionally
    """Return the heartbeat of a node, as `struct can_frame`, for its leg's state."""
    nmt_state = _NMT_OF_STATE.get(State(state), NmtState.OPERATIONAL)
    return heartbeat_frame(node, nmt_state, degraded_timing=degraded_timing)


class CanLeg:
    """Fault reports, baselines, identities and calibrations of one leg, with their counters.

    Args:
        row: Its row in the frames.
        identity: Its first `Identity`, with its node.
        calibration: Its first `Calibration`, same.

    Attributes:
        node: Its CAN node id.
        reported: State, element mask and cause of the last fault report that was sent.
    """

    def __init__(self, row: int, identity: Identity, calibration: CalibrationFrame) -> None:
        self._row = row
        self.node = identity.node
        self._identity, self._calibration = identity, calibration
        self._fault_counter = 0
        self._baseline_counter = 0
        # As if stopped until now: the first state is a change, and a consumer that was here before receives it.
        self.reported = (int(State.STOPPED), 0, int(Cause.NONE))

    def fault_frame(self, state: int, mask: int, cause: int) -> bytes:
        """Return a fault report as `struct can_frame`; call `set_reported` once it is sent."""
        before = State(self.reported[0])
        return FAULT.pack(Fault(self.node, self._fault_counter, State(state), before, mask, Cause(cause)))

    def set_reported(self, report: tuple[int, int, int]) -> None:
        """Store the fault report that was just sent (state, mask, cause), and advance the fault counter."""
        self._fault_counter = next_counter(self._fault_counter)
        self.reported = report

    def baseline_frame(self, frame: ContactFrame) -> bytes:
        """Return the leg's baseline as `struct can_frame`: status, mean and worst drift [pF], age [ns]."""
        status, mean_pf, worst_pf, moved_ns = [column[self._row].item() for column in frame.baseline]
        age_ns = frame.t_sent_ns - moved_ns if moved_ns else None
        counter, self._baseline_counter = self._baseline_counter, next_counter(self._baseline_counter)
        return BASELINE.pack(Baseline(self.node, counter, status, mean_pf, worst_pf, age_ns))

    def identity_frame(self) -> bytes:
        """Return the leg's identity as `struct can_frame`."""
        identity = self._identity
        self._identity = identity._replace(counter=next_counter(identity.counter))
        return IDENTITY.pack(identity)

    def calibration_frame(self) -> bytes:
        """Return the leg's calibration as `struct can_frame`."""
        calibration = self._calibration
        self._calibration = calibration._replace(counter=next_counter(calibration.counter))
        return CALIBRATION.pack(calibration)

    def repeated_fault_frame(self) -> bytes:
        """Return the last fault report once more as `struct can_frame`, for consumers that came since."""
        state, mask, cause = self.reported
        counter, self._fault_counter = self._fault_counter, next_counter(self._fault_counter)
        return FAULT.pack(Fault(self.node, counter, State(state), State(state), mask, Cause(cause)))


#: Period of `Ground` [ns].
_GROUND_PERIOD_NS = 100_000_000
#: Events that wait for room at most; the oldest is lost first.
_MAX_WAITING_EVENTS = 24


class GaitFrames:
    """Queue of gait events and of periodic `Ground` frames of all legs that are to be sent on CAN.

    Args:
        nodes: CAN node id of each leg.

    Attributes:
        events: Events that wait to be sent, oldest first, each with whether all feet were in the air then.
        waiting: Rows of the legs whose `Ground` waits.
    """

    def __init__(self, nodes: Sequence[int]) -> None:
        self._nodes = nodes
        self._event_counters, self._counters = [0] * len(nodes), [0] * len(nodes)
        self.events: deque[tuple[GaitEvent, bool]] = deque(maxlen=_MAX_WAITING_EVENTS)
        self._gait: GaitFrame | None = None
        self._due_ns = 0
        self.waiting: deque[int] = deque()

    def queue_gait(self, gait: GaitFrame) -> None:
        """Queue the events of a gait estimate, and its periodic frames if they are due."""
        self.events += [(event, gait.all_in_air) for event in gait.events]
        if gait.t_ns >= self._due_ns:
            self._due_ns = (gait.t_ns // _GROUND_PERIOD_NS + 1) * _GROUND_PERIOD_NS
            self._gait = gait
            self.waiting = deque(range(len(self._nodes)))

    def event_frames(self, now_ns: int, max_frames: int) -> list[bytes]:
        """Return the oldest unsent events as CAN frames; call `drop_sent_events` for those accepted.

        Args:
            now_ns: Time of sending [ns].
            max_frames: Most frames to return.
        """
        counters = self._event_counters.copy()
        frames = []
        for event, all_in_air in list(self.events)[:max_frames]:
            node, counter = self._nodes[event.leg], counters[event.leg]
            counters[event.leg] = next_counter(counter)
            age_ns = now_ns - event.t_ns
            content = GaitEventFrame(node, counter, event.kind, age_ns, event.sigma_s, all_in_air)
            frames.append(GAIT_EVENT.pack(content))
        return frames

    def drop_sent_events(self, n: int) -> None:
        """Remove the `n` oldest events from the queue, after they were sent."""
        for _ in range(n):
            event, _ = self.events.popleft()
            self._event_counters[event.leg] = next_counter(self._event_counters[event.leg])

    def pop_periodic_frames(self, max_frames: int) -> list[bytes]:
        """Return queued `Ground` frames, at most `max_frames`, and remove them from the queue."""
        return [self._ground_frame(self.waiting.popleft()) for _ in range(min(len(self.waiting), max_frames))]

    def _ground_frame(self, row: int) -> bytes:
        gait, node, counter = self._gait, self._nodes[row], self._counters[row]
        assert gait is not None
        self._counters[row] = next_counter(counter)
        return GROUND.pack(Ground(node, counter, *_of_leg(gait, GROUND.signals, row)))


def _of_leg(gait: GaitFrame, names: Iterable[str], row: int) -> list[Any]:
    """Return fields of a gait estimate for one leg; those of `Ground` have the same names."""
    fields = map(partial(getattr, gait), names)
    return [field[row].tolist() if isinstance(field, np.ndarray) else field for field in fields]
