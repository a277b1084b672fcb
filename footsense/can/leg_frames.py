"""One leg's frames beside Force and Quality: fault report, heartbeat and baseline, with their counters."""

from functools import cache

from firmware_interface.can.baseline import BASELINE_ID, encode_baseline
from firmware_interface.can.codes import Cause, NmtState, State
from firmware_interface.can.crc8 import next_counter
from firmware_interface.can.events import FAULT_ID, HEARTBEAT_ID, encode_fault, encode_heartbeat
from firmware_interface.can.socketcan import pack_frame
from footsense.frames import ContactFrame

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
    """Return the heartbeat of a node whose leg is in a state."""
    nmt_state = _NMT_OF_STATE.get(State(state), NmtState.OPERATIONAL)
    return heartbeat_frame(node, nmt_state, degraded_timing=degraded_timing)


class CanLeg:
    """The fault reports and baselines of one leg.

    Args:
        row: Its row in the frames.
        node: Its CAN node id, 1..6.

    Attributes:
        node: Its CAN node id.
        reported: State, element mask and cause of the last fault report that was sent.
    """

    def __init__(self, row: int, node: int) -> None:
        self._row = row
        self.node = node
        self._fault_counter = 0
        self._baseline_counter = 0
        # As if stopped until now: the first state is a change, and a consumer that was here before receives it.
        self.reported = (int(State.STOPPED), 0, int(Cause.NONE))

    def fault_frame(self, state: int, mask: int, cause: int) -> bytes:
        """Return the CAN frame of a fault report; call `set_reported` once the frame was sent."""
        data = encode_fault(self.node, self._fault_counter, state, self.reported[0], mask, cause)
        return pack_frame(FAULT_ID + self.node, data)

    def set_reported(self, report: tuple[int, int, int]) -> None:
        """Store the state, mask and cause of the fault report that was sent."""
        self._fault_counter = next_counter(self._fault_counter)
        self.reported = report

    def baseline_frame(self, frame: ContactFrame) -> bytes:
        """Return the CAN frame of the leg's baseline: status, mean and worst drift [pF], and age [ns]."""
        status, mean_pf, worst_pf, moved_ns = [column[self._row].item() for column in frame.baseline]
        age_ns = frame.t_sent_ns - moved_ns if moved_ns else None
        data = encode_baseline(self.node, self._baseline_counter, status, mean_pf, worst_pf, age_ns)
        self._baseline_counter = next_counter(self._baseline_counter)
        return pack_frame(BASELINE_ID + self.node, data)
