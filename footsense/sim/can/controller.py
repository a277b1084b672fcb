"""Simulated CAN controller on the bus: arbitration, acknowledgement, error counter, bus-off.

Not modelled: real stuff bits (every frame has its maximum length); faults that begin or end within a frame (they act
from the next on); receive errors; drivers that keep the carrier in bus-off.

Source:
    ISO 11898-1: acknowledgement, retransmission, error counters and states, recovery from bus-off.
    Linux: drivers/net/can/dev/dev.c.
"""

import math
from collections import deque
from collections.abc import Callable, Sequence
from typing import NamedTuple

from firmware_interface.can.socketcan import CONTROLLER_ACTIVE, ErrorClass, error_frame, unpack_frame
from firmware_interface.wire_timing import LONGEST_FRAME_BITS, max_can_frame_bits
from footsense.sim.can.transmit_queue import OtherSender, QueuedFrame, TransmitQueue

#: Bits of an error flag, its delimiter and the pause behind it; more for a controller that is error passive.
_ERROR_FRAME_BITS = 6 + 8 + 3
_SUSPEND_TRANSMISSION_BITS = 8
#: Bits of a frame behind the one in which an acknowledgement is missing: delimiter, end of frame, pause.
_AFTER_ACK_BITS = 1 + 7 + 3
#: Recessive bits after which a controller may leave bus-off.
_BUS_OFF_RECOVERY_BITS = 128 * 11

_ERROR_PASSIVE_THRESHOLD = 128
_BUS_OFF_THRESHOLD = 256
_CONTROLLER_TX_PASSIVE = 0x20

#: Transmit mailboxes of the controller.
N_MAILBOXES = 3


class CanSettings(NamedTuple):
    """Settings of a simulated CAN interface: transmit queue and controller.

    Attributes:
        queue_frames: Capacity of its queue.
        head_drop: Whether a full queue drops its oldest frame instead of refusing the newest.
        one_shot: Whether the controller sends each frame once only.
        restart_ns: Time from bus-off to the automatic restart [ns]; 0 for none.
    """

    queue_frames: int
    head_drop: bool
    one_shot: bool
    restart_ns: int


