"""The queue that Linux keeps for a CAN interface, and what it does with it when the carrier goes.

Source:
    Linux: net/sched/sch_fifo.c, net/sched/sch_generic.c, net/core/link_watch.c.
"""

import math
from collections import deque
from typing import NamedTuple

__all__ = ["Queued", "TransmitQueue"]

#: The kernel looks after interfaces that lost their carrier at most this often [ns].
_LINK_WATCH_NS = 1_000_000_000


class Queued(NamedTuple):
    """A frame on its way.

    Attributes:
        handed_ns: When it was handed to the kernel [ns].
        data: The frame, as in `firmware_interface.socketcan`.
        ours: Whether it came from a socket, and not from another program.
    """

    handed_ns: int
    data: bytes
    ours: bool


class TransmitQueue:
    """A queue of frames.

    Args:
        room: Frames that it holds.
        head_drop: Whether a full one drops its oldest frame (`pfifo_head_drop`) or refuses the newest (`pfifo`).

    Attributes:
        n_pushed_out: Frames dropped for newer ones.
        n_purged: Frames emptied out.
        n_swallowed: Frames taken while there was no carrier, and lost.
        look_ns: When the kernel looks after the carrier next [ns]; infinite if it has no reason to.
    """

    def __init__(self, room: int, *, head_drop: bool) -> None:
        self._frames: deque[Queued] = deque()
        self._room = room
        self._head_drop = head_drop
        self._active = True
        self._carrier = True
        self._may_look_ns = 0
        self.look_ns: float = math.inf
        self.n_pushed_out = 0
        self.n_purged = 0
        self.n_swallowed = 0

    def __len__(self) -> int:
        """Return how many frames wait."""
        return len(self._frames)

    def put(self, frame: Queued) -> bool:
        """Take a frame.

        Returns:
            False for one that was refused: ENOBUFS.
        """
        if not self._active:
            self.n_swallowed += 1
            return True
        if len(self._frames) >= self._room:
            if not self._head_drop:
                return False
            self._frames.popleft()
            self.n_pushed_out += 1
        self._frames.append(frame)
        return True

    def take(self) -> Queued:
        """Return the oldest frame, of which there is one."""
        return self._frames.popleft()

    def purge(self) -> None:
        """Empty the queue."""
        self.n_purged += len(self._frames)
        self._frames.clear()

    def stop(self) -> None:
        """Be emptied with an interface that goes down; when it comes up again, it has a carrier."""
        self.purge()
        self.regain_carrier()
        self.look_ns = math.inf

    def lose_carrier(self, t_ns: int) -> None:
        """The kernel is told; it acts at once if it has not just done so."""
        self._carrier = False
        self.look_ns = max(t_ns, self._may_look_ns)

    def regain_carrier(self) -> None:
        """A deactivated queue is made active at once; one that the kernel did not get to is as it was."""
        self._carrier = True
        self._active = True

    def look(self, t_ns: int) -> None:
        """Do what the kernel does when it looks after the carrier."""
        self.look_ns = math.inf
        self._may_look_ns = t_ns + _LINK_WATCH_NS
        if not self._carrier:
            self._active = False
            self.purge()
