"""Other CAN traffic of a scene: another node on the bus, or another program on the same computer."""

import math

from footsense.sim.faults.scene_faults import CanQueueFull, CanTraffic

_NS_PER_S = 1_000_000_000


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
