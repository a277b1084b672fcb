"""One leg's frames beside Force and Quality: fault report, heartbeat and zero, and where their counters stand."""

from firmware_interface import can_baseline, can_events, can_frames
from firmware_interface.can_codes import Cause, NmtState, State
from firmware_interface.crc8 import next_counter
from firmware_interface.socketcan import pack_frame
from footsense.frames import ContactFrame

__all__ = ["CanLeg"]

_HEARTBEAT_PERIOD_NS = 200_000_000
_ZERO_PERIOD_NS = 1_000_000_000

#: A leg whose chips give nothing waits for them as one without a baseline waits for its tare.
_NMT_OF_STATE = {
    int(State.STOPPED): NmtState.STOPPED,
    int(State.ABSENT): NmtState.PRE_OPERATIONAL,
    int(State.STARTING): NmtState.PRE_OPERATIONAL,
    int(State.CONVERTER_FAULT): NmtState.PRE_OPERATIONAL,
    int(State.NO_BASELINE): NmtState.PRE_OPERATIONAL,
    int(State.TARING): NmtState.PRE_OPERATIONAL,
}


class CanLeg:
    """One leg on the bus.

    Args:
        row: Its row in the frames.
        node: Its CAN node id.
        now_ns: The present time [ns].
        phase_rel: Where in their periods its heartbeat and its zero come [1]: not all legs' on top of one scan's.

    Attributes:
        node: Its CAN node id.
        force_head: What stands before the data of its Force in `struct can_frame`.
        quality_head: The same of its Quality.
        heartbeat_due_ns: When its next heartbeat is due [ns].
        zero_due_ns: When its next zero is due [ns].
        due_ns: The earlier one of both.
        degraded_timing: Whether its heartbeats say so.
        reported: State, element mask and cause that the last fault report told.
    """

    def __init__(self, row: int, node: int, now_ns: int, phase_rel: float) -> None:
        self._row = row
        self.node = node
        self.force_head = pack_frame(can_frames.FORCE_ID + node, bytes(8))[:-8]
        self.quality_head = pack_frame(can_frames.QUALITY_ID + node, bytes(8))[:-8]
        self._fault_counter = 0
        self._zero_counter = 0
        self.heartbeat_due_ns = now_ns + int(phase_rel * _HEARTBEAT_PERIOD_NS)
        self.zero_due_ns = now_ns + int(phase_rel * _ZERO_PERIOD_NS)
        self.due_ns = self.heartbeat_due_ns
        self.degraded_timing = False
        # As if stopped until now: the first state is a change, and a consumer that was here before learns it.
        self.reported = (int(State.STOPPED), 0, int(Cause.NONE))

    def report(self, state: int, mask: int, cause: int) -> bytes:
        """Return a fault report; `has_reported` tells that it was taken."""
        data = can_events.encode_fault(self.node, self._fault_counter, state, self.reported[0], mask, cause)
        return pack_frame(can_events.FAULT_ID + self.node, data)

    def has_reported(self, now: tuple[int, int, int]) -> None:
        """Take note that the report of this state, mask and cause is out."""
        self._fault_counter = next_counter(self._fault_counter)
        self.reported = now

    def heartbeat(self, state: NmtState) -> bytes:
        """Return a heartbeat."""
        data = can_events.encode_heartbeat(state, degraded_timing=self.degraded_timing)
        return pack_frame(can_events.HEARTBEAT_ID + self.node, data)

    def next_heartbeat(self, state: int, now_ns: int) -> bytes:
        """Return the heartbeat that is due, of a leg in this state."""
        self.heartbeat_due_ns = _next_due(self.heartbeat_due_ns, _HEARTBEAT_PERIOD_NS, now_ns)
        self.due_ns = min(self.heartbeat_due_ns, self.zero_due_ns)
        return self.heartbeat(_NMT_OF_STATE.get(state, NmtState.OPERATIONAL))

    def next_zero(self, frame: ContactFrame) -> bytes:
        """Return the zero that is due."""
        self.zero_due_ns = _next_due(self.zero_due_ns, _ZERO_PERIOD_NS, frame.t_sent_ns)
        self.due_ns = min(self.heartbeat_due_ns, self.zero_due_ns)
        status, mean_pf, worst_pf, moved_ns = (column[self._row].item() for column in frame.baseline)
        age_ns = frame.t_sent_ns - moved_ns if moved_ns else None
        data = can_baseline.encode_baseline(self.node, self._zero_counter, status, mean_pf, worst_pf, age_ns)
        self._zero_counter = next_counter(self._zero_counter)
        return pack_frame(can_baseline.BASELINE_ID + self.node, data)


def _next_due(due_ns: int, period_ns: int, now_ns: int) -> int:
    """Return when a frame is due again that was due at `due_ns` and is sent now; those missed are left out."""
    return due_ns + (1 + (now_ns - due_ns) // period_ns) * period_ns