class CanController:
    """Simulated CAN controller of one interface: mailboxes, arbitration, error counter.

    Args:
        queue: Transmit queue of the interface.
        settings: Settings of the interface.
        bit_ns: Duration of a bit on the bus [ns].
        others: The other nodes on the bus.
        report_error: Receives the error frames that it reports.

    Attributes:
        running: Whether the interface is up.
        no_ack: Whether no other node acknowledges.
        shorted: Whether the wires are shorted.
        on_delivered: Called with each frame of ours that reached the other nodes: its time, the time at which it was
            handed over [ns], and the frame. None for no listener.
        n_lost: Frames of ours that failed in one-shot mode.
        n_flushed: Frames of ours in the mailboxes at a restart or stop.
        n_bus_off: Times that it went bus-off.
    """

    def __init__(
        self,
        queue: TransmitQueue,
        settings: CanSettings,
        bit_ns: float,
        others: Sequence[OtherSender],
        report_error: Callable[[bytes], None],
    ) -> None:
        self._queue = queue
        self._settings = settings
        self._bit_ns = bit_ns
        self._others = others
        self._report_error = report_error
        self._mailboxes: deque[QueuedFrame] = deque()
        self._passed: Callable[[int], None] | None = None  # called when our frame has passed
        self._free_ns = math.inf
        self._restart_ns = math.inf
        self._error_count = 0
        self.running = True
        self.no_ack = self.shorted = False
        self.on_delivered: Callable[[int, int, bytes], object] | None = None
        self.n_lost = self.n_flushed = self.n_bus_off = 0

    @property
    def due_ns(self) -> float:
        """Time of the controller's next event [ns]; infinite if none is pending."""
        return min(self._free_ns, self._restart_ns)

    def process_due(self, t_ns: int) -> None:
        """Process all events of the controller that are due at `t_ns` [ns]."""
        if self._free_ns <= t_ns:
            self._free_ns = math.inf
            if self._passed is not None:
                self._passed(t_ns)
        if self._restart_ns <= t_ns:
            self._restart_ns = math.inf
            self._flush_mailboxes()
            self._error_count = 0
            self._queue.regain_carrier()
            self._report_error(error_frame(ErrorClass.RESTARTED))
            self._occupy_wire(t_ns, _BUS_OFF_RECOVERY_BITS, None)

    def reset(self) -> None:
        """Discard mailboxes and the frame in transmission, and reset the errors, as an interface that goes down."""
        self._flush_mailboxes()
        self._free_ns = self._restart_ns = math.inf
        self._error_count = 0

    def start_transmission(self, t_ns: int) -> None:
        """Fill the mailboxes from the queue, and start sending a frame if the bus is idle."""
        while len(self._mailboxes) < N_MAILBOXES and self.running and self._queue.frames:
            self._mailboxes.append(self._queue.frames.popleft())
        if self._free_ns < math.inf:
            return
        sent = None
        if self.running and self._mailboxes and self._error_count < _BUS_OFF_THRESHOLD:
            sent = self._mailboxes[0]
        # Without acknowledgement, and on a shorted bus, no frame of another node arrives.
        reachable = not (self.no_ack or self.shorted)
        waiting = [node for node in self._others if node.waiting] if reachable else []
        other = min(waiting, key=lambda node: node.can_id, default=None)
        our_id, data = unpack_frame(sent.packed_frame) if sent else (0, b"")
        if other and not (sent and our_id < other.can_id):
            other.waiting = False
            if sent and self._settings.one_shot:  # the arbitration was lost
                self._drop_frame()
            self._occupy_wire(t_ns, LONGEST_FRAME_BITS, None)
        elif sent and self.shorted:
            self._occupy_wire(t_ns, 1 + _ERROR_FRAME_BITS + self._suspend_bits(), self._count_bit_error)
        elif sent and self.no_ack:
            bits = max_can_frame_bits(len(data)) - _AFTER_ACK_BITS + _ERROR_FRAME_BITS + self._suspend_bits()
            self._occupy_wire(t_ns, bits, self._count_missing_ack)
        elif sent:
            self._occupy_wire(t_ns, max_can_frame_bits(len(data)), self._deliver_frame)

    def _occupy_wire(self, t_ns: int, bits: int, then: Callable[[int], None] | None) -> None:
        """Occupy the bus for a number of bits from `t_ns` [ns] on, then call `then`."""
        self._free_ns = t_ns + bits * self._bit_ns
        self._passed = then

    def _suspend_bits(self) -> int:
        """Return the bits that the controller must pause after a frame: 8 if it is error passive, else 0."""
        return _SUSPEND_TRANSMISSION_BITS if self._error_count >= _ERROR_PASSIVE_THRESHOLD else 0

    def _flush_mailboxes(self) -> None:
        """Discard the frames in the mailboxes."""
        self.n_flushed += sum(frame.from_socket for frame in self._mailboxes)
        self._mailboxes.clear()

    def _drop_frame(self) -> None:
        """Discard the oldest mailbox's frame, and count it as lost."""
        self.n_lost += self._mailboxes.popleft().from_socket

    def _deliver_frame(self, t_ns: int) -> None:
        """Deliver the transmitted frame to its receivers, and decrement the transmit error counter."""
        frame = self._mailboxes.popleft()
        if self._error_count:
            self._change_error_count(-1)
        if frame.from_socket and self.on_delivered is not None:
            self.on_delivered(t_ns, frame.queued_ns, frame.packed_frame)

    def _count_missing_ack(self, t_ns: int) -> None:
        """Count a missing acknowledgement; alone it takes no controller beyond error passive."""
        del t_ns
        if self._error_count < _ERROR_PASSIVE_THRESHOLD:
            self._change_error_count(8)
        if self._settings.one_shot:
            self._drop_frame()

    def _count_bit_error(self, t_ns: int) -> None:
        """Count a bit error, and go bus-off at an error count of 256."""
        self._change_error_count(8)
        if self._error_count >= _BUS_OFF_THRESHOLD:
            self.n_bus_off += 1
            self._queue.lose_carrier(t_ns)
            if self._settings.restart_ns:
                self._restart_ns = t_ns + self._settings.restart_ns
        elif self._settings.one_shot:
            self._drop_frame()

    def _change_error_count(self, change: int) -> None:
        """Add `change` to the transmit error counter, and report a change of the error state."""
        before, after = self._error_count, max(0, self._error_count + change)
        self._error_count = after
        if after >= _BUS_OFF_THRESHOLD:
            self._report_error(error_frame(ErrorClass.BUS_OFF))
        elif before < _ERROR_PASSIVE_THRESHOLD <= after:
            self._report_error(error_frame(ErrorClass.CONTROLLER, _CONTROLLER_TX_PASSIVE))
        elif after < _ERROR_PASSIVE_THRESHOLD <= before:
            self._report_error(error_frame(ErrorClass.CONTROLLER, CONTROLLER_ACTIVE))
