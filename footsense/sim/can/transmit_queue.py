"""Transmit queue of a CAN interface in Linux, and other traffic: of another node, or of a program before our queue.

Source:
    Linux: net/sched/sch_fifo.c, net/sched/sch_generic.c, net/core/link_watch.c.
"""

import math
from collections import deque
from typing import NamedTuple

from footsense.sim.faults.scene_faults import CanQueueFull, CanTraffic

_NS_PER_S = 1_000_000_000
#: Least time between two looks of the kernel at interfaces without carrier [ns].
_MIN_CARRIER_CHECK_INTERVAL_NS = 1_000_000_000


class QueuedFrame(NamedTuple):
    """One CAN frame in the transmit queue or in a controller mailbox.

    Attributes:
        queued_ns: Time at which it was handed to the kernel [ns].
        packed_frame: The frame, as in `firmware_interface.can.socketcan`.
        from_socket: Whether it came from a socket, and not from another program.
    """

    queued_ns: int
    packed_frame: bytes
    from_socket: bool


class TransmitQueue:
    """Simulated transmit queue of a CAN interface, with the drop and carrier rules of the Linux kernel.

    Args:
        capacity: Capacity in frames.
        head_drop: Whether a full queue drops its oldest frame (`pfifo_head_drop`) or refuses the newest (`pfifo`).

    Attributes:
        frames: The frames, oldest first.
        n_purged: Frames dropped with the carrier.
        carrier_check_ns: Next look of the kernel at the carrier [ns]; infinite without a reason.
    """

    def __init__(self, capacity: int, *, head_drop: bool) -> None:
        self.frames: deque[QueuedFrame] = deque()
        self._capacity = capacity
        self._head_drop = head_drop
        self._active = self._carrier = True
        self._next_check_ns = 0
        self.carrier_check_ns: float = math.inf
        self.n_purged = 0

    def put(self, frame: QueuedFrame) -> bool:
        """Append a frame; a full queue refuses it or drops the oldest one. Return whether it was accepted.

        Returns:
            False if it was refused: ENOBUFS.
        """
        if not self._active:
            return True
        if len(self.frames) >= self._capacity:
            if not self._head_drop:
                return False
            self.frames.popleft()
        self.frames.append(frame)
        return True

    def purge(self) -> None:
        """Discard all queued frames."""
        self.n_purged += len(self.frames)
        self.frames.clear()

    def reset(self) -> None:
        """Discard all queued frames and reset the carrier to present, as when the interface goes down."""
        self.purge()
        self.regain_carrier()
        self.carrier_check_ns = math.inf

    def lose_carrier(self, t_ns: int) -> None:
        """Mark the carrier as lost; the kernel notices at once, or a second after its last check."""
        self._carrier = False
        self.carrier_check_ns = max(t_ns, self._next_check_ns)

    def regain_carrier(self) -> None:
        """Mark the carrier as present, and reactivate a deactivated queue at once."""
        self._active = self._carrier = True

    def run_carrier_check(self, t_ns: int) -> None:
        """Do the kernel's carrier check at `t_ns` [ns]: without a carrier, deactivate and empty the queue."""
        self.carrier_check_ns = math.inf
        self._next_check_ns = t_ns + _MIN_CARRIER_CHECK_INTERVAL_NS
        if not self._carrier:
            self._active = False
            self.purge()


class OtherSender:
    """Periodic sender of 8-byte CAN frames beside the daemon, and whether one of its frames is waiting.

    Args:
        fault: The traffic of the scene.

    Attributes:
        can_id: Id of its frames.
        is_node: Whether it is a node on the bus, and not a program in front of our queue.
        due_ns: Time of its next frame [ns]; infinite after the last one.
        waiting: Whether the node has a frame to send; it keeps one at most.
    """

    def __init__(self, fault: CanTraffic | CanQueueFull) -> None:
        self.is_node = isinstance(fault, CanTraffic)
        self.can_id = fault.can_id if isinstance(fault, CanTraffic) else 0x7FF
        self.due_ns: float = fault.at_ns
        self.waiting = False
        self._period_ns = _NS_PER_S / fault.rate_hz
        self._until_ns = fault.until_ns

    def mark_frame_waiting(self) -> None:
        """Mark the frame that is due as waiting, and schedule the next one a period later."""
        self.waiting = True
        self.due_ns += self._period_ns
        if self.due_ns >= self._until_ns:
            self.due_ns = math.inf
